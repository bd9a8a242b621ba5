"""Frequencies, damping and shapes of modes, from displacements of points over time.

Displacements of many points are the motion of few modes and noise: their principal components are
what is identified, and shapes are put together from them. What lies above the band is filtered out
and the rest sampled down, so that decays span as many lags as a slow mode needs.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
import scipy

from gpusim.arrays.array_types import Float
from gpusim.errors import InputError
from gpusim.measure.vibration.frequency_domain_decomposition import decomposition_modes
from gpusim.measure.vibration.operational_modes import (
    OperationalModes,
    Poles,
    Sensors,
    real_shapes,
)
from gpusim.measure.vibration.point_series import PointSeries
from gpusim.measure.vibration.sampling import sampling_rate
from gpusim.measure.vibration.spectra import cross_spectra
from gpusim.measure.vibration.subspace_identification import (
    BLOCKS,
    covariances,
    subspace_modes,
)
from gpusim.parallel.blas_threads import one_blas_thread
from gpusim.validation import Count, checked, require

Identification = Literal["ssi", "fdd"]
Excitation = Literal["ambient", "release"]
MOST_COMPONENTS = 12
COMPONENTS = 1e-9  # variance of a component over that of the first, that rounding makes
OVER_BAND = 1.25  # new half rate over the top of the band
SPAN = 1.2  # periods of the slowest mode in half the lags
DEPTH = (20, 80)  # lags; at most so many of one side
SIDE = 600  # rows of the Hankel matrix
LEAST_SAMPLES = 64
SEGMENTS = 60  # of FDD's spectra, and half as many again between them
LEAST_LENGTH = 32  # of a segment


@dataclass(frozen=True)
class _Responses:
    """Principal components (T, r) at a rate, and the points' components as their sensors."""

    values: Float
    rate_Hz: float
    sensors: Sensors


@checked
@one_blas_thread()
def identify_modes(
    series: PointSeries,
    *,
    modes: Count = 3,
    band_Hz: tuple[float, float] | None = None,
    method: Identification = "ssi",
    excitation: Excitation = "ambient",
) -> OperationalModes:
    """Identify modes from displacements alone: nobody needs to know the forces.

    Parameters
    ----------
    series : displacements of points at even times; points that weren't found in all pictures are
        left out. Modes shorter than about 200 periods are told to no better than 1 % of their
        frequency and 30 % of their damping, whichever way.
    modes : at most so many, those that show best.
    band_Hz : lowest and highest frequency of modes that are looked for; None: up to 0.45 pictures
        a second. What the lower end is has no sharp effect.
    method : "ssi": covariance-driven subspace identification; "fdd": enhanced frequency-domain
        decomposition, which needs 1920 pictures or more, and modes that stand apart.
    excitation : "ambient": a random force that excites all modes, all the time; "release":
        the structure was let go, or hit, before the first picture ("ssi" only).

    Raises
    ------
    InputError
        Times that aren't known or even, no point that was found throughout, a record that is too
        short, or no mode in the band.

    Examples
    --------
    >>> times = np.arange(400) / 100
    >>> sway = np.exp(-times) * np.cos(50 * times)
    >>> series = gs.measure.PointSeries.of(times, [[40, 10]], sway[:, None, None] * [1.0, 0.2])
    >>> gs.measure.identify_modes(series, modes=1, excitation="release").frequency_Hz.round(2)
    array([7.96])
    """
    band = identifiable_band(series.times, band_Hz, method, excitation)
    responses = _responses(series, band)
    if method == "fdd":
        length = 2 * (len(responses.values) // (2 * SEGMENTS))
        got = f"{len(responses.values)} pictures at {responses.rate_Hz:.4g} Hz"
        least = f'at least {LEAST_LENGTH * SEGMENTS} for method "fdd"'
        require(length >= LEAST_LENGTH, "series", got, least)
        spectra = cross_spectra(responses.values, responses.rate_Hz, length, BLOCKS)
        found, sigma = decomposition_modes(spectra, band, modes, responses.sensors)
    else:
        low = max(band[0], band[1] / DEPTH[0])
        depth = int(np.clip(np.ceil(SPAN * responses.rate_Hz / low), *DEPTH))
        depth = max(min(depth, SIDE // responses.values.shape[1], len(responses.values) // 8), 2)
        statistics = covariances(
            responses.values, responses.rate_Hz, depth, excitation == "release"
        )
        found, sigma = subspace_modes(statistics, band, modes, responses.sensors)
    if not len(found.damping):
        where = f"between {band[0]:.4g} and {band[1]:.4g} Hz"
        wanted = f'a motion with excitation "{excitation}", by more than noise'
        raise InputError(f"identify_modes: no mode {where}; expected {wanted}")
    return _as_modes(series, responses.sensors, found, sigma, method)


def identifiable_band(
    times: Float,
    band_Hz: tuple[float, float] | None,
    method: Identification = "ssi",
    excitation: Excitation = "ambient",
) -> tuple[float, float]:
    """The band in which pictures at ``times`` can show modes. Raises InputError if they can't."""
    rate = sampling_rate(times)
    band = (0.0, 0.45 * rate) if band_Hz is None else band_Hz
    fits = 0 <= band[0] < band[1] < 0.5 * rate
    require(fits, "band_Hz", band, f"0 <= low < high < {0.5 * rate:.6g} Hz, half the rate")
    fewer = _sampled_down(rate, band)
    samples = -(-len(times) // fewer)
    got = f"{samples} pictures at {rate / fewer:.4g} Hz"
    require(samples >= LEAST_SAMPLES, "series", got, f"at least {LEAST_SAMPLES}")
    ambient = excitation == "ambient" or method != "fdd"
    require(ambient, "excitation", excitation, '"ambient" with method "fdd"')
    return band


def _sampled_down(rate_Hz: float, band: tuple[float, float]) -> int:
    """One in so many pictures is enough for a band."""
    return max(int(0.5 * rate_Hz / (OVER_BAND * band[1])), 1)


def _responses(series: PointSeries, band: tuple[float, float]) -> _Responses:
    """What is identified."""
    rate, ok = series.rate_Hz, series.ok
    require(bool(ok.any()), "series", "no point found in all pictures", "at least one")
    values = series.displacement[:, ok].reshape(len(series.times), -1)
    values = values - values.mean(axis=0)
    fewer = _sampled_down(rate, band)
    if fewer > 1:
        values = scipy.signal.resample_poly(values, 1, fewer, axis=0, padtype="line")
    left, size, right = np.linalg.svd(values, full_matrices=False)
    require(bool(size[0] > 0), "series", "points that don't move", "displacements")
    kept = np.flatnonzero(size[:MOST_COMPONENTS] ** 2 > COMPONENTS * size[0] ** 2)
    sensors = Sensors(right[kept].T, np.repeat(series.delays[ok], 2))
    return _Responses(left[:, kept] * size[kept], rate / fewer, sensors)


def _as_modes(
    series: PointSeries, sensors: Sensors, found: Poles, sigma: Poles, method: str
) -> OperationalModes:
    """Modes with shapes at the points."""
    shapes, complexity = real_shapes(sensors.shapes(found))
    return OperationalModes(
        frequency_Hz=found.frequency_Hz,
        frequency_sigma_Hz=sigma.frequency_Hz,
        damping=found.damping,
        damping_sigma=sigma.damping,
        points=series.points[series.ok],
        shapes=shapes.reshape(len(shapes), -1, 2),
        shape_sigma=np.asarray(sigma.shapes.real).reshape(len(shapes), -1, 2),
        complexity=complexity,
        method=method,
    )
