"""The grey profile of a straight black-white border, integrated over square pixels.

A step seen through a Gaussian lens and integrated over the pixel's square, which a border at an
angle sees as a trapezoid: two boxes of widths |n_x| and |n_y| of the border's unit normal n. Two
box integrals of the Gaussian step are second differences of its second antiderivative.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import scipy

__all__ = ["EdgeSamples", "box_by_turn", "near_border", "profile_and_slopes", "slope_by_turn"]

FloatArray = npt.NDArray[np.float64]

FLAT_SIGMAS = 7.0  # 1 - 1e-12 of the Gaussian step
MIN_BOX = 1e-3  # px, narrower sides of the pixel box are widened to this


@dataclass(frozen=True)
class EdgeSamples:
    """Profiles where they aren't flat: N of the pixels around B borders.

    ``pixel`` (N,) places among all (B, P), one after the other; ``border`` (N,); ``value`` (N,)
    -1..1 and its derivatives (N,) by the distance, the variance, |normal_x| and |normal_y|.
    """

    pixel: npt.NDArray[np.int64]
    border: npt.NDArray[np.int64]
    value: FloatArray
    by_distance: FloatArray
    by_variance: FloatArray
    by_wide: FloatArray
    by_narrow: FloatArray


def near_border(distance: FloatArray, normal: FloatArray, variance: FloatArray) -> EdgeSamples:
    """`profile_and_slopes` at those of the pixels (B, P) that are near their border."""
    sides = np.maximum(np.abs(normal), MIN_BOX)
    sigma = np.sqrt(variance)
    # further away the profile is flat to the last digits
    reach = 0.5 * (sides[:, 0] + sides[:, 1]) + FLAT_SIGMAS * sigma
    near = np.flatnonzero(np.abs(distance) < reach[:, None])
    border = near // distance.shape[1]
    half = 0.5 * (sides[:, 0] + sides[:, 1]), 0.5 * (sides[:, 0] - sides[:, 1])
    offset = np.stack([half[0], half[1], -half[1], -half[0]])
    z = distance.ravel()[near] + offset[:, border]
    blur = sigma[border]
    q = z / blur
    step = scipy.special.ndtr(q)
    density = np.exp(-0.5 * q * q)
    density *= blur / np.sqrt(2 * np.pi)
    # antiderivatives of the step; the second one is z^2/2 for z >> sigma, 0 for z << -sigma
    once = z * step + density
    twice = z * once + blur * blur * step
    wide, narrow = sides[border].T
    area = wide * narrow
    # sums over the four ends of the trapezoid, halved in ``twice``
    inner, outer = once[1] + once[2], once[0] + once[3]
    across, along = once[0] - once[3], once[1] - once[2]
    total = 0.5 * (twice[0] - twice[1] - twice[2] + twice[3])
    return EdgeSamples(
        pixel=near,
        border=border,
        value=2.0 * total / area - 1.0,
        by_distance=2.0 * (outer - inner) / area,
        by_variance=(step[0] - step[1] - step[2] + step[3]) / area,
        by_wide=(across - along - 2.0 * total / wide) / area,
        by_narrow=(across + along - 2.0 * total / narrow) / area,
    )


def profile_and_slopes(
    distance: FloatArray, normal: FloatArray, variance: FloatArray | float
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
    """The profile -1..1 and its derivatives by the distance, the variance, |normal_x|, |normal_y|.

    ``distance`` (…, P) in px from the border to the pixel centres, ``normal`` (…, 2) its unit
    normal, ``variance`` (…) of the blur in px^2, above 0: the leading axes are borders of their
    own. The variance, not sigma: a profile changes with it in proportion even where it is small.
    """
    shape = distance.shape
    flat = np.ascontiguousarray(distance, np.float64).reshape(-1, shape[-1])
    blur = np.broadcast_to(np.asarray(variance, np.float64), shape[:-1]).ravel()
    near = near_border(flat, normal.reshape(-1, 2), blur)
    value, slopes = np.sign(flat), np.zeros((4, *shape))
    value.ravel()[near.pixel] = near.value
    every = near.by_distance, near.by_variance, near.by_wide, near.by_narrow
    for all_pixels, own in zip(slopes.reshape(4, -1), every, strict=True):
        all_pixels[near.pixel] = own
    return value.reshape(shape), slopes[0], slopes[1], slopes[2], slopes[3]


def slope_by_turn(
    profile: tuple[FloatArray, ...],
    normal: FloatArray,
    change: FloatArray,
    dx: FloatArray,
    dy: FloatArray,
) -> FloatArray:
    """Derivative of a border profile by its angle; ``change`` (…,2) is that of the ``normal``."""
    _, by_distance, _, by_wide, by_narrow = profile
    box = box_by_turn(normal, change)
    result: FloatArray = (
        by_distance * (dx * change[..., :1] + dy * change[..., 1:])
        + by_wide * box[..., :1]
        + by_narrow * box[..., 1:]
    )
    return result


def box_by_turn(normal: FloatArray, change: FloatArray) -> FloatArray:
    """Derivatives (…, 2) of the pixel box's sides, where they aren't held at their least width."""
    result: FloatArray = np.sign(normal) * change * (np.abs(normal) > MIN_BOX)
    return result
