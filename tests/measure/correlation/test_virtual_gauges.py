"""Extensometers and strain gauges of displacements in closed form."""

from __future__ import annotations

import numpy as np
import pytest

from gpusim.errors import InputError
from gpusim.measure import extensometer, gauge

TURN = np.array([[0.6, -0.8, 0.0], [0.8, 0.6, 0.0], [0.0, 0.0, 1.0]])
STRETCH = np.array([[1.02, 0.003, 0.0], [0.003, 0.99, 0.0], [0.0, 0.0, 1.0]])
PIXELS = np.random.default_rng(3).uniform(20.0, 90.0, (17, 2))


def test_a_length_after_a_stretch_and_a_turn() -> None:
    ends = np.array([[3.0, 4.0, 1.0], [53.0, 4.0, 1.0]])
    moved = ends @ (TURN @ np.diag([1.02, 0.9, 1.0])).T + [7.0, -2.0, 5.0] - ends
    assert extensometer(ends, moved) == pytest.approx((51.0, 1.0, 0.02), rel=1e-12)


def test_a_small_strain_far_from_the_origin_keeps_its_digits() -> None:
    ends = np.array([[1e6, 0.0], [1e6 + 64.0, 0.0]])
    moved = np.array([[0.0, 0.0], [64e-9, 0.0]])
    assert extensometer(ends, moved)[2] == pytest.approx(1e-9, rel=1e-9)


@pytest.mark.parametrize("kind", ["green-lagrange", "hencky"])
def test_strain_of_a_tilted_patch_in_its_own_axes(kind: str) -> None:
    # a plane in space whose x lies as the picture's rows do
    axes = np.array([[0.8, 0.0, 0.6], [0.0, 1.0, 0.0]])
    places = 0.2 * PIXELS @ axes + [5.0, 1.0, 900.0]
    now = 0.2 * PIXELS @ STRETCH[:2, :2].T @ axes @ TURN.T
    tensor = gauge(PIXELS, places, now - places, kind)
    C = STRETCH[:2, :2] @ STRETCH[:2, :2]
    values, vectors = np.linalg.eigh(C)
    exact = 0.5 * (C - np.eye(2))
    if kind == "hencky":
        exact = (vectors * (0.5 * np.log(values))) @ vectors.T
    assert tensor == pytest.approx(exact, abs=1e-12)
    # in px, without a scale, the same
    inside = PIXELS @ (STRETCH[:2, :2] - np.eye(2)).T
    assert gauge(PIXELS, PIXELS, inside, kind) == pytest.approx(exact, abs=1e-12)


def test_lost_subsets_do_not_count() -> None:
    moved = PIXELS * [0.01, 0.0]
    moved[4:] = np.nan
    assert gauge(PIXELS, PIXELS, moved)[0, 0] == pytest.approx(0.01 + 0.5e-4, rel=1e-9)
    moved[2:] = np.nan
    assert np.isnan(gauge(PIXELS, PIXELS, moved)).all()
    line = np.column_stack([np.arange(9.0), np.full(9, 4.0)])
    assert np.isnan(gauge(line, line, 0.01 * line)).all()


def test_another_strain_is_refused() -> None:
    with pytest.raises(InputError, match="kind"):
        gauge(PIXELS, PIXELS, 0.0 * PIXELS, "small")


def test_shapes_that_do_not_fit_are_refused() -> None:
    with pytest.raises(InputError, match="ends; got shapes"):
        extensometer(np.zeros((3, 2)), np.zeros((3, 2)))
    with pytest.raises(InputError, match="gauge; got shapes"):
        gauge(PIXELS, PIXELS[:5], PIXELS[:5])
