"""Newmark, HHT-alpha and generalized-alpha against dense algebra, theory and exact motions."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import numpy.typing as npt
import pytest
from scipy.linalg import solve

import gpusim as gs
from gpusim.errors import NotConverged
from gpusim.fem.dynamics.initial_value_problem import InitialValueProblem
from gpusim.fem.dynamics.time_integration import METHODS, LinearMotion, Scheme
from gpusim.fem.linear.solve_plan import Clock, Options
from gpusim.fem.model.model import resolve_formulation
from gpusim.fem.model.record import Record
from tests.support.vibrating_bar import (
    dense_modes,
    greatest,
    matrices,
    step_response,
    vibrating_bar,
)

Float = npt.NDArray[np.float64]
RADIUS = 0.8
DAMPING = gs.Rayleigh(mass=0.3, stiffness=0.004)


def textbook(method: str) -> tuple[float, float, float, float]:
    """alpha_m, alpha_f, beta, gamma: Newmark's, Hilber-Hughes-Taylor's with alpha < 0, and
    Chung-Hulbert's."""
    if method == "newmark":
        return 0.0, 0.0, 0.25, 0.5
    if method == "hht":
        alpha = (RADIUS - 1.0) / (RADIUS + 1.0)
        return 0.0, -alpha, 0.25 * (1.0 - alpha) ** 2, 0.5 - alpha
    alpha_m, alpha_f = (2.0 * RADIUS - 1.0) / (RADIUS + 1.0), RADIUS / (RADIUS + 1.0)
    gamma = 0.5 - alpha_m + alpha_f
    return alpha_m, alpha_f, 0.25 * (gamma + 0.5) ** 2, gamma


def dense_steps(
    method: str, k: Float, c: Float, m: Float, push: Float, step: float, begin: tuple[Float, Float]
) -> Float:
    """(T,n) of M a + C v + K u = ``push`` (T,n), each step solved for its last acceleration."""
    alpha_m, alpha_f, beta, gamma = textbook(method)
    u, v = begin
    a = solve(m, push[0] - k @ u - c @ v)
    history = [u]
    share = 1.0 - alpha_f
    whole = (1.0 - alpha_m) * m + share * gamma * step * c + share * beta * step**2 * k
    for before, after in pairwise(push):
        far = u + step * v + step**2 * (0.5 - beta) * a
        quick = v + step * (1.0 - gamma) * a
        force = share * after + alpha_f * before - alpha_m * m @ a
        force -= c @ (share * quick + alpha_f * v) + k @ (share * far + alpha_f * u)
        a_new = solve(whole, force)
        u, v, a = far + beta * step**2 * a_new, quick + gamma * step * a_new, a_new
        history.append(u)
    return np.array(history)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("damping", [None, DAMPING])
def test_steps_are_those_of_dense_algebra(method: str, damping: gs.Rayleigh | None) -> None:
    model = vibrating_bar()
    k, m, free = matrices(model)
    c = 0.0 * k if damping is None else damping.mass * m + damping.stiffness * k
    times = np.linspace(0.0, 2.0, 9)
    factors = np.random.default_rng(4).standard_normal((9, 2))
    shape = model.mesh.points.shape
    begin = np.where(model.fixed, 0.0, np.random.default_rng(5).standard_normal((2, *shape)))
    push = np.tensordot(factors, model.load_cases.reshape(2, -1)[:, free], axes=1)
    expected = dense_steps(method, k, c, m, push, 0.25, tuple(begin.reshape(2, -1)[:, free]))  # type: ignore[arg-type]
    history = gs.transient(
        model, times=times, loads=factors, method=method, step=0.25, damping=damping,
        initial=tuple(begin), spectral_radius=RADIUS,
    )  # fmt: skip
    got = np.asarray(history.u).reshape(9, -1)[:, free]
    assert greatest(got - expected, expected) <= 1e-10


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("damping", [None, DAMPING])
def test_the_order_is_two(method: str, damping: gs.Rayleigh | None) -> None:
    model, times = vibrating_bar((2, 1, 1)), np.linspace(0.0, 4.0, 5)
    # loads that begin without a jump, so that quick modes hardly swing, and bend where steps end
    bends = np.linspace(0.0, 4.0, 101)
    loads = gs.Record(bends, np.outer(1.0 - np.cos(3.0 * bends), [1.0, 0.5]))
    exact = gs.transient(model, times=times, loads=loads, damping=damping, count=24)
    errors = []
    for step in (0.04, 0.02, 0.01):
        found = gs.transient(
            model, times=times, loads=loads, method=method, damping=damping, step=step,
            spectral_radius=RADIUS,
        )  # fmt: skip
        errors.append(greatest(found.u - np.asarray(exact.u), exact.u))
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert (np.abs(orders - 2.0) <= [0.25, 0.1]).all(), (errors, orders)


