"""Displacements over time against exact motions, where light changes, and where nothing shows."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

import gpusim as gs
from gpusim.arrays.array_types import Float
from gpusim.measure import Status, dic, point_series
from gpusim.measure.vibration import shifted_subsets
from tests.support.moving_pattern import MovingPattern, sine

RATE, FREQUENCY = 200.0, 13.3
TIMES = np.arange(60) / RATE
POINTS = np.stack(np.meshgrid([40, 60, 80], [40, 56]), axis=-1).reshape(-1, 2) * 1.0
PHASES = np.array([0.4, 1.0])


def motion(amplitude: float) -> Float:
    return amplitude * np.sin(2 * np.pi * FREQUENCY * TIMES[:, None] + PHASES) * [1.0, 0.6]


@cache
def film(amplitude: float) -> tuple[Float, Float]:
    frames = MovingPattern().frames(np.concatenate([np.zeros((1, 2)), motion(amplitude)]))
    return frames[0], frames[1:]


@pytest.mark.parametrize("amplitude", [0.01, 0.1, 1.0, 10.0])
@pytest.mark.parametrize("method", ["lucas-kanade", "gradient", "phase"])
def test_sine_motion(method: str, amplitude: float) -> None:
    reference, frames = film(amplitude)
    source = gs.read_frames(frames, times=TIMES)
    series = point_series(source, POINTS, method=method, reference=reference)
    assert series.rate_Hz == pytest.approx(RATE)
    good = series.displacement[:, series.ok]
    assert good.shape[1] >= 0.5 * len(POINTS)
    got, phase = sine(TIMES, FREQUENCY, good)
    np.testing.assert_allclose(got, np.tile(amplitude * np.array([1.0, 0.6]), (len(got), 1)), 0.01)
    assert np.abs(np.degrees(phase - PHASES)).max() < 1
    spectrum = np.abs(np.fft.rfft(good, axis=0)[1:]).argmax(axis=0) + 1
    assert np.abs(spectrum * RATE / len(TIMES) - FREQUENCY).max() <= RATE / len(TIMES)
    if method == "lucas-kanade":
        assert np.abs(good - motion(amplitude)[:, None]).max() < 1e-3


def test_agrees_with_correlation() -> None:
    reference, frames = film(1.0)
    noisy = frames[:2] + np.random.default_rng(2).normal(scale=2.0, size=frames[:2].shape)
    series = point_series(noisy, POINTS, reference=reference)
    for picture, found in zip(noisy, series.displacement, strict=True):
        other = dic(reference, picture, points=POINTS, subset=21, shape="translation",
                    backend="numpy")  # fmt: skip
        # both are right to about 0.01 px in this noise; they weigh pixels alike but for a fraction
        assert np.abs(found - other.displacement).max() < 2 * other.sigma.max()


@pytest.mark.parametrize("method", ["lucas-kanade", "phase"])
def test_light_that_changes_moves_nothing(method: str) -> None:
    reference, frames = film(0.1)
    brighter = 20 + 1.3 * frames[5:7]
    plain, lit = (
        point_series(each, POINTS, method=method, reference=reference).displacement
        for each in (frames[5:7], brighter)
    )
    np.testing.assert_allclose(lit, plain, atol=1e-6)


def test_edge_shows_the_motion_across_it() -> None:
    x = np.arange(80.0)
    places = 0.3 * np.sin(np.arange(12.0))
    frames = np.array([np.tile(100 + 80 * np.tanh((x - 40 - u) / 2), (60, 1)) for u in places])
    assert point_series(frames, [[40, 30]]).status.tolist() == [Status.NO_TEXTURE]
    for method, subset in (("lucas-kanade", 15), ("phase", 35)):
        series = point_series(frames, [[40, 30]], direction=(2, 0), method=method, subset=subset)
        expected = np.stack([places, np.zeros_like(places)], axis=1)
        np.testing.assert_allclose(series.displacement[:, 0], expected, atol=2e-3)
    slanted = point_series(frames, [[40, 30]], direction=(0.6, 0.8)).displacement[:, 0]
    np.testing.assert_allclose(slanted, np.outer(places, [1.0, 4 / 3]), atol=2e-3)


def test_points_that_get_lost_say_why_and_come_back() -> None:
    reference, frames = film(0.1)
    frames = frames[:5].copy()
    frames[2, :, :60] = 128.0  # hidden
    frames[3, 60, 80] = 7000.0  # hot
    points = [[40, 50], [80, 60], [5, 50], [80, 38]]
    series = point_series(frames, points, reference=reference)
    names = [Status(value).name for value in series.status]
    assert names == ["LOW_CORRELATION", "LOW_CORRELATION", "OUTSIDE", "OK"]
    lost = np.isnan(series.displacement).any(axis=2)
    assert lost[:, 0].tolist() == [False, False, True, False, False]
    assert lost[:, 1].tolist() == [False, False, False, True, False]
    assert lost[:, 2].all() and series.ok.tolist() == [False, False, False, True]


@pytest.mark.parametrize("method", ["lucas-kanade", "gradient", "phase"])
def test_nothing_is_found_where_nothing_shows(method: str) -> None:
    """In a picture that was taken in the dark, or beyond what the sensor counts."""
    reference, frames = film(0.1)
    for grey in (0.0, 255.0):
        dark = [frames[0], np.full_like(reference, grey), frames[2]]
        series = point_series(dark, POINTS, method=method, reference=reference)
        assert np.isnan(series.displacement[1]).all() and not series.ok.any()
        found = np.isfinite(series.displacement[[0, 2]]).all(axis=(0, 2))
        assert found.sum() >= 0.5 * len(POINTS)


def test_wrong_arguments() -> None:
    frames = np.zeros((3, 40, 50))
    for wrong, message in (
        ({"method": "magic"}, "method"),
        ({"subset": 20}, "subset.*odd"),
        ({"direction": (0, 0)}, "direction"),
        ({"reference": np.zeros((9, 9))}, "frame 0: got shape"),
    ):
        with pytest.raises(gs.InputError, match=message):
            point_series(frames, [[20, 20]], **wrong)
    with pytest.raises(gs.InputError, match="times: not known"):
        point_series(frames, [[20, 20]]).rate_Hz  # noqa: B018
    uneven = point_series(gs.read_frames(frames, times=[0, 1, 1.5]), [[20, 20]])
    with pytest.raises(gs.InputError, match="expected even"):
        uneven.rate_Hz  # noqa: B018


def test_fast_motion_finds_no_wrong_places(monkeypatch: pytest.MonkeyPatch) -> None:
    # 7 px from picture to picture: most subsets begin on other details than their own
    places = 10 * np.sin(0.25 * np.pi * np.arange(8) + 0.4)
    pattern = MovingPattern(coarse=5.0, seed=3)
    reference = pattern.frames(np.zeros((1, 2)))[0]
    frames = pattern.frames(np.stack([places, 0 * places], axis=1))

    def worst() -> float:
        found = point_series(frames, POINTS, reference=reference).displacement[:, :, 0]
        return float(np.nanmax(np.abs(found - places[:, None])))

    assert worst() < 0.01
    monkeypatch.setattr(shifted_subsets, "MIN_LIKENESS", -9.0)
    assert worst() > 1.0
