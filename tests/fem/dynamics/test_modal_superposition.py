"""Modal superposition: single modes against closed forms, bodies against dense algebra."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import numpy.typing as npt
import pytest
from scipy.integrate import solve_ivp

import gpusim as gs
from gpusim.fem.dynamics.modal_superposition import ModalCoordinates
from tests.support.vibrating_bar import dense_modes, greatest, step_response, vibrating_bar

Float = npt.NDArray[np.float64]


def coordinates(
    angular: float, damping: float, record: gs.Record, begin: tuple[float, float] = (0.0, 0.0)
) -> ModalCoordinates:
    own = np.array([angular]), np.array([damping])
    return ModalCoordinates(*own, record, *np.array(begin)[:, None])


def ramp_response(angular: float, ratio: float, t: Float) -> Float:
    """From rest, p = t (Clough & Penzien): of a mode with less than critical damping."""
    quick = angular * np.sqrt(1.0 - ratio**2)
    fading = np.exp(-ratio * angular * t)
    swing = 2.0 * ratio / angular * np.cos(quick * t)
    swing = swing + (2.0 * ratio**2 - 1.0) / quick * np.sin(quick * t)
    return (t - 2.0 * ratio / angular + fading * swing) / angular**2


@pytest.mark.parametrize("angular", [1.0, 40.0, 1e4])
@pytest.mark.parametrize("ratio", [0.0, 0.03, 0.9])
def test_ramps_and_free_decay_are_those_of_closed_forms(angular: float, ratio: float) -> None:
    t = np.append(0.0, np.sort(np.random.default_rng(1).uniform(0.0, 3.0, 40)))
    ramp = coordinates(angular, 2.0 * ratio * angular, gs.Record([0.0, 3.0], [0.0, 3.0]))
    expected = ramp_response(angular, ratio, t)
    assert greatest(ramp.at(t).amplitude[:, 0] - expected, expected) <= 1e-9
    still = gs.Record([0.0, 3.0], [0.0, 0.0])
    free = coordinates(angular, 2.0 * ratio * angular, still, (0.2, 0.5))
    quick = angular * np.sqrt(1.0 - ratio**2)
    swing = 0.2 * np.cos(quick * t) + (0.5 + 0.2 * ratio * angular) / quick * np.sin(quick * t)
    expected = np.exp(-ratio * angular * t) * swing
    assert greatest(free.at(t).amplitude[:, 0] - expected, expected) <= 1e-9


def test_a_rigid_body_mode_flies_and_drags() -> None:
    t, record = np.linspace(0.0, 3.0, 13), gs.Record([0.0, 3.0], [2.0, 5.0])
    states = coordinates(0.0, 0.0, record, (0.1, 0.2)).at(t)
    expected = 0.1 + 0.2 * t + t**2 + t**3 / 6.0
    assert np.allclose(states.amplitude[:, 0], expected, rtol=1e-13, atol=0.0)
    # against a drag it comes to p / c
    dragged = coordinates(0.0, 50.0, gs.Record([0.0, 3.0], [2.0, 2.0])).at(t)
    expected = 2.0 / 50.0 * (t + np.expm1(-50.0 * t) / 50.0)
    assert np.allclose(dragged.amplitude[:, 0], expected, rtol=1e-12, atol=0.0)
    assert np.allclose(dragged.work, 2.0 * expected, rtol=1e-12, atol=0.0)


@pytest.mark.parametrize(("angular", "damping"), [(10.0, 0.5), (10.0, 20.0), (10.0, 90.0)])
def test_states_and_work_under_a_record_with_bends(angular: float, damping: float) -> None:
    record = gs.Record([0.0, 0.3, 0.5, 2.0], [1.0, 2.0, -1.0, 0.0])
    found, t = coordinates(angular, damping, record, (0.1, -0.3)), np.linspace(0.0, 2.0, 41)

    def slope(time: float, y: Float) -> list[float]:
        push = float(record.at(np.array([time]))[0, 0])
        return [y[1], push - damping * y[1] - angular**2 * y[0], push * y[1]]

    y, states = np.array([0.1, -0.3, 0.0]), found.at(t)
    bends = np.union1d(t, record.times)
    expected = [y]
    for begin, end in pairwise(bends):
        y = solve_ivp(slope, (begin, end), y, "DOP853", rtol=1e-12, atol=1e-14).y[:, -1]
        expected.append(y)
    every = np.array(expected)[np.isin(bends, t)]
    got = np.stack([states.amplitude[:, 0], states.rate[:, 0], states.work], axis=1)
    assert np.abs(got - every).max() <= 1e-9
    force = record.at(t)[:, 0] - damping * every[:, 1] - angular**2 * every[:, 0]
    assert np.abs(states.acceleration[:, 0] - force).max() <= 1e-7


def test_a_body_follows_the_closed_form_of_its_modes() -> None:
    model = vibrating_bar()
    angular, shapes = dense_modes(model)
    times = np.linspace(1.0, 9.0, 17)
    history = gs.transient(model, times=times, loads=np.full((17, 2), [1.0, -2.0]), count=36)
    expected = step_response(model, [1.0, -2.0], times)
    assert greatest(history.u - expected, expected) <= 1e-9
    assert history.energy.drift <= 1e-9
    # at any instant
    u, v = history.at(1.2345)
    early, late = (
        step_response(model, [1.0, -2.0], np.array([1.0, t]))[1] for t in (1.2345, 1.2346)
    )
    assert greatest(u - early, early) <= 1e-9
    assert greatest(v - (late - early) / 1e-4, v) <= 1e-2
    assert history.modal is not None and len(history.modal.shapes) == len(shapes)
    assert greatest(history.modal.modes.angular - angular, angular) <= 1e-9


def test_what_modes_lack_of_static_answers_is_added_and_said() -> None:
    model = vibrating_bar()
    static = gs.solve(model, tolerance=1e-9).u
    times = np.linspace(0.0, 400.0, 41)
    slow = np.outer(times / 400.0, [0.0, 1.0])
    # pulled so slowly that nothing swings, while the six modes here hardly have it
    history = gs.transient(model, times=times, loads=slow, count=6)
    assert greatest(history.u[-1] - static[1], static[1]) <= 1e-3
    assert any("static answer" in warning for warning in history.warnings)
    assert history.energy.drift <= 1e-9
    bare = np.tensordot(history.modal.coordinates(times)[0][:, :6], history.modal.shapes[:6], 1)  # type: ignore[union-attr]
    assert greatest(bare[-1] - static[1], static[1]) > 0.01


def test_loads_that_do_not_act_are_not_looked_at() -> None:
    along = gs.Record([0.0, 1.0], [[1.0, 0.0, 0.0]] * 2)
    history = gs.transient(
        vibrating_bar(), times=[0.0, 1.0], loads=np.zeros((2, 2)), base=along, count=2
    )
    lacking, gone = history.warnings
    assert "static answer" in lacking and "goes away along x, by 0.5 in all" in gone
    assert history.modal is not None and len(history.modal.shapes) == 3


def test_a_static_state_stays_and_what_modes_lack_of_it_is_said() -> None:
    model = vibrating_bar()
    one = replace(model, forces=model.load_cases[0])
    static, times = gs.solve(one, tolerance=1e-9), np.linspace(0.0, 5.0, 6)
    stays = gs.transient(one, times=times, initial=static, count=4)
    assert greatest(stays.u - static.u, static.u) <= 1e-6
    assert any("initial displacement" in warning for warning in stays.warnings)
    released = gs.transient(one, times=times, loads=0.0 * times, initial=static, count=36)
    expected = static.u - step_response(model, [1.0, 0.0], times)
    assert greatest(released.u - expected, expected) <= 1e-6
    assert released.warnings == ()


def test_a_free_body_flies_and_swings() -> None:
    model = vibrating_bar(fixed=False)
    angular, shapes = dense_modes(model)
    times, push = np.linspace(0.0, 2.0, 5), model.load_cases[1]
    history = gs.transient(model, times=times, loads=np.full((5, 2), [0.0, 1.0]), count=48)
    force, elastic = np.tensordot(shapes, push, axes=2), angular > 0.0
    amplitudes = 0.5 * force * times[:, None] ** 2
    quick = angular[elastic]
    amplitudes[:, elastic] = force[elastic] / quick**2 * (1.0 - np.cos(np.outer(times, quick)))
    expected = np.tensordot(amplitudes, shapes, axes=1)
    assert greatest(history.u - expected, expected) <= 1e-8
    few = gs.transient(model, times=times, loads=np.full((5, 2), [0.0, 1.0]), count=16)
    assert greatest(few.u - expected, expected) <= 2e-2


def test_damping_of_each_kind() -> None:
    model = vibrating_bar()
    angular, _ = dense_modes(model)
    times = np.linspace(0.0, 30.0, 31)
    two = [0.03, 0.031]
    stiff = 2.0 * (two[1] * angular[1] - two[0] * angular[0]) / (angular[1] ** 2 - angular[0] ** 2)
    rayleigh = gs.Rayleigh(2.0 * two[0] * angular[0] - stiff * angular[0] ** 2, stiff)
    loads = np.full((31, 2), [1.0, 0.0])
    options = {"times": times, "loads": loads, "count": 2}
    histories = [
        gs.transient(model, damping=one, **options)  # type: ignore[arg-type]
        for one in (rayleigh, gs.ModalDamping(two))
    ]
    assert greatest(histories[0].u - np.asarray(histories[1].u), histories[0].u) <= 1e-7
    energy = histories[1].energy
    assert energy.drift <= 1e-12 and (np.diff(energy.dissipated) > 0.0).all()


def test_many_modes_of_a_free_body_leave_a_static_answer() -> None:
    """Rounding of the products with modes must not move the body as a whole."""
    bar = gs.mesh.box(size=(1, 0.05, 0.1), divisions=(8, 1, 2))
    end, forces = np.isclose(bar.points[:, 0], 1.0), np.zeros((2, *bar.points.shape))
    forces[0, end, 2], forces[1, ~end, 0] = 100.0, 3.0
    model = gs.Model(bar, gs.Isotropic(210e9, 0.3, density=7850.0), None, forces)
    times = np.linspace(0.0, 0.01, 21)
    loads = np.stack([np.sin(300.0 * times), np.cos(200.0 * times)], axis=1)
    few, many = (gs.transient(model, times=times, loads=loads, count=n) for n in (40, 100))
    assert greatest(np.asarray(many.u) - np.asarray(few.u), many.u) <= 1e-6
