"""Spectra of responses over time (Welch 1967): of each, and of each with each."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from gpusim.arrays.array_types import Complex, Float

LOG_CEILING = 1e-300


@dataclass(frozen=True)
class CrossSpectra:
    """One-sided cross spectra of r responses, mean over each of B parts of the time.

    frequency_Hz : (F,).    blocks : (B, F, r, r) Hermitian, units squared per Hz.
    window : (n,) of a segment, sum of squares 1.    rate_Hz : of the samples.
    """

    frequency_Hz: Float
    blocks: Complex
    window: Float
    rate_Hz: float


def cross_spectra(responses: Float, rate_Hz: float, segment: int, blocks: int) -> CrossSpectra:
    """Of ``responses`` (T, r), by segments of some samples under Hann windows that overlap by half;
    the segments in ``blocks`` parts."""
    window: Float = 1.0 - np.cos(2 * np.pi / segment * np.arange(segment, dtype=np.float64))
    window /= np.sqrt(np.square(window).sum())
    starts = np.arange(0, len(responses) - segment + 1, segment // 2)
    count = min(blocks, len(starts))
    channels = responses.shape[1]
    result = np.zeros((count, segment // 2 + 1, channels, channels), dtype=np.complex128)
    for part, chosen in enumerate(np.array_split(starts, count)):
        for start in chosen:
            piece = responses[start : start + segment]
            spectrum = np.fft.rfft((piece - piece.mean(axis=0)) * window[:, None], axis=0)
            result[part] += spectrum[:, :, None] * spectrum[:, None, :].conj()
        result[part] *= count / len(starts)
    sides = np.full(segment // 2 + 1, 2.0 / rate_Hz)
    sides[[0, -1]] /= 2.0
    result *= sides[:, None, None]
    frequency = np.arange(segment // 2 + 1, dtype=np.float64) * (rate_Hz / segment)
    return CrossSpectra(frequency, result, window, rate_Hz)


def peaks(spectrum: Float, count: int, apart: int) -> list[int]:
    """Rows of the ``count`` most prominent peaks of a positive spectrum (F,), by its logarithm;
    rising, at least ``apart`` rows from each other."""
    level = np.log(np.maximum(spectrum, LOG_CEILING))
    rows, found = scipy.signal.find_peaks(level, prominence=0.0, distance=max(apart, 1))
    most = np.argsort(-found["prominences"], kind="stable")[:count]
    return sorted(int(row) for row in rows[most])
