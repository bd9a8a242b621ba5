"""Line search: metal that begins to flow is found in one load step."""

from __future__ import annotations

import numpy as np
import pytest

import gpusim as gs
from gpusim.errors import NotConverged
from gpusim.fem.assembly.element_responses import element_responses
from gpusim.fem.assembly.equation import Equation
from gpusim.fem.model.model import resolve_formulation
from gpusim.fem.procedures.line_search import line_search

STEEL = gs.J2(gs.Isotropic(210e3, 0.3), 250.0, gs.fem.Voce(400.0, 20.0, 100.0))
FORMULATIONS = ["incompatible", "full", "bbar"]


def waisted(law: gs.fem.Law = STEEL, pull: float = 0.3) -> gs.Model:
    """A plate of 100 x 20 x 2 mm, narrower by 30 % in the middle, one end of which is pulled."""
    mesh = gs.mesh.box(size=(100.0, 20.0, 2.0), divisions=(20, 5, 1))
    points = mesh.points.copy()
    points[:, 1] = 10.0 + (points[:, 1] - 10.0) * (
        1.0 - 0.3 * np.exp(-((points[:, 0] / 50.0 - 1.0) ** 2) / 0.0625)
    )
    end = np.isclose(points[:, 0], 100.0)
    fixed = np.repeat((end | np.isclose(points[:, 0], 0.0))[:, None], 3, axis=1)
    prescribed = np.zeros_like(points)
    prescribed[end, 0] = pull
    return gs.Model(gs.mesh.Mesh(points, mesh.cells), law, fixed, prescribed=prescribed)


def equation_of(model: gs.Model, formulation: str) -> Equation:
    return Equation(model, element_responses(model, resolve_formulation(model, formulation)))


@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_a_plate_yields_in_one_step(formulation: str) -> None:
    options = {"geometry": "nonlinear", "formulation": formulation, "tolerance": 1e-6}
    once = gs.solve(waisted(), factors=[1.0], **options)  # type: ignore[arg-type]
    twice = gs.solve(waisted(), factors=[0.5, 1.0], **options)  # type: ignore[arg-type]
    assert once.converged and [step.substeps for step in twice.steps] == [1, 1]
    assert len(once.steps[0].iterations) <= 15 and once.steps[0].substeps == 1
    # steps of one load are integrated otherwise, but for that the path is the same
    held = waisted().prescribed != 0.0  # type: ignore[operator]
    first, second = (one.reactions[held].sum() for one in (once, twice))
    assert abs(first - second) <= 1e-3 * abs(second)


@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_work_left_is_what_energy_lacks(formulation: str) -> None:
    """Where nothing loads an elastic body its energy grows with the square of the share, and its
    slope with the share."""
    equation = equation_of(waisted(gs.SaintVenantKirchhoff(210e3, 0.3), 0.0), formulation)
    factors = np.ones(1)
    tangent = equation.linearised(np.zeros_like(equation.model.mesh.points), factors)
    rng = np.random.default_rng(5)
    du = np.where(equation.free, rng.normal(size=tangent.u.shape), 0.0) * 1e-3
    equation.advance(tangent.u, du, False)
    left = []
    for share in (1.0, 0.5, 0.25):
        if share < 1.0:
            equation.shorten(0.5)
        part = equation.linearised(share * du, factors)
        left.append(equation.work_left(part, share * du) / share)
    assert left[0] < 0.0
    np.testing.assert_allclose(left, left[0] * np.array([1.0, 0.5, 0.25]), rtol=2e-2)


def test_a_step_too_long_is_shortened() -> None:
    equation = equation_of(waisted(), "incompatible")
    at_rest = np.zeros_like(equation.model.mesh.points)
    tangent = equation.linearised(at_rest, np.ones(1))
    du = np.where(equation.free, np.array([1.0, 0.0, 0.0]), 0.0)
    far = line_search(equation, tangent, 1e-9 * du)
    assert np.array_equal(far.u, 1e-9 * du)  # promises nothing: no load acts on what is free
    tangent.residual[:] = 1e-3 * du
    equation.advance(at_rest, du, False)
    with pytest.raises(NotConverged, match="a step too long still at"):
        line_search(equation, tangent, 1e3 * du)


def test_bodies_with_history_are_searched(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without, the same plate wants far smaller steps."""
    monkeypatch.setattr(
        "gpusim.fem.procedures.newton.line_search",
        lambda equation, tangent, du: equation.linearised(tangent.u + du, tangent.factors),
    )
    solution = gs.solve(waisted(), geometry="nonlinear", factors=[1.0], tolerance=1e-6)
    assert solution.steps[0].substeps > 3
