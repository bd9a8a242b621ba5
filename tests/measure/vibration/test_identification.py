"""Modes against systems whose frequencies, damping and shapes are known in closed form."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import gpusim as gs
from gpusim.arrays.array_types import Float
from gpusim.measure import PointSeries, identify_modes, mac
from tests.support.modal_response import chain_modes, free_decay, random_vibration

ANGULAR, SHAPES = chain_modes((2 * np.pi * 12) ** 2 * np.array([1.0, 1.3, 0.8]))
HERTZ = ANGULAR / (2 * np.pi)
DAMPING = np.array([0.01, 0.015, 0.02])
RATE = 100.0


def series(modal: Float, noise: float, seed: int = 7) -> PointSeries:
    """Three masses that move along a slope, from modal coordinates (T, 3)."""
    values = (modal @ SHAPES)[:, :, None] * np.array([0.8, 0.6])
    values += noise * values.std() * np.random.default_rng(seed).normal(size=values.shape)
    return PointSeries.of(np.arange(len(modal)) / RATE, [[0, 0], [1, 0], [2, 0]], values)


@cache
def long_record() -> PointSeries:
    return series(random_vibration(ANGULAR, DAMPING, RATE, 200_000, seed=3), noise=0.05)


@pytest.mark.parametrize("band", [None, (3.0, 30.0)])
@pytest.mark.parametrize("method", ["ssi", "fdd"])
def test_random_vibration(method: str, band: tuple[float, float] | None) -> None:
    modes = identify_modes(long_record(), method=method, band_Hz=band)
    np.testing.assert_allclose(modes.frequency_Hz, HERTZ, rtol=0.005)
    # of such records FDD's damping scatters by 8 % and SSI's by 4 %, which is all that is in them
    np.testing.assert_allclose(modes.damping, DAMPING, rtol=0.1 if method == "ssi" else 0.2)
    assert mac(modes.shapes[:, :, 0], SHAPES).diagonal().min() > 0.999
    assert mac(modes.shapes[:, :, 1], SHAPES).diagonal().min() > 0.999
    assert np.abs(modes.shapes).max(axis=(1, 2)).tolist() == [1, 1, 1]
    assert np.abs(modes.frequency_Hz - HERTZ).max() < 4 * modes.frequency_sigma_Hz.max()
    assert modes.complexity.max() < 0.01


def test_uncertainty_is_the_scatter_of_records() -> None:
    found = []
    for seed in range(24):
        modal = random_vibration(ANGULAR, DAMPING, RATE, 6000, seed)
        modes = identify_modes(series(modal, 0.05, seed), modes=3, band_Hz=(3, 30))
        # of the first shape the last mass moves most, in all records
        said = (*modes.frequency_sigma_Hz, *modes.damping_sigma, *modes.shape_sigma[0, :2, 0])
        found.append([(*modes.frequency_Hz, *modes.damping, *modes.shapes[0, :2, 0]), said])
    values = np.array(found)
    scatter, said = values.std(axis=0)[0], np.median(values, axis=0)[1]
    # twelve blocks tell a standard uncertainty to about a fifth, 24 records a scatter to a seventh
    assert (said / scatter).min() > 0.5
    assert (said / scatter).max() < 2.5
    assert np.abs(values[:, 0, :3].mean(axis=0) / HERTZ - 1).max() < 0.002


def test_free_decay() -> None:
    times = np.arange(700) / RATE
    modal = free_decay(ANGULAR, DAMPING, times, np.array([1.0, 0.3, 0.1]))
    exact = identify_modes(series(modal, 0.0), excitation="release")
    np.testing.assert_allclose(exact.frequency_Hz, HERTZ, rtol=1e-9)
    np.testing.assert_allclose(exact.damping, DAMPING, rtol=1e-7)
    assert mac(exact.shapes[:, :, 0], SHAPES).diagonal().min() > 1 - 1e-9
    noisy = identify_modes(series(modal, 0.02), excitation="release")
    np.testing.assert_allclose(noisy.frequency_Hz, HERTZ, rtol=0.005)
    np.testing.assert_allclose(noisy.damping, DAMPING, rtol=0.1)
    assert mac(noisy.shapes[:, :, 0], SHAPES).diagonal().min() > 0.99


def test_what_is_not_damped() -> None:
    modal = free_decay(ANGULAR, 0.0 * DAMPING, np.arange(700) / RATE, np.array([1.0, 0.3, 0.1]))
    for noise in (0.0, 0.02):
        modes = identify_modes(series(modal, noise), excitation="release")
        np.testing.assert_allclose(modes.frequency_Hz, HERTZ, rtol=1e-3)
        assert np.abs(modes.damping).max() < 1e-3


def rolled(modal: Float, line_time: float) -> PointSeries:
    """Three masses in rows 0, 1 and 3, from coordinates (4 T, 3) at the times of the rows."""
    values = np.stack([(modal @ SHAPES[:, k])[row::4] for k, row in enumerate((0, 1, 3))], axis=1)
    points, times = [[0, 0], [0, 1], [0, 3]], np.arange(len(values)) / RATE
    one = PointSeries.of(times, points, values[:, :, None] * np.array([0.8, 0.6]))
    return replace(one, line_time=line_time)


@pytest.mark.parametrize("method", ["release", "ssi", "fdd"])
def test_rows_of_a_rolling_shutter_are_seen_at_their_own_times(method: str) -> None:
    options = {"method": method}
    modal = random_vibration(ANGULAR, DAMPING, 4 * RATE, 160_000, seed=3)
    if method == "release":
        options = {"excitation": method}
        modal = free_decay(ANGULAR, DAMPING, np.arange(2800) / (4 * RATE), np.array([1, 0.3, 0.1]))
    turned = identify_modes(rolled(modal, 0.0), band_Hz=(3, 30), **options)
    modes = identify_modes(rolled(modal, 0.25 / RATE), band_Hz=(3, 30), **options)
    exact = 1e-9 if method == "release" else 1e-3
    assert mac(modes.shapes[:, :, 0], SHAPES).diagonal().min() > 1 - exact
    assert modes.complexity.max() < 10 * exact < 0.05 < turned.complexity.max()
    np.testing.assert_array_equal(modes.frequency_Hz, turned.frequency_Hz)


def test_points_that_were_lost_are_left_out() -> None:
    whole = long_record()
    values = whole.displacement.copy()
    values[5, 1] = np.nan
    modes = identify_modes(PointSeries.of(whole.times, whole.points, values), band_Hz=(3, 30))
    assert modes.points.tolist() == [[0, 0], [2, 0]]
    np.testing.assert_allclose(modes.frequency_Hz, HERTZ, rtol=0.005)


def test_mac() -> None:
    turned = SHAPES[:1] * np.exp(0.7j) * 3
    assert mac(turned, SHAPES)[0] == pytest.approx([1, 0, 0], abs=1e-12)
    with pytest.raises(gs.InputError, match="mac: shapes"):
        mac(SHAPES, SHAPES[:, :2])


def test_wrong_arguments() -> None:
    good = long_record()
    short = PointSeries.of(good.times[:50], good.points, good.displacement[:50])
    still = PointSeries.of(good.times[:99], good.points, np.ones((99, 3, 2)))
    lost = PointSeries.of(good.times[:99], good.points, np.full((99, 3, 2), np.nan))
    decay = series(free_decay(ANGULAR, DAMPING, good.times[:700], np.array([1.0, 0, 0])), 0.0)
    noise = PointSeries.of(
        good.times[:1920], good.points, np.random.default_rng(1).normal(size=(1920, 3, 2))
    )
    for wrong, options, message in (
        (short, {}, "at least 64"),
        (still, {}, "don't move"),
        (lost, {}, "no point found"),
        (good, {"band_Hz": (10, 70)}, "half the rate"),
        (good, {"band_Hz": (9, 3)}, "band_Hz"),
        (good, {"method": "fdd", "excitation": "release"}, "excitation"),
        (good, {"modes": 0}, "modes"),
        (decay, {"band_Hz": (20, 30), "modes": 1}, "no mode between 20 and 30 Hz"),
        (decay, {"method": "fdd"}, 'at least 1920 for method "fdd"'),
        (noise, {"method": "fdd"}, "no mode between"),
    ):
        with pytest.raises(gs.InputError, match=message):
            identify_modes(wrong, **options)
    with pytest.raises(gs.InputError, match="displacement: wrong shape"):
        PointSeries.of(good.times, good.points[:2], good.displacement)
    with pytest.raises(gs.InputError, match="times: wrong shape"):
        PointSeries.of(0.5, good.points, good.displacement)
