"""The grey profile of a straight black-white border, integrated over square pixels.

A step seen through a Gaussian lens and integrated over the pixel's square, which a border at an
angle sees as a trapezoid: two boxes of widths |n_x| and |n_y| of the border's unit normal n. Two
box integrals of the Gaussian step are second differences of its second antiderivative.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.special import ndtr

__all__ = ["profile_and_slopes", "slope_by_turn"]

FloatArray = npt.NDArray[np.float64]

FLAT_SIGMAS = 8.3  # 1 - 1e-16 of the Gaussian step
MIN_BOX = 1e-3  # px, narrower sides of the pixel box are widened to this


def profile_and_slopes(
    distance: FloatArray, normal: FloatArray, sigma: FloatArray | float
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
    """The profile -1..1 and its derivatives by the distance, sigma, |normal_x|, |normal_y|.

    ``distance`` (…, P) in px from the border to the pixel centres, ``normal`` (…, 2) its unit
    normal, ``sigma`` (…) the blur in px: the leading axes are borders of their own.
    """
    sides = np.maximum(np.abs(normal), MIN_BOX)
    wide, narrow, blur = (
        np.broadcast_to(np.asarray(value, np.float64)[..., None], distance.shape)
        for value in (sides[..., 0], sides[..., 1], sigma)
    )
    value = np.sign(distance)
    by_distance, by_sigma, by_wide, by_narrow = np.zeros((4, *distance.shape))
    # further away the profile is flat to the last digit
    near = np.abs(distance) < 0.5 * (wide + narrow) + FLAT_SIGMAS * blur
    wide, narrow, blur = wide[near], narrow[near], blur[near]
    plus, minus = 0.5 * (wide + narrow), 0.5 * (wide - narrow)
    z = distance[near] + np.stack([plus, minus, -minus, -plus])
    q = z / blur
    step = ndtr(q)
    density = np.exp(-0.5 * q * q) / np.sqrt(2 * np.pi)
    # antiderivatives of the step; the second one is z^2/2 for z >> sigma, 0 for z << -sigma
    once = z * step + blur * density
    twice = 0.5 * (z * once + blur * blur * step)
    area = wide * narrow
    total = twice[0] - twice[1] - twice[2] + twice[3]
    value[near] = 2.0 * total / area - 1.0
    by_distance[near] = 2.0 * (once[0] - once[1] - once[2] + once[3]) / area
    by_sigma[near] = 2.0 * blur * (step[0] - step[1] - step[2] + step[3]) / area
    by_wide[near] = (once[0] - once[1] + once[2] - once[3] - 2.0 * total / wide) / area
    by_narrow[near] = (once[0] + once[1] - once[2] - once[3] - 2.0 * total / narrow) / area
    return value, by_distance, by_sigma, by_wide, by_narrow


def slope_by_turn(
    profile: tuple[FloatArray, ...],
    normal: FloatArray,
    change: FloatArray,
    dx: FloatArray,
    dy: FloatArray,
) -> FloatArray:
    """Derivative of a border profile by its angle; ``change`` (…,2) is that of the ``normal``."""
    _, by_distance, _, by_wide, by_narrow = profile
    # the pixel's box, where it isn't held at its least width
    box = np.sign(normal) * change * (np.abs(normal) > MIN_BOX)
    result: FloatArray = (
        by_distance * (dx * change[..., :1] + dy * change[..., 1:])
        + by_wide * box[..., :1]
        + by_narrow * box[..., 1:]
    )
    return result
