"""Newton's method: its order, the error that it states, and when it gives up."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt
import pytest

from gpusim.errors import NotConverged
from gpusim.fem import Hencky, Isotropic, Law, Model, NeoHookean, SaintVenantKirchhoff, face_force
from gpusim.fem.assembly.element_responses import element_responses
from gpusim.fem.assembly.equation import Equation
from gpusim.fem.linear.solve_plan import Clock, Options
from gpusim.fem.linear.tangent_solver import TangentSolver
from gpusim.fem.model.model import resolve_formulation
from gpusim.fem.procedures.newton import Controls, Equilibrium, Steps, equilibrium, error_left
from gpusim.mesh import select_faces
from tests.support.nonlinear_cases import (
    NonlinearCase,
    end_load,
    own_weight,
    pressed_column,
    ring,
    shallow_arch,
)
from tests.support.verification_models import mapped, unit_block

Float = npt.NDArray[np.float64]

CONTROLS = Controls(1e-6, 1e-4, Steps.FORETOLD, True)


def equation_of(model: Model, formulation: str | None = None) -> tuple[Equation, TangentSolver]:
    chosen = resolve_formulation(model, formulation)
    equation = Equation(model, element_responses(model, chosen))
    options = Options("auto", None, "numpy", 1e-6, None, None, None, chosen, Clock())
    return equation, TangentSolver(equation, options)


def found(model: Model, controls: Controls = CONTROLS, formulation: str | None = None) -> Float:
    return solved(model, controls, formulation).u


def solved(model: Model, controls: Controls, formulation: str | None = None) -> Equilibrium:
    equation, solver = equation_of(model, formulation)
    return equilibrium(equation, solver, np.zeros(model.mesh.points.shape), np.ones(1), controls)


def bent(kind: str, law: Law | Isotropic) -> Model:
    """A thick bar bent by a tenth of its length."""
    mesh = mapped(unit_block(kind, (4, 2, 2)), lambda unit: unit * [4.0, 1.0, 1.0], straight=True)
    fixed = np.repeat(mesh.points[:, :1] == 0.0, 3, axis=1)
    end = select_faces(mesh, name="x_max")
    return Model(mesh, law, fixed, face_force(mesh, end, (0.0, 0.0, 0.002)))


@pytest.mark.parametrize(
    ("kind", "formulation"),
    [
        ("hex8", "incompatible"), ("hex8", "full"), ("hex8", "bbar"), ("hex20", "full"),
        ("hex20", "reduced"), ("hex27", "full"), ("tet4", "full"), ("tet10", "full"),
        ("wedge6", "full"), ("wedge15", "full"),
    ],
)  # fmt: skip
@pytest.mark.parametrize(
    "law", [Isotropic(1.0, 0.3), SaintVenantKirchhoff(1.0, 0.3), NeoHookean(1.0, 0.3),
            Hencky(1.0, 0.3)], ids=["isotropic", "svk", "neo_hooke", "hencky"],
)  # fmt: skip
def test_order_is_two(kind: str, formulation: str, law: Law | Isotropic) -> None:
    controls = Controls(1e-14, 1e-10, Steps.PLAIN, True)
    steps = [one.step for one in solved(bent(kind, law), controls, formulation).iterations]
    size = -np.log(steps)
    # how digits grow from step to step, as long as rounding doesn't stop them
    orders = [size[k + 1] / size[k] for k in range(1, len(steps) - 1) if steps[k + 1] > 1e-12]
    assert max(orders) >= 1.8 and len(steps) <= 9 and steps[-1] <= 1e-11


REFERENCES = {
    "end load": lambda: end_load("hex8", (30, 1, 1), (10.0,)),
    "own weight": lambda: own_weight("hex8", (40, 1, 1)),
    "ring": lambda: ring("tet10", (20, 1, 1)),
    "column": lambda: pressed_column((40, 1, 1), 2.4, 1e-2),
    "arch": lambda: shallow_arch("hex8", (40, 1, 1), 12.0),
}


@pytest.mark.parametrize("name", REFERENCES)
@pytest.mark.parametrize("tolerance", [1e-2, 1e-4, 1e-6])
def test_stated_error_is_no_less_than_the_true_one(name: str, tolerance: float) -> None:
    case: NonlinearCase = REFERENCES[name]()
    model = replace(case.model, forces=case.factors[-1] * case.model.forces)
    loose = Controls(tolerance, 1e-4, Steps.FORETOLD, False)
    end = solved(model, loose)
    exact = found(model, Controls(1e-11, 1e-8, Steps.FORETOLD, False))
    error = np.abs(end.u - exact).max() / np.abs(end.u).max()
    assert error <= end.iterations[-1].error_estimate <= tolerance


@pytest.mark.parametrize(
    ("steps", "left"),
    [
        ([1.0], 1.0),  # one step tells nothing
        ([1.0, 0.9], 1.0),  # nor do steps that hardly shrink
        ([1.0, 0.1], 0.1 * 0.1 / 0.9),
        ([1.0, 0.1, 1e-3], 1e-3 * 0.1 / 0.9),  # the worse of two
        ([1.0, 1e-3, 0.07, 3e-4], 0.07),  # steps small by turns are none that shrink
        ([1.0, 1e-6, 1e-12], 1e-12 * 1e-4),  # linear solutions are no better than they are
        ([1.0, np.nan], np.nan),
    ],
)
def test_error_that_is_left(steps: Sequence[float], left: float) -> None:
    assert error_left(steps, 1e-4) == pytest.approx(left, rel=1e-12, nan_ok=True)


def test_elements_are_where_they_were_after_a_failure() -> None:
    model = bent("hex8", NeoHookean(1.0, 0.3))
    equation, solver = equation_of(replace(model, forces=1e9 * model.forces))
    begun = equation.snapshot()
    rest = np.zeros(model.mesh.points.shape)
    with pytest.raises(NotConverged, match=r"got displacements of .* the body's extent, 4"):
        equilibrium(equation, solver, rest, np.ones(1), CONTROLS)
    for one, other in zip(begun, equation.snapshot(), strict=True):
        np.testing.assert_array_equal(one.modes, other.modes)
    # and the same equation goes on from there
    small = equilibrium(equation, solver, rest, np.full(1, 1e-9), CONTROLS)
    assert np.abs(small.u - found(model)).max() <= 1e-6 * np.abs(small.u).max()


def test_stable_ends_are_insisted_on_where_asked() -> None:
    model = pressed_column((20, 1, 1), 3.0, 0.0).model
    model = replace(model, forces=3.0 * model.forces / 3.0)
    with pytest.raises(NotConverged, match="isn't stable; expected a stable one"):
        solved(model, CONTROLS)
    end = solved(model, replace(CONTROLS, stable=False))
    assert not end.iterations[-1].definite


@pytest.mark.parametrize(("strain", "definite"), [(1.0, True), (3.0, False)])
def test_an_end_found_at_once_is_judged_by_its_own_stresses(strain: float, definite: bool) -> None:
    """Stress that the first step foretells for a bar grows with its length; that of this law is E
    log(stretch) / stretch, and falls from e on: one half would grow at the other's cost."""
    mesh = mapped(unit_block("hex8", (2, 2, 2)), lambda unit: unit * [2.0, 1.0, 1.0], straight=True)
    fixed = mesh.points == 0.0
    fixed[:, 0] |= mesh.points[:, 0] == 2.0
    pull = np.where((mesh.points[:, :1] == 2.0) & (np.arange(3) == 0), 2.0 * strain, 0.0)
    end = solved(Model(mesh, Hencky(1.0, 0.0), fixed, prescribed=pull),
                 replace(CONTROLS, stable=False))  # fmt: skip
    assert len(end.iterations) == 2 and end.iterations[-1].definite is definite


def test_progress_is_told() -> None:
    told: list[tuple[int, float]] = []
    end = solved(bent("hex8", Isotropic(1.0, 0.3)),
                 replace(CONTROLS, progress=lambda *one: told.append(one)))  # fmt: skip
    assert [number for number, _ in told] == list(range(1, len(end.iterations) + 1))
    assert told[-1][1] == end.iterations[-1].error_estimate <= 1e-6
