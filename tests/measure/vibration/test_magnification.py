"""Magnified motion against the exact one: its size, what isn't to be magnified, and noise."""

from __future__ import annotations

import numpy as np
import pytest

import gpusim as gs
from gpusim.arrays.array_types import Float
from gpusim.measure import magnify, point_series
from gpusim.measure.vibration import magnification
from tests.support.moving_pattern import MovingPattern, sine

RATE, FREQUENCY, BAND = 60.0, 15.0, (14.0, 18.0)
TIMES = np.arange(64) / RATE
PATTERN = MovingPattern(height=54, width=63)
POINTS = np.array([[25.0, 28.0], [36.0, 25.0], [31.0, 28.0]])
INNER = slice(12, 52)  # whole periods


def amplitudes(pictures: list[Float], frequency: float) -> Float:
    """Mean of the points' amplitudes of a motion along x and y, px."""
    reference = PATTERN.frames(np.zeros((1, 2)))[0]
    series = point_series(np.array(pictures), POINTS, reference=reference, subset=31)
    return sine(TIMES[INNER], frequency, series.displacement[INNER])[0].mean(axis=0)


def moved(amplitude: float, frequency: float) -> Float:
    angle = 2 * np.pi * frequency * TIMES
    return amplitude * np.stack([np.sin(angle), 0.5 * np.sin(angle + 0.8)], axis=1)


def test_motion_in_the_band_is_magnified_and_no_other() -> None:
    amplitude, factor = 0.05, 40.0
    slow = moved(0.3, 3.0)
    frames = PATTERN.frames(moved(amplitude, FREQUENCY) + slow)
    pictures = list(magnify(frames, BAND, factor, rate_Hz=RATE))
    expected = factor * amplitude * np.array([1.0, 0.5])
    np.testing.assert_allclose(amplitudes(pictures, FREQUENCY), expected, rtol=0.05)
    rest = np.array(amplitudes(pictures, 3.0)) / np.array([0.3, 0.15])
    assert np.abs(rest - 1).max() < 0.02 + 0.02 * factor * amplitude


def test_factors_one_and_nought() -> None:
    frames = PATTERN.frames(moved(0.2, FREQUENCY))
    same = np.array(list(magnify(frames[:25], BAND, 1, rate_Hz=RATE)))
    assert np.abs(same - frames[:25]).max() < 1e-5 * np.ptp(frames)
    still = list(magnify(frames, BAND, 0, rate_Hz=RATE))
    assert amplitudes(still, FREQUENCY).max() < 0.02 * 0.2


def test_noise_grows_no_more_than_theory() -> None:
    noise = np.random.default_rng(5).normal(size=(64, 54, 63))
    frames = PATTERN.frames(np.zeros((1, 2))) + noise
    factor = 10.0
    pictures = np.array(list(magnify(frames, BAND, factor, rate_Hz=RATE)))
    left = (pictures - pictures.mean(axis=0))[INNER].std()
    taps = magnification.band_pass(*BAND, RATE, 60)
    # half of a band's noise is in its phase; of that the filter passes the sum of its squares
    bound = np.sqrt(1 + 0.5 * (factor - 1) ** 2 * np.square(taps).sum())
    assert 1.1 < left < bound


def test_parts_of_time_and_picture_make_no_difference(monkeypatch: pytest.MonkeyPatch) -> None:
    pattern = MovingPattern(height=130, width=63)
    frames = (8 * pattern.frames(moved(0.05, FREQUENCY)[:40])).astype(np.uint16)
    read: list[int] = []

    class Frames(gs.FrameSource):
        def __getitem__(self, number):  # type: ignore[no-untyped-def]
            read.append(number)
            return super().__getitem__(number)

    source = Frames(frames, [str(k) for k in range(40)], TIMES[:40])
    whole = np.array(list(magnify(source, BAND, 20)))
    assert whole.dtype == np.uint16 and sorted(read) == [0, *range(40)]
    monkeypatch.setattr(magnification, "MEMORY", 20_000_000)
    parts, count = magnification._parts((130, 63), 41, 40)
    assert len(parts) == 2 and count == 82
    monkeypatch.setattr(magnification, "_parts", lambda *of: (parts, 15))
    parted = np.array(list(magnify(source, BAND, 20)))
    difference = (parted.astype(np.float64) - whole)[:, 8:-8, 8:-8]
    assert difference.std() < 0.01 * whole.std()


def test_wrong_arguments() -> None:
    frames = np.zeros((30, 40, 50))
    for options, message in (
        ({"band_Hz": (0, 5)}, "band_Hz"),
        ({"band_Hz": (10, 40)}, "band_Hz"),
        ({"factor": np.inf}, "factor"),
        ({"band_Hz": (0.5, 5)}, "frames; got 30; expected more than"),
        ({"rate_Hz": None}, "times: not known"),
    ):
        with pytest.raises(gs.InputError, match=message):
            magnify(frames, **({"band_Hz": BAND, "factor": 2.0, "rate_Hz": RATE} | options))
