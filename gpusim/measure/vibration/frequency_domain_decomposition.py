"""Frequency-domain decomposition, enhanced (Brincker, Zhang, Andersen 2001; Brincker et al. 2001).

The matrix of cross spectra is decomposed into singular values and vectors at each frequency. Peaks
of the greatest value are modes, the vectors there their shapes. Around a peak, as far as the vector
stays that of the mode, the value is the spectrum of an oscillator of one degree of freedom; its
inverse transform is the oscillator's decay, whose slopes of phase and logarithm are frequency and
damping. Windows of segments multiply the decay by their own correlation, which is divided out.
"""

from __future__ import annotations

import numpy as np

from gpusim.arrays.array_types import Complex, Float, Long
from gpusim.measure.vibration.operational_modes import Poles, Sensors, jackknife, mac
from gpusim.measure.vibration.spectra import CrossSpectra, peaks

SAME_SHAPE = 0.8  # MAC with the shape of the peak, within its bell
HIGH, LOW = 0.9, 0.25  # of the decay's beginning, between which it is fitted
LEAST_APART = 3  # lines between peaks
LEAST_LAGS = 4  # of a decay, to which it is fitted


def decomposed(spectra: Complex) -> tuple[Float, Complex]:
    """Greatest singular value (F,) and its vector (F, r) of Hermitian spectra (F, r, r)."""
    values, vectors = np.linalg.eigh(spectra)
    return values[:, -1], vectors[:, :, -1]


def decomposition_modes(
    spectra: CrossSpectra, band_Hz: tuple[float, float], count: int, sensors: Sensors
) -> tuple[Poles, Poles]:
    """The ``count`` most prominent modes in a band, and their uncertainties (of shapes at
    ``sensors``)."""
    frequency = spectra.frequency_Hz
    first, last = np.searchsorted(frequency, band_Hz)
    value, _ = decomposed(spectra.blocks.mean(axis=0))
    rows = first + np.array(peaks(value[first : last + 1], count, LEAST_APART), dtype=np.int64)

    def estimate(means: Float | Complex) -> Poles:
        return _oscillators(spectra, np.asarray(means, dtype=np.complex128), rows)

    found = estimate(spectra.blocks.mean(axis=0))
    sigma = jackknife(spectra.blocks, estimate, sensors)
    decays = found.damping > 0  # a peak of noise needn't
    return found[decays], sigma[decays]


def _oscillators(spectra: CrossSpectra, means: Complex, rows: Long) -> Poles:
    """Modes of one degree of freedom each, around rows of the mean spectra."""
    value, vector = decomposed(means)
    found = np.empty((len(rows), 2))
    for number, row in enumerate(rows):
        same = mac(vector, vector[[row]])[:, 0] >= SAME_SHAPE
        same[0] = same[-1] = False
        low, high = row, row
        while same[low - 1]:
            low -= 1
        while same[high + 1]:
            high += 1
        bell = np.zeros(2 * (len(value) - 1))
        bell[low : high + 1] = value[low : high + 1]
        found[number] = _decay(np.fft.ifft(bell), spectra)
    return Poles(found[:, 0], found[:, 1], vector[rows])


def _decay(correlation: Complex, spectra: CrossSpectra) -> tuple[float, float]:
    """Frequency, Hz, and damping of a decaying complex oscillation (n,), a sample a time step; NaN
    where it decays at its end alone."""
    window = spectra.window
    lags = len(window) // 2
    own = np.fft.irfft(np.abs(np.fft.rfft(window, 2 * len(window))) ** 2)[:lags]
    decay = correlation[:lags] / own
    size = np.abs(decay) / np.abs(decay[0])
    begin = int((size < HIGH).argmax())
    if begin > lags - LEAST_LAGS:
        return np.nan, np.nan
    end = begin + int((size[begin:] < LOW).argmax()) if (size[begin:] < LOW).any() else lags // 2
    part = slice(begin, max(end, begin + LEAST_LAGS))
    times = np.arange(lags)[part] / spectra.rate_Hz
    rate = -np.polyfit(times, np.log(size[part]), 1)[0]
    angular = np.polyfit(times, np.unwrap(np.angle(decay[part])), 1)[0]
    whole = np.hypot(rate, angular)
    return whole / (2 * np.pi), rate / whole
