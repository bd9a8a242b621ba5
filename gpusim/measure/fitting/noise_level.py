"""How noisy a picture is, as its flattest parts show, and what that allows a fit to leave."""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt

__all__ = ["allowed_residual", "noise_level"]

FloatArray = npt.NDArray[np.float64]

WINDOW = 7  # px: noise that neighbours share keeps most of its variance in it
FLAT = 0.2  # share of a picture that is taken as flat, or next to it
RMS_ALLOWANCE = 1.3  # RMS over the noise: chance, and what a level that is too low by a tenth lacks
MIN_CLEAR = 0.35  # noise over the contrast beyond which nothing may be left for it


def noise_level(image: npt.NDArray[np.float32]) -> float:
    """Standard deviation of the noise, in the image's (H, W) grey levels.

    The lower quintile of the standard deviations in windows of 7 x 7 px; 0 for smaller images.
    """
    if min(image.shape) < WINDOW:
        return 0.0
    even = image - np.float32(image.mean())
    size = (WINDOW, WINDOW)
    mean = cv2.boxFilter(even, cv2.CV_64F, size)
    square = cv2.sqrBoxFilter(even, cv2.CV_64F, size)
    half = WINDOW // 2
    variance = (square - mean * mean)[half:-half, half:-half] * (WINDOW**2 / (WINDOW**2 - 1.0))
    return float(np.sqrt(max(float(np.quantile(variance, FLAT)), 0.0)))


def allowed_residual(most: float, noise: float, contrast: float | FloatArray) -> FloatArray:
    """RMS over the contrast that a fit may leave: ``most`` without noise, more with it."""
    share = noise / np.maximum(np.abs(contrast), 1e-300)
    more = np.where(share <= MIN_CLEAR, RMS_ALLOWANCE * share, 0.0)
    return np.asarray(np.hypot(most, more))
