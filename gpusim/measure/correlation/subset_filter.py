"""What subsets make of a displacement field: a low-pass filter.

A subset gives one displacement for all its pixels: to first order the centre of the shape function
c that is fitted to the field (u, v) by least squares, weighted as the match weights it. With the
steepest-descent images J' of the match (``icgn``) c minimises sum w (J' . c - f_x u - f_y v)^2: it
is the fixed point of the iteration (Schreier & Sutton, "Systematic errors in digital image
correlation due to undermatched subset shape functions", Exp. Mech. 42, 2002). A true field that is
filtered like this is *levelled*: what is left of a difference to it isn't the subset's smoothing.

What of evenly spread slopes is left of waves and of noise is told by `gpusim.measure.gauge_filter`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from gpusim.arrays.array_types import Bool, Float
from gpusim.measure.correlation.icgn import CHUNK, references, solve
from gpusim.measure.correlation.image_pair import Pair
from gpusim.measure.correlation.matching import Status, make_settings
from gpusim.measure.correlation.pixel_mask import check_mask, masked_image
from gpusim.measure.correlation.warp import COEFFICIENTS, Shape
from gpusim.measure.images import SplineImage
from gpusim.parallel.blas_threads import one_blas_thread


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
