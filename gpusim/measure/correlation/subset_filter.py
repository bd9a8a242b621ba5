"""What subsets and strain windows make of a displacement field: low-pass filters.

A subset gives one displacement for all its pixels: to first order the centre of the shape function
c that is fitted to the field (u, v) by least squares, weighted as the match weights it. With the
steepest-descent images J' of the match (``icgn``) c minimises sum w (J' . c - f_x u - f_y v)^2: it
is the fixed point of the iteration (Schreier & Sutton, "Systematic errors in digital image
correlation due to undermatched subset shape functions", Exp. Mech. 42, 2002). A true field that is
filtered like this is *levelled*: what is left of a difference to it isn't the subset's smoothing.

Along a wave of a period p a square subset is an average (affine), or a Savitzky-Golay filter of
second degree (quadratic): closed forms.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import ceil, pi, sqrt
from typing import Any

import numpy as np
import numpy.typing as npt
import scipy

from gpusim.arrays.array_types import Bool, Float
from gpusim.measure.correlation.icgn import CHUNK, references, solve
from gpusim.measure.correlation.image_pair import Pair
from gpusim.measure.correlation.matching import Status, make_settings
from gpusim.measure.correlation.pixel_mask import check_mask, masked_image
from gpusim.measure.correlation.warp import COEFFICIENTS, Shape
from gpusim.measure.images import SplineImage
from gpusim.parallel.blas_threads import one_blas_thread

LOSS = 0.1
"""Share of a wave's amplitude that is lost at the spatial resolution."""
_LONGEST = 400.0
"""Of the periods that are tried, in widths of a filter."""


@dataclass(frozen=True, eq=False)
class FilteredField:
    """Displacements as subsets see them: ``displacement`` (F, M, 2) px of F fields at M points, NaN
    where a subset can't tell; of the subsets' grey values, in shares of the picture's range, the
    RMS ``slope`` (M,) per px along an axis, and the standard deviation ``contrast`` (M,);
    ``spread`` (M, 2): standard uncertainties of u and v over the larger one, which results have."""

    displacement: Float
    slope: Float
    contrast: Float
    spread: Float


