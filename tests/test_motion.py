"""Motions that are known at any instant: their displacement, and their velocity as its slope."""

from __future__ import annotations

import numpy as np
import pytest

from gpusim.motion import Course, Oscillation, Transient, Vibration

RNG = np.random.default_rng(7)
STEP = 1e-5


def oscillation() -> Oscillation:
    amplitudes = RNG.normal(size=(2, 5, 3)) + 1j * RNG.normal(size=(2, 5, 3))
    return Oscillation((2, 5), amplitudes, np.array([3.0, 11.0]), RNG.normal(size=(5, 3)))


def polynomial(degree: int) -> tuple[Course, np.poly1d]:
    """A course through a polynomial of that degree, of two values."""
    poly = np.poly1d(RNG.normal(size=degree + 1))
    times = np.array([0.0, 0.3, 0.4, 1.0])
    values, rates, bends = (
        np.stack([one(times), -2.0 * one(times)], axis=1)
        for one in (poly, poly.deriv(), poly.deriv(2))
    )
    return Course(times, values, rates, bends if degree == 5 else None), poly


def slope(motion: Vibration, state: tuple[float, ...]) -> np.ndarray:
    before, after = (motion.displacement(motion.later(state, dt)) for dt in (-STEP, STEP))
    return (after - before) / (2.0 * STEP)


def test_an_oscillation_turns_about_where_it_rests() -> None:
    motion = oscillation()
    assert isinstance(motion, Vibration)
    for number, k in ((2, 0), (5, 1)):
        state = (float(number), 0.3)
        u = motion.rest + (motion.amplitudes[k] * np.exp(0.6j * np.pi)).real
        assert np.abs(motion.displacement(state) - u).max() <= 1e-14
        assert np.abs(motion.velocity(state) - slope(motion, state)).max() <= 1e-4
        period = 1.0 / motion.frequencies[k]
        again = motion.displacement(motion.later(state, period))
        assert np.abs(again - u).max() <= 1e-13


def test_nothing_moves_at_rest_or_by_rounding() -> None:
    motion = oscillation()
    assert np.array_equal(motion.displacement((0.0, 0.4)), motion.rest)
    assert not motion.velocity((0.0, 0.4)).any() and motion.later((0.0, 0.25), 9.0) == (0.0, 0.25)
    real = Oscillation((1,), motion.amplitudes[:1].real, np.array([1.0]), np.zeros((5, 3)))
    assert not real.displacement((1.0, 0.75)).any()
    assert motion.reactions((2.0, 0.0)).shape == (0, 3)


@pytest.mark.parametrize("degree", [3, 5])
def test_a_course_is_a_polynomial_between_its_instants(degree: int) -> None:
    course, poly = polynomial(degree)
    for time in (0.0, 0.11, 0.3, 0.35, 0.77, 1.0):
        value, rate = course.at(time)
        assert np.abs(value - [poly(time), -2.0 * poly(time)]).max() <= 1e-12
        assert np.abs(rate - [poly.deriv()(time), -2.0 * poly.deriv()(time)]).max() <= 1e-11


def test_a_course_rests_outside() -> None:
    course, _ = polynomial(5)
    for time, end in ((-0.1, 0), (1.1, -1)):
        value, rate = course.at(time)
        assert np.array_equal(value, course.values[end]) and not rate.any()
    single = Course(np.array([2.0]), np.ones((1, 4)), np.ones((1, 4)))
    assert np.array_equal(single.at(2.0)[1], np.ones(4)) and not single.at(2.1)[1].any()


def test_a_transient_is_of_shapes_or_of_nodes() -> None:
    course, poly = polynomial(5)
    shapes = RNG.normal(size=(2, 6, 3))
    motion = Transient(course, shapes)
    u = poly(0.5) * (shapes[0] - 2.0 * shapes[1])
    assert np.abs(motion.displacement((0.5,)) - u).max() <= 1e-12
    assert np.abs(motion.velocity((0.5,)) - slope(motion, (0.5,))).max() <= 1e-7
    at_nodes = Transient(Course(course.times, np.tensordot(course.values, shapes, 1),
                                np.tensordot(course.rates, shapes, 1),
                                np.tensordot(course.accelerations, shapes, 1)))  # fmt: skip
    assert np.abs(at_nodes.displacement((0.5,)) - u).max() <= 1e-12
