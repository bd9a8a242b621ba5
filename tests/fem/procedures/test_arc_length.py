"""Arc length against the path of an arch that is integrated, and where it gives up."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

from gpusim.errors import NotConverged
from gpusim.fem.assembly.element_responses import element_responses
from gpusim.fem.assembly.equation import Equation
from gpusim.fem.linear.solve_plan import Clock, Options
from gpusim.fem.linear.tangent_solver import TangentSolver
from gpusim.fem.model.model import resolve_formulation
from gpusim.fem.procedures import arc_length
from gpusim.fem.procedures.arc_length import LoadPath, PathPoint, follow_path
from gpusim.fem.procedures.newton import Controls
from tests.support.elastica import clamped_arch
from tests.support.nonlinear_cases import NonlinearCase, arch_strip, shallow_arch

Float = npt.NDArray[np.float64]

CONTROLS = Controls(1e-6, 1e-6, False, False)
PATH = LoadPath(np.zeros(1), np.ones(1))


def prepared(case: NonlinearCase, method: str) -> tuple[Equation, TangentSolver]:
    formulation = resolve_formulation(case.model, None)
    equation = Equation(case.model, element_responses(case.model, formulation))
    options = Options(method, None, "numpy", 1e-6, None, None, None, formulation, Clock())
    return equation, TangentSolver(equation, options)


def followed(case: NonlinearCase, method: str, length: float, most: float) -> list[PathPoint]:
    """Points up to where the crown has moved by ``most``."""
    equation, solver = prepared(case, method)
    points = []
    start = PathPoint(0.0, np.zeros(case.model.mesh.points.shape), ())
    for point in follow_path(equation, solver, PATH, start, length, CONTROLS):
        points.append(point)
        if case.values(point.u)[0] > most:
            break
    return points


@pytest.mark.parametrize("method", ["direct", "multigrid"])
def test_both_branches_of_an_arch(method: str) -> None:
    case = shallow_arch("hex8", (60, 1, 1), 10.0)
    points = followed(case, method, 5.0, 9.0)
    ways = np.array([case.values(point.u)[0] for point in points])
    loads = 10.0 * np.array([point.s for point in points])
    strip, half_angle = arch_strip()
    exact = clamped_arch(strip, 5.0, half_angle, ways)
    assert np.abs(loads - exact).max() <= 0.01 * exact.max()
    # it went up, down and up again
    turns = np.flatnonzero(np.diff(np.sign(np.diff(loads))))
    assert len(turns) == 2 and loads[turns[0] + 1] == pytest.approx(9.06, rel=0.02)
    assert loads[turns[1] + 1] == pytest.approx(4.03, rel=0.05)
    definite = [point.iterations[-1].definite for point in points]
    assert definite[-1] and not all(definite)


def test_points_lie_as_far_apart_as_they_are_asked_to_at_first() -> None:
    case = shallow_arch("hex8", (20, 1, 1), 10.0)
    first = followed(case, "direct", 2.0, 0.01)[0]
    assert np.linalg.norm(first.u) == pytest.approx(2.0, rel=1e-6)


def test_a_path_is_between_its_ends() -> None:
    path = LoadPath(np.array([1.0, 0.0]), np.array([2.0, -4.0]))
    np.testing.assert_array_equal(path.factors(0.25), [1.25, -1.0])


def test_a_path_that_is_too_long_is_given_up(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(arc_length, "_MOST_STEPS", 3)
    with pytest.raises(NotConverged, match="by arc length: got 3 steps; expected fewer"):
        followed(shallow_arch("hex8", (20, 1, 1), 10.0), "direct", 1e-3, 9.0)


def test_steps_that_fail_are_shorter_the_next_time() -> None:
    """A first step many times as long as the body can't be made."""
    case = shallow_arch("hex8", (20, 1, 1), 10.0)
    equation, solver = prepared(case, "direct")
    start = PathPoint(0.0, np.zeros(case.model.mesh.points.shape), ())
    point = next(follow_path(equation, solver, PATH, start, 1e4, CONTROLS))
    distance = float(np.linalg.norm(point.u))
    assert distance < 1e4 and np.log2(1e4 / distance) == pytest.approx(
        round(np.log2(1e4 / distance)), abs=1e-5
    )


def test_no_root_no_step() -> None:
    residual, load = np.array([[2.0, 0.0, 0.0]]), np.array([[0.0, 1.0, 0.0]])
    du = np.zeros((1, 3))
    # 1 along the residual's answer leaves sqrt(3) of a length of 2, forwards
    assert arc_length._root(load, 0.5 * residual, load, 2.0) == pytest.approx(np.sqrt(3.0) - 1.0)
    with pytest.raises(NotConverged, match="no load factor at this distance"):
        arc_length._root(du, residual, load, 1.0)
