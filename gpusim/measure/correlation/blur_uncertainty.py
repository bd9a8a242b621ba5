"""How uncertain matches of blurred images are: noise that a blur has made small and correlated.

A blur G takes white noise n to G n: its variance shrinks to the sum of G's squares, and so does
what a match leaves as residuals. But neighbouring pixels now err together, and a displacement comes
from sums over many: with the slopes J of the blurred image its variance is J^T G G^T J over
(J^T J)^2, times that of the noise, where independent residuals would give 1 over J^T J.
"""

from __future__ import annotations

from math import sqrt

import cv2
import numpy as np
import scipy

from gpusim.measure.images import FloatArray
from gpusim.measure.interpolation import BLUR_REACH, SplineImage

__all__ = ["noise_factor"]

MIN_SHARE = 1e-3  # of the slopes' energy that a second blur leaves


def noise_factor(blurred: SplineImage, points: FloatArray, half: int, blur_px: float) -> FloatArray:
    """Standard uncertainty over that from the residuals alone, of subsets at ``points`` (M, 2).

    ``blurred`` is the reference after a Gaussian of ``blur_px``. The slopes along the axis that
    fares worse are taken, the window as a square. 1 without a blur.
    """
    if not blur_px > 0:
        return np.ones(len(points))
    reach = int(np.ceil(BLUR_REACH * blur_px))
    kernel = np.exp(-0.5 * (np.arange(-reach, reach + 1) / blur_px) ** 2)
    kernel /= kernel.sum()
    pixels = blurred.pixels
    height, width = pixels.shape
    column = np.clip(np.rint(points[:, 0]).astype(np.int64) - blurred.origin[0], 0, width - 1)
    row = np.clip(np.rint(points[:, 1]).astype(np.int64) - blurred.origin[1], 0, height - 1)
    left, right = np.maximum(column - half, 0), np.minimum(column + half + 1, width)
    top, bottom = np.maximum(row - half, 0), np.minimum(row + half + 1, height)
    shares = []
    for axis in (0, 1):
        slope = np.gradient(pixels, axis=axis)
        again = scipy.ndimage.gaussian_filter(slope, sqrt(2.0) * blur_px, truncate=BLUR_REACH)
        sums = []
        for product in (slope * again, slope * slope):
            table = cv2.integral(product, sdepth=cv2.CV_64F)
            sums.append(
                table[bottom, right] - table[top, right] - table[bottom, left] + table[top, left]
            )
        shares.append(sums[0] / np.maximum(sums[1], 1e-300))
    share = np.clip(np.maximum(*shares), MIN_SHARE, 1.0)
    return np.asarray(np.sqrt(share) / np.square(kernel).sum())