@one_blas_thread()
def filtered_by_subsets(
    reference: npt.NDArray[Any],
    points: Float,
    fields: Sequence[Float],
    *,
    subset: int,
    shape: Shape = "affine",
    mask: Bool | None = None,
    blur_px: float = 0.0,
) -> FilteredField:
    """What ``dic`` finds at ``points`` (M, 2) of a motion, if it is as good as the subset allows.

    Parameters
    ----------
    reference, subset, shape, mask, blur_px : as for ``dic``.
    fields : displacements (H, W, 2) px at all pixels of the reference; NaN only where it is masked.
    """
    settings = make_settings(subset, "square", shape=shape, blur_px=blur_px)
    first = masked_image(reference, "reference", subset, mask)
    spline = SplineImage.from_image(first.image, blur_px=blur_px)
    pair = Pair(spline, spline, check_mask(first.good, first.image, blur_px))
    displacement = np.full((len(fields), len(points), 2), np.nan)
    slope, contrast = np.full((2, len(points)), np.nan)
    spread = np.full((len(points), 2), np.nan)
    # where u and v of the centre are among the unknowns
    centre = [0, 1 if shape in ("translation", "rigid") else COEFFICIENTS[shape]]
    chunk = max(1, CHUNK // settings.window.size)
    for start in range(0, len(points), chunk):
        part = slice(start, start + chunk)
        subsets = references(pair, points[part], settings)
        good = np.flatnonzero(subsets.status == Status.NOT_CONVERGED)
        weighted, row, column = subsets.weighted[:, good], subsets.row[good], subsets.column[good]
        corner = column[:, 0] - spline.origin[0], row[:, 0] - spline.origin[1]
        by_x, by_y = np.moveaxis(pair.planes_at(*corner, subset)[..., 1:3], 2, 0)
        rows = start + good
        for number, field in enumerate(fields):
            u, v = np.moveaxis(np.nan_to_num(field[row, column]), 2, 0)
            right = np.einsum("ubn,bn->bu", weighted, by_x * u + by_y * v)
            found = solve(subsets.factor[good], right)
            displacement[number, rows] = found[:, centre]
        # the inverse of the normal equations is L^-T L^-1
        factor = subsets.factor[good]
        half = np.linalg.solve(factor, np.eye(factor.shape[-1])[None, :, centre])
        lengths = np.linalg.norm(half, axis=1)
        spread[rows] = lengths / lengths.max(axis=1, keepdims=True, initial=1e-300)
        total, weight = subsets.total[good], subsets.weight[good]
        squares = np.einsum("bn,bn->b", weight, by_x**2 + by_y**2)
        slope[rows] = np.sqrt(0.5 * squares / total)
        contrast[rows] = np.sqrt(subsets.energy[good] / total)
    return FilteredField(displacement, slope, contrast, spread)


def subset_transfer(period: Float, subset: int, shape: Shape = "affine") -> Float:
    """The share of a displacement wave's amplitude that subsets keep, for periods in px.

    Examples
    --------
    >>> subset_transfer(np.array([31.0, 1e6]), 31).round(6) + 0.0
    array([0., 1.])
    """
    place = np.arange(subset) - subset // 2
    weights = np.full(subset, 1.0 / subset)
    if shape == "quadratic":
        squares = place**2 - np.mean(place**2)
        weights = weights - squares * np.mean(place**2) / np.sum(squares**2)
    return np.asarray(np.cos(2.0 * pi * place / np.asarray(period)[..., None]) @ weights)


def strain_transfer(
    period: Float, subset: int, step: float, window: int, shape: Shape = "affine"
) -> Float:
    """The same of a strain wave, behind the subsets and planes fitted to ``window`` points."""
    place = step * (np.arange(window) - window // 2)
    phase = 2.0 * pi * place / np.asarray(period)[..., None]
    slope = (np.sin(phase) @ place) / np.sum(place**2) * np.asarray(period) / (2.0 * pi)
    return np.asarray(subset_transfer(period, subset, shape) * slope)


def spatial_resolution(
    subset: int, shape: Shape = "affine", step: float = 0.0, window: int = 1
) -> float:
    """The period (px) below which more than a tenth of a displacement wave is lost; of a strain
    wave with a ``window`` of points a ``step`` apart.

    Examples
    --------
    >>> round(spatial_resolution(31) / 31, 2), round(spatial_resolution(31, "quadratic") / 31, 2)
    (3.99, 1.3)
    """

    def lost(period: float) -> float:
        one = np.array([period])
        kept = (
            subset_transfer(one, subset, shape) if window < 3
            else strain_transfer(one, subset, step, window, shape)
        )  # fmt: skip
        return float(1.0 - kept[0]) - LOSS

    width = subset + step * (window - 1)
    # from long waves on: below the first loss some are kept again, with the other sign
    tried = np.geomspace(_LONGEST * width, 0.5 * width, ceil(40 * np.log2(2.0 * _LONGEST)))
    first = next(k for k, period in enumerate(tried) if lost(float(period)) > 0)
    return float(scipy.optimize.brentq(lost, tried[first], tried[first - 1]))


def noise_variance(subset: int, shape: Shape = "affine") -> float:
    """Variance of a measured displacement for a difference of pictures with variance 1 and slopes
    of mean square 1, evenly spread: 1 / subset^2 (affine), 3.5 times that (quadratic)."""
    place = np.arange(subset) - subset // 2
    squares = place**2 - np.mean(place**2)
    spread = np.mean(place**2) ** 2 / np.mean(squares**2) if shape == "quadratic" else 0.0
    return (1.0 + 2.0 * spread) / subset**2


def metrological_efficiency(subset: int, shape: Shape = "affine") -> float:
    """The least that noise times spatial resolution can be, px^2, over the noise of a pixel of both
    pictures by the RMS slope: Grediac, Blaysat & Sur, "A critical comparison of some metrological
    parameters characterizing local DIC and grid method", Exp. Mech. 57 (2017).

    Examples
    --------
    >>> round(metrological_efficiency(101), 2), round(metrological_efficiency(101, "quadratic"), 2)
    (5.65, 3.42)
    """
    return sqrt(2.0 * noise_variance(subset, shape)) * spatial_resolution(subset, shape)
