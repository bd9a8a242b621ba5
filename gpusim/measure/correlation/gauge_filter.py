"""Subset and strain window as one linear filter: what it does to noise and to waves.

A subset's displacement is the constant of a least-squares fit of its shape function to what each of
its pixels says of the motion, a strain the slope of a plane through such displacements. Both are
linear: weights h on the pixels. Noise of standard deviation s on both pictures, whose slopes have a
root mean square g along an axis, gives each pixel the uncertainty sqrt(2) s / g, and the result
that times the root of the sum of h squared (Grédiac, Blaysat, Sur 2017); a wave keeps the
Fourier transform of h. A square subset's weights are a sum of products of one of x and one of y.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, cached_property
from math import sqrt

import numpy as np
import scipy

from gpusim.arrays.array_types import Float
from gpusim.field_summary import field_summary
from gpusim.measure.correlation.warp import COEFFICIENTS, Shape, basis

LOSS = 0.1  # of a wave's amplitude, by which spatial resolution is told


@dataclass(frozen=True)
class GaugeFilter:
    """The filter of a displacement, or of the strain along an axis.

    Attributes
    ----------
    along : (R, n) weights along the axis of the strain (or of the wave), 1 or 1/px.
    across : (R, m) weights along the other one.
    strain : whether it gives a strain.
    """

    along: Float
    across: Float
    strain: bool
    __repr__ = field_summary

    @cached_property
    def noise(self) -> float:
        """Root of the sum of the squared weights: uncertainty over that of a pixel's motion."""
        return float(np.sqrt(((self.along @ self.along.T) * (self.across @ self.across.T)).sum()))

    @cached_property
    def resolution(self) -> float:
        """Period of which a tenth is lost, px."""
        width = self.along.shape[1]
        return float(
            scipy.optimize.brentq(lambda p: self.response(p) - 1 + LOSS, 0.75 * width, 20 * width)
        )

    @property
    def efficiency(self) -> float:
        """Metrological efficiency: noise times resolution, px^2, over s / g (Grédiac, Blaysat, Sur:
        5.65 affine, 3.42 quadratic)."""
        return sqrt(2.0) * self.noise * self.resolution

    def response(self, period: float) -> float:
        """What is left of a wave of ``period`` px along the axis, 1 of long ones."""
        width = self.along.shape[1]
        phase = 2 * np.pi / period * (np.arange(width) - width // 2)
        wave = np.sin(phase) * period / (2 * np.pi) if self.strain else np.cos(phase)
        return float((self.along @ wave) @ self.across.sum(axis=1))


@cache
def gauge_filter(
    subset: int, shape: Shape = "affine", step: int = 1, window: int = 1
) -> GaugeFilter:
    """Of subsets ``subset`` px wide; with a ``window``, of the strain from so many points across,
    ``step`` px apart.

    Examples
    --------
    >>> affine = gs.measure.gauge_filter(21)
    >>> round(affine.noise * 21, 3), round(affine.resolution / 21, 2)
    (1.0, 3.99)
    >>> gs.measure.gauge_filter(21, "affine", step=7, window=5).along.shape
    (1, 49)
    """
    offset = (np.arange(subset) - subset // 2) / (subset // 2)
    terms = basis(*np.meshgrid(offset, offset), COEFFICIENTS[shape]).reshape(-1, subset**2)
    constant = np.linalg.solve(terms @ terms.T, np.eye(len(terms))[0])
    one, size, other = np.linalg.svd((constant @ terms).reshape(subset, subset))
    rank = int((size > 1e-9 * size[0]).sum())
    along, across = one[:, :rank].T * size[:rank, None], other[:rank]
    if window == 1:
        return GaugeFilter(along, across, False)
    slope, mean = np.zeros((2, step * (window - 1) + 1))
    place = float(step) * (np.arange(window) - window // 2)
    slope[::step], mean[::step] = place / (place @ place), 1.0 / window
    along = np.array([np.convolve(row, slope) for row in along])
    return GaugeFilter(along, np.array([np.convolve(row, mean) for row in across]), True)
