"""Choices that every subset-based measurement shares: window, limits, result."""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil
from typing import Any, Literal

import cv2
import numpy as np
import numpy.typing as npt

from gpusim.errors import InputError
from gpusim.field_summary import field_summary
from gpusim.measure.correlation.matching import SLOPE_NOISE, Correlation, Settings, Status
from gpusim.measure.correlation.warp import check_shape
from gpusim.measure.images import FloatArray, Image

__all__ = ["DicResult", "Window", "check_mask", "make_result", "make_settings", "make_window"]

Window = Literal["square", "round"]
MIN_BLUR = 0.5  # px


@dataclass(frozen=True)
class DicResult:
    """Displacement of M points. Only points with status ``OK`` carry numbers, the others NaN.

    Attributes
    ----------
    points : (M, 2) float64, x, y in the reference image, px.
    displacement : (M, 2) float64, where each point went, px.
    gradient : (M, 2, 2) float64, [[du/dx, du/dy], [dv/dx, dv/dy]].
    zncc : (M,) float64, correlation coefficient of the match (also of poor ones).
    sigma : (M,) float64, standard uncertainty of the worse displacement component from the grey
        residuals, px; with a blur, what independent noise before the blur would give. It doesn't
        contain the interpolation's own bias.
    iterations : (M,) int32.
    status : (M,) int8, values of ``Status``.
    subset : width of the subsets, px.

    Examples
    --------
    >>> before, after = (gs.export.read_image(f"{name}.png") for name in ("before", "after"))
    >>> result = gs.measure.dic(before, after, subset=31, step=20, backend="numpy")
    >>> result.points.shape, bool(result.ok.all())
    ((35, 2), True)
    """

    points: FloatArray
    displacement: FloatArray
    gradient: FloatArray
    zncc: FloatArray
    sigma: FloatArray
    iterations: npt.NDArray[np.int32]
    status: npt.NDArray[np.int8]
    subset: int
    __repr__ = field_summary

    @property
    def ok(self) -> npt.NDArray[np.bool_]:
        """(M,) bool: the points that were measured."""
        return np.asarray(self.status == Status.OK)

    def counts(self) -> dict[str, int]:
        """How many points ended in each status, only those that occur."""
        numbers = {status.name: int((self.status == status).sum()) for status in Status}
        return {name: number for name, number in numbers.items() if number}


def make_result(
    points: FloatArray, matches: Correlation, subset: int, widening: FloatArray
) -> DicResult:
    """Turn raw matches into the public result.

    ``widening`` (M,) is what a blur does to sigma, see
    `gpusim.measure.correlation.blur_uncertainty`. A match is uncertain in the pixels of the
    reference; what it says of the deformed image is stretched with the subset.
    """
    coefficients = matches.coefficients
    gradient = coefficients[:, :, 1:3] / (subset // 2)
    stretch = np.full(len(points), np.nan)
    known = np.isfinite(gradient).all(axis=(1, 2))
    stretch[known] = np.linalg.norm(np.eye(2) + gradient[known], ord=2, axis=(1, 2))
    return DicResult(
        points=points,
        displacement=coefficients[:, :, 0].copy(),
        gradient=gradient,
        zncc=matches.zncc,
        sigma=matches.sigma * stretch * widening,
        iterations=matches.iterations,
        status=matches.status,
        subset=subset,
    )


def make_window(subset: int, window: Window | npt.ArrayLike) -> FloatArray:
    """Weights (subset, subset) in 0..1: all pixels, those of the inscribed disc, or an array."""
    if not isinstance(subset, (int, np.integer)) or subset % 2 == 0 or not 5 <= subset <= 255:
        raise InputError(f"subset: got {subset!r}; expected an odd whole number of px, 5..255")
    if isinstance(window, str):
        if window == "square":
            return np.ones((subset, subset))
        if window == "round":
            offset = np.arange(subset) - subset // 2
            radius = np.hypot(offset[:, None], offset[None, :])
            return (radius <= subset / 2).astype(np.float64)
        raise InputError(f"window: got {window!r}; expected 'square', 'round' or an array")
    weights = np.asarray(window, dtype=np.float64)
    if weights.shape != (subset, subset):
        raise InputError(
            f"window: wrong shape; got {weights.shape}; expected ({subset}, {subset}) as subset"
        )
    return weights.copy()


def make_settings(
    subset: int,
    window: Window | npt.ArrayLike,
    *,
    shape: object,
    tolerance: float,
    max_iterations: int,
    min_zncc: float,
    max_move: float,
    apart_px: float = 0.1,
    blur_px: float = 0.0,
) -> Settings:
    """Check the numbers that steer a correlation."""
    if not 0 < tolerance < 1:
        raise InputError(f"tolerance: got {tolerance!r}; expected 0 < tolerance < 1 px")
    if not isinstance(max_iterations, (int, np.integer)) or max_iterations < 1:
        raise InputError(f"max_iterations: got {max_iterations!r}; expected a whole number >= 1")
    if not -1 <= min_zncc <= 1:
        raise InputError(f"min_zncc: got {min_zncc!r}; expected -1..1")
    if not 0 < max_move < np.inf:
        raise InputError(f"max_move: got {max_move!r}; expected px > 0")
    if not apart_px > 0:
        raise InputError(f"apart_px: got {apart_px!r}; expected px > 0, or inf")
    return Settings(
        make_window(subset, window),
        check_shape(shape),
        float(tolerance),
        int(max_iterations),
        float(min_zncc),
        float(max_move),
        float(apart_px),
        # a blur takes noise off the slopes first
        SLOPE_NOISE if blur_px < MIN_BLUR else 0.0,
    )


def check_mask(
    mask: npt.NDArray[Any] | None, image: Image, blur_px: float
) -> npt.NDArray[np.bool_] | None:
    """Check that a mask is boolean and as large as the reference image, and shrink it.

    Pixels next to what is masked out are dropped too, as far as the interpolation and the blur
    mix them with it: 1 px + 2 standard deviations.
    """
    if mask is None:
        return None
    array = np.asarray(mask)
    if array.dtype != np.bool_ or array.shape != image.shape:
        raise InputError(
            f"mask: got {array.dtype} {array.shape}; expected bool {image.shape} as the reference"
        )
    size = 2 * ceil(1.0 + 2.0 * blur_px) + 1
    kept = cv2.erode(array.astype(np.uint8), np.ones((size, size), dtype=np.uint8))
    return np.asarray(kept, dtype=np.bool_)
