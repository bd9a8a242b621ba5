"""Load steps: cut back where they fail, by arc length past limit points, in stable states."""

from __future__ import annotations

import numpy as np
import pytest

from gpusim.errors import NotConverged
from gpusim.fem import Isotropic, Model, NeoHookean, Solution, solve
from gpusim.fem.procedures import load_steps
from gpusim.fem.procedures.newton import Controls, Equilibrium
from gpusim.mesh import box
from tests.support.nonlinear_cases import pressed_column, shallow_arch


def nonlinear(model: Model, *factors: float) -> Solution:
    return solve(model, geometry="nonlinear", factors=factors)


@pytest.mark.parametrize("eccentric", [1e-2, pytest.param(1e-4, marks=pytest.mark.slow), 1e-6])
@pytest.mark.parametrize("alpha", [3.0, 10.0])
def test_a_column_buckles_to_the_side_that_it_is_pushed_to(eccentric: float, alpha: float) -> None:
    model = pressed_column((20, 1, 1), alpha, eccentric).model
    end = model.mesh.points[:, 0] == 100.0
    one = nonlinear(model, 1.0)
    assert one.converged and not one.warnings and one.steps[-1].iterations[-1].definite
    # through the critical load with steps that see it coming
    many = nonlinear(model, *(np.array([2.3, 2.4, 2.45, 2.47, 2.5, 2.6, 3.0, alpha]) / alpha))
    assert np.abs(one.u - many.u).max() <= 1e-5 * np.abs(many.u).max()
    assert one.u[end, 2].mean() > 60.0


def test_a_straight_column_stays_straight_and_says_so() -> None:
    found = nonlinear(pressed_column((20, 1, 1), 5.0, 0.0).model, 0.4, 0.6, 0.8, 1.0)
    wanted = [step for step in found.steps if step.wanted]
    assert [step.iterations[-1].definite for step in wanted] == [True, False, False, False]
    assert np.abs(found.u[:, 2]).max() <= 1e-6 * np.abs(found.u).max()
    # no way around is looked for from where a body isn't stable
    assert [step.substeps for step in wanted[2:]] == [1, 1]
    assert "3 load steps, first number 2" in found.warnings[0]


def test_an_arch_snaps_through_and_back() -> None:
    """Limits at 9.06 and 4.03: whether there is one branch or another depends on the past."""
    model = shallow_arch("hex8", (40, 1, 1), 12.0).model
    crown = (np.abs(model.mesh.points[:, 0]) <= 1e-9) & (model.mesh.points[:, 2] > 0)
    found = nonlinear(model, *(np.array([3.0, 6.0, 12.0, 6.0, 3.0]) / 12.0))
    assert found.converged
    ways = [-step.u[crown, 2].mean() for step in found.steps if step.wanted]
    assert ways[0] < ways[1] < 0.6 and 8.0 < ways[2] < 8.5 and 6.5 < ways[3] < ways[2]
    assert ways[4] == pytest.approx(ways[0], rel=1e-5)


def test_failed_steps_are_halved_and_doubled_again(monkeypatch: pytest.MonkeyPatch) -> None:
    tried: list[float] = []
    real = load_steps.equilibrium

    def failing(equation, solver, u, factors, controls: Controls) -> Equilibrium:  # type: ignore[no-untyped-def]
        tried.append(float(factors[0]))
        begin = done[-1] if done else 0.0
        # no step by more than a quarter in the first half, by more than half later
        if factors[0] - begin > (0.25 if begin < 0.5 else 0.5):
            raise NotConverged("too far")
        found = real(equation, solver, u, factors, controls)
        done.append(float(factors[0]))
        return found

    done: list[float] = []
    monkeypatch.setattr(load_steps, "equilibrium", failing)
    mesh = box((4.0, 1.0, 1.0), (4, 1, 1))
    forces = np.where(mesh.points[:, :1] == 4.0, [0.0, 0.0, 4e-3], 0.0)
    fixed = np.repeat(mesh.points[:, :1] == 0.0, 3, axis=1)
    model = Model(mesh, Isotropic(1.0, 0.3), fixed, forces)
    (step,) = nonlinear(model, 1.0).steps
    assert tried == [1.0, 0.5, 0.25, 0.5, 1.0]
    assert step.substeps == 3 and step.wanted
    monkeypatch.undo()
    work = [nonlinear(model, *path).external_work[0] for path in ([1.0], [0.25, 0.5, 1.0])]
    assert (
        step.external_work == pytest.approx(work[1], rel=1e-6) != pytest.approx(work[0], rel=1e-3)
    )


def test_points_on_the_way_count_their_own_iterations() -> None:
    found = nonlinear(pressed_column((20, 1, 1), 3.0, 1e-6).model, 1.0)
    points = [step for step in found.steps if not step.wanted]
    assert len(points) >= 3 and all(step.substeps == 1 for step in points[1:])
    every = [one for step in found.steps for one in step.iterations]
    assert found.iterations == sum(one.solver_iterations for one in every)
    factors = [step.factors[0] for step in points]
    assert all(0.0 < factor < 1.0 for factor in factors)


def test_reactions_balance_loads_in_every_step() -> None:
    found = nonlinear(shallow_arch("hex8", (40, 1, 1), 12.0).model, 0.5, 1.0)
    assert found.model is not None
    for step in found.steps:
        total = step.reactions.sum(axis=0) + step.factors[0] * found.model.forces.sum(axis=0)
        assert np.abs(total).max() <= 1e-6 * 12.0


def test_a_great_step_stays_on_the_branch_of_its_load_path() -> None:
    """In one step to 1.5 times Euler's load Newton's method once came to the other branch."""
    case = pressed_column((40, 1, 1), 1.5 * (np.pi / 2.0) ** 2, 1e-3)
    found = nonlinear(case.model, 1.0)
    assert found.converged and not found.warnings
    assert np.abs(case.errors(found)).max() <= 3e-3


@pytest.mark.parametrize("nu", [0.45, 0.4999])
def test_no_cell_is_pushed_through_itself(nu: float) -> None:
    """Pulled to four times its length in one step a rubber block once came out as its mirror image:
    Newton's first step leads beyond its planes of symmetry, where there is an equilibrium, too."""
    mesh = box((2.0, 1.0, 1.0), (2, 2, 2))
    fixed = mesh.points == 0.0
    fixed[:, 0] |= mesh.points[:, 0] == 2.0
    pull = np.where((mesh.points[:, :1] == 2.0) & (np.arange(3) == 0), 6.0, 0.0)
    found = nonlinear(Model(mesh, NeoHookean(1.0, nu), fixed, prescribed=pull), 1.0)
    across = 1.0 + found.u[mesh.points[:, 1] == 1.0, 1]
    assert np.abs(across - 4.0**-nu).max() <= 0.03  # one half where nothing changes its volume
