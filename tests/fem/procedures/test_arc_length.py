"""Arc length against the path of an arch that is integrated, and where it gives up."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt
import pytest
from scipy.interpolate import CubicSpline

from gpusim.errors import NotConverged
from gpusim.fem.assembly.element_responses import element_responses
from gpusim.fem.assembly.equation import Equation
from gpusim.fem.linear.solve_plan import Clock, Options
from gpusim.fem.linear.tangent_solver import TangentSolver
from gpusim.fem.model.model import resolve_formulation
from gpusim.fem.procedures import arc_length
from gpusim.fem.procedures.arc_length import LoadPath, follow_path
from gpusim.fem.procedures.newton import Controls, Equilibrium, Steps, equilibrium
from tests.support.elastica import clamped_arch
from tests.support.nonlinear_cases import NonlinearCase, arch_strip, shallow_arch

Float = npt.NDArray[np.float64]

CONTROLS = Controls(1e-6, 1e-6, Steps.PLAIN, False)
PATH = LoadPath(np.zeros(1), np.ones(1))


def arch(cells: int, load: float) -> NonlinearCase:
    case = shallow_arch("hex8", (cells, 1, 1), 12.0)
    return replace(case, model=replace(case.model, forces=load / 12.0 * case.model.forces))


def prepared(case: NonlinearCase, method: str) -> tuple[Equation, TangentSolver]:
    formulation = resolve_formulation(case.model, None)
    equation = Equation(case.model, element_responses(case.model, formulation))
    options = Options(method, None, "numpy", 1e-6, None, None, None, formulation, Clock())
    return equation, TangentSolver(equation, options)


def followed(case: NonlinearCase, method: str, length: float, most: float) -> list[Equilibrium]:
    """Points up to where the crown has moved by ``most``."""
    equation, solver = prepared(case, method)
    points = []
    start = Equilibrium(np.zeros(case.model.mesh.points.shape), (), 0.0)
    for point in follow_path(equation, solver, PATH, start, length, CONTROLS):
        points.append(point)
        if case.values(point.u)[0] > most:
            break
    return points


@pytest.mark.parametrize("method", ["direct", pytest.param("multigrid", marks=pytest.mark.slow)])
def test_both_branches_of_an_arch(method: str) -> None:
    case = arch(60, 40.0)
    points = followed(case, method, 5.0, 8.5)
    ways = np.array([case.values(point.u)[0] for point in points])
    loads = 40.0 * np.array([point.share for point in points])
    strip, half_angle = arch_strip()
    fine = np.linspace(0.05, 10.0, 60)
    exact = CubicSpline(fine, clamped_arch(strip, 5.0, half_angle, fine))(ways)
    assert np.abs(loads - exact).max() <= 0.01 * exact.max()
    # it went up, down and up again
    turns = np.flatnonzero(np.diff(np.sign(np.diff(loads))))
    assert len(turns) == 2 and loads[turns[0] + 1] == pytest.approx(9.06, rel=0.02)
    assert loads[turns[1] + 1] == pytest.approx(4.03, rel=0.05)
    definite = [point.iterations[-1].definite for point in points]
    assert definite[-1] and not all(definite)


def test_points_lie_as_far_apart_as_they_are_asked_to_at_first() -> None:
    case = arch(20, 10.0)
    first = followed(case, "direct", 2.0, 0.01)[0]
    assert np.linalg.norm(first.u) == pytest.approx(2.0, rel=1e-6)


def test_a_path_is_between_its_ends() -> None:
    path = LoadPath(np.array([1.0, 0.0]), np.array([2.0, -4.0]))
    np.testing.assert_array_equal(path.factors(0.25), [1.25, -1.0])


def test_the_first_crossing_of_a_load_counts_and_is_not_overshot() -> None:
    """At 8.8 an arch may be where it comes first, just below its limit of 9.1, or beyond that."""
    case = arch(20, 8.8)
    equation, solver = prepared(case, "direct")
    committed: list[float] = []
    equation.commit = lambda u, _: committed.append(case.values(u)[0])  # type: ignore[method-assign]
    start = Equilibrium(np.zeros(case.model.mesh.points.shape), (), 0.0)
    *before, last = follow_path(equation, solver, PATH, start, 4.0, CONTROLS)
    assert last.share >= 1.0 > max(point.share for point in before) and len(committed) == len(
        before
    )
    end = equilibrium(equation, solver, last.u, np.ones(1), CONTROLS)
    assert max(committed) < case.values(end.u)[0] < 1.6


def test_a_path_that_is_too_long_is_given_up(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(arc_length, "_MOST_STEPS", 3)
    with pytest.raises(NotConverged, match="by arc length: got 3 steps; expected fewer"):
        followed(arch(20, 10.0), "direct", 1e-3, 9.0)


def test_a_path_that_cannot_get_past_a_place_is_given_up(monkeypatch: pytest.MonkeyPatch) -> None:
    """Steps that still fit before it are half as long each time, and would go on for ever."""
    case, tried, real = arch(20, 10.0), [], arc_length._Branch.step

    def step(self, u, *rest):  # type: ignore[no-untyped-def]
        tried.append(u)
        du, *found = real(self, u, *rest)
        if case.values(u + du)[0] > 0.2:
            raise NotConverged("too far")
        return du, *found

    monkeypatch.setattr(arc_length._Branch, "step", step)
    with pytest.raises(NotConverged, match="by arc length: too far"):
        followed(case, "direct", 2.0, 9.0)
    assert case.values(tried[-1])[0] == pytest.approx(0.2, rel=1e-2) and len(tried) < 50


def test_steps_that_fail_are_shorter_the_next_time() -> None:
    """A first step many times as long as the body can't be made."""
    case = arch(20, 1e7)
    equation, solver = prepared(case, "direct")
    start = Equilibrium(np.zeros(case.model.mesh.points.shape), (), 0.0)
    point = next(follow_path(equation, solver, PATH, start, 1e4, CONTROLS))
    distance = float(np.linalg.norm(point.u))
    assert distance < 1e4 and np.log2(1e4 / distance) == pytest.approx(
        round(np.log2(1e4 / distance)), abs=1e-5
    )


def test_a_path_along_which_no_load_grows_is_none() -> None:
    case = arch(20, 1.0)
    equation, solver = prepared(case, "direct")
    still = LoadPath(np.ones(1), np.ones(1))
    start = Equilibrium(np.zeros(case.model.mesh.points.shape), (), 0.0)
    with pytest.raises(NotConverged, match="by arc length: got a step in which no load grows"):
        next(follow_path(equation, solver, still, start, 1.0, CONTROLS))


def test_no_root_no_step() -> None:
    residual, load = np.array([[2.0, 0.0, 0.0]]), np.array([[0.0, 1.0, 0.0]])
    du = np.zeros((1, 3))
    # 1 along the residual's answer leaves sqrt(3) of a length of 2, forwards
    assert arc_length._root(load, 0.5 * residual, load, 2.0) == pytest.approx(np.sqrt(3.0) - 1.0)
    with pytest.raises(NotConverged, match="no load factor at this distance"):
        arc_length._root(du, residual, load, 1.0)