def test_free_decay_and_step_load_to_a_millionth() -> None:
    model = vibrating_bar((1, 1, 1))
    angular, shapes = dense_modes(model)
    times, still = np.linspace(0.0, 0.5 * np.pi / angular[0], 5), np.zeros_like(shapes[0])
    free = gs.transient(
        model, times=times, loads=np.zeros((5, 2)), method="newmark",
        step=float(times[-1]) / 1000, initial=(shapes[0], still),
    )  # fmt: skip
    expected = np.cos(angular[0] * times)[:, None, None] * shapes[0]
    assert greatest(free.u - expected, expected) <= 1e-6
    loads = np.full((5, 2), [1.0, 0.0])
    loaded = gs.transient(
        model, times=times, loads=loads, method="newmark", step=float(times[-1]) / 2000
    )
    expected = step_response(model, [1.0, 0.0], times)
    assert greatest(loaded.u - expected, expected) <= 1e-6


def first_mode(
    method: str, cycles: int, per_cycle: int, **options: object
) -> tuple[gs.History, Float]:
    """Free swinging in the first mode, and its amplitudes."""
    model = vibrating_bar((1, 1, 1))
    angular, shapes = dense_modes(model)
    times = np.linspace(0.0, 2.0 * np.pi * cycles / angular[0], cycles * per_cycle + 1)
    history = gs.transient(
        model, times=times, loads=np.zeros((len(times), 2)), method=method,
        step=float(times[1]), initial=(shapes[0], np.zeros_like(shapes[0])), **options,
    )  # type: ignore[arg-type]  # fmt: skip
    mass = gs.fem.mass_matrix(model)
    flat = np.asarray(history.u).reshape(len(times), -1)
    return history, flat @ (mass @ shapes[0].ravel())


def test_newmark_keeps_the_energy_of_100_cycles() -> None:
    history, _ = first_mode("newmark", 100, 20)
    assert history.energy.drift <= 1e-10
    assert history.energy.strain.max() == pytest.approx(history.energy.strain[0], rel=1e-10)


@pytest.mark.parametrize("method", METHODS)
def test_algorithmic_damping_is_that_of_theory(method: str) -> None:
    alpha_m, alpha_f, beta, gamma = textbook(method)
    _, amplitude = first_mode(method, 5, 12, spectral_radius=RADIUS)
    # the amplification of (u, h v, h^2 a) in a step of a mode with frequency x / h
    square = (2.0 * np.pi / 12) ** 2
    end = np.array(
        [[1.0, 0.0, -beta], [0.0, 1.0, -gamma], [(1.0 - alpha_f) * square, 0.0, 1.0 - alpha_m]]
    )
    begin = np.array(
        [[1.0, 1.0, 0.5 - beta], [0.0, 1.0, 1.0 - gamma], [-alpha_f * square, 0.0, -alpha_m]]
    )
    states, state = [], np.array([1.0, 0.0, -square])
    for _ in amplitude:
        states.append(state[0])
        state = solve(end, begin @ state)
    assert np.abs(amplitude - states).max() <= 1e-9
    radius = np.abs(np.linalg.eigvals(solve(end, begin))).max()
    lost = 1.0 - radius
    assert lost <= 1e-12 if method == "newmark" else 1e-5 < lost < 1e-1
    # of a mode that is much too quick for the step
    end[2, 0], begin[2, 0] = (1.0 - alpha_f) * 1e12, -alpha_f * 1e12
    radius = np.abs(np.linalg.eigvals(solve(end, begin))).max()
    assert radius == pytest.approx(1.0 if method == "newmark" else RADIUS, abs=1e-2)


def motion(model: gs.Model, solver: str, tolerance: float) -> LinearMotion:
    names, shape = resolve_formulation(model, None), model.mesh.points.shape
    factors = Record([0.0, 9.0], np.ones((2, len(model.load_cases))))
    problem = InitialValueProblem(model, names, "exact", factors, np.zeros(shape), np.zeros(shape))
    options = Options(solver, None, "numpy", tolerance, None, None, None, names, Clock())
    return LinearMotion(problem, Scheme.named("newmark", 1.0), gs.Rayleigh(), options)


