"""Spectra: the power of known signals, and their phases."""

from __future__ import annotations

import numpy as np

from gpusim.measure.vibration.spectra import cross_spectra, peaks

RATE = 200.0


def test_power_and_phase() -> None:
    times = np.arange(6000) / RATE
    noise = np.random.default_rng(1).normal(size=(6000, 2))
    wave = np.stack([3 * np.sin(2 * np.pi * 25 * times), np.sin(2 * np.pi * 25 * times + 0.5)], 1)
    spectra = cross_spectra(noise + wave, RATE, 200, 4)
    assert spectra.blocks.shape == (4, 101, 2, 2)
    mean = spectra.blocks.mean(axis=0)
    step = spectra.frequency_Hz[1]
    total = mean.sum(axis=0).real * step
    np.testing.assert_allclose(total.diagonal(), [4.5 + 1, 0.5 + 1], rtol=0.05)
    level = np.median(mean[:, 0, 0].real)
    np.testing.assert_allclose(level, 1 / (RATE / 2), rtol=0.1)  # variance over the width
    line = peaks(mean[:, 0, 0].real, 1, 3)
    assert spectra.frequency_Hz[line] == 25.0
    assert abs(np.angle(mean[line[0], 1, 0]) - 0.5) < 0.1


def test_peaks_are_the_most_prominent() -> None:
    values = np.ones(60)
    values[[10, 12, 30, 50]] = [50.0, 60.0, 5.0, 100.0]
    assert peaks(values, 2, 4) == [12, 50]
    assert peaks(values, 9, 4) == [12, 30, 50]