def test_iterations_end_at_the_tolerance() -> None:
    model = vibrating_bar((12, 4, 4))
    ends = {}
    for solver, tolerance in (("direct", 1e-5), ("multigrid", 1e-4), ("multigrid", 1e-8)):
        moving = motion(model, solver, tolerance)
        state = moving.begin(0.0)
        for _ in range(12):
            state = moving.advance(state, 0.1)
        ends[solver, tolerance] = state.u
        assert ("iterations" in moving.message) == (solver == "multigrid")
    exact = ends["direct", 1e-5]
    assert greatest(ends["multigrid", 1e-8] - exact, exact) <= 1e-6
    assert 1e-8 < greatest(ends["multigrid", 1e-4] - exact, exact) <= 1e-2


def test_adaptive_steps_have_the_error_that_is_asked_for() -> None:
    model = vibrating_bar()
    times = np.linspace(0.0, 8.0, 9)
    # nearly still at first, then a blow
    blow = gs.Record([0.0, 4.0, 4.4, 4.8, 8.0], np.outer([0.0, 0.0, 30.0, 0.0, 0.0], [1.0, 0.0]))
    exact = gs.transient(model, times=times, loads=blow, count=36)
    errors, counts = [], []
    for tolerance in (1e-3, 1e-4, 1e-5):
        steps: list[float] = []
        found = gs.transient(
            model, times=times, loads=blow, method="generalized-alpha", step="adaptive",
            tolerance=tolerance, progress=lambda _, time, into=steps: into.append(time),
        )  # fmt: skip
        errors.append(greatest(found.u - np.asarray(exact.u), exact.u))
        counts.append(len(steps))
    lengths = np.diff(steps)
    assert lengths.max() > 3.9 * lengths.min()
    assert errors[0] > errors[1] > errors[2] and errors[2] <= 2e-3, errors
    assert counts[0] < counts[1] < counts[2], counts


def test_a_step_too_long_is_said() -> None:
    coarse, fine = (first_mode("newmark", 2, per_cycle)[0] for per_cycle in (8, 64))
    error, lag = coarse.warnings
    assert "of the greatest displacement off" in error
    assert "a shorter step (step_s of scenes" in error
    assert "of a cycle at the end" in lag
    assert fine.warnings == ()


def test_a_singular_mass_is_refused() -> None:
    mesh = gs.mesh.split(gs.mesh.box((1.0, 1.0, 1.0), (1, 1, 1)), "tet4")
    model = gs.Model(mesh, gs.Isotropic(1.0, 0.3, density=1.0), forces=np.ones(mesh.points.shape))
    with pytest.raises(NotConverged, match="mass"):
        gs.transient(model, times=[0.0, 1.0], method="newmark", mass="calculix")


def test_constraints_move_with_what_they_follow() -> None:
    whole = vibrating_bar((2, 1, 1))
    mesh = whole.mesh
    # the bar cut in two at x = 1.5, and tied
    cut = np.flatnonzero(mesh.points[:, 0] == 1.5)
    twin = np.arange(mesh.node_count)
    twin[cut] = mesh.node_count + np.arange(len(cut))
    cells = mesh.cells["hex8"].copy()
    right = mesh.points[cells].mean(axis=1)[:, 0] > 1.5
    cells[right] = twin[cells[right]]
    points = np.concatenate([mesh.points, mesh.points[cut]])
    terms = [
        ([(int(twin[node]), axis, 1.0), (int(node), axis, -1.0)], 0.0)
        for node in cut
        for axis in "xyz"
    ]
    two = gs.Mesh(points, {"hex8": cells})
    both = np.append(np.arange(mesh.node_count), cut)
    assert whole.fixed is not None
    forces = np.concatenate([whole.load_cases, np.zeros((2, len(cut), 3))], axis=1)
    tied = gs.Model(
        two, whole.materials, whole.fixed[both], forces, constraints=[gs.fem.equations(two, terms)]
    )
    times = np.linspace(0.0, 3.0, 4)
    for options in ({"method": "newmark", "step": 0.05, "damping": DAMPING}, {"count": 8}):
        one, other = (
            gs.transient(model, times=times, loads=np.ones((4, 2)), **options)  # type: ignore[arg-type]
            for model in (whole, replace(tied))
        )
        assert greatest(np.asarray(other.u) - np.asarray(one.u)[:, both], one.u) <= 1e-7
        assert other.energy.external_work[-1] == pytest.approx(one.energy.external_work[-1])
