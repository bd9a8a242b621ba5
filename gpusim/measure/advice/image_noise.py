"""Noise of a picture by its grey values, from itself or from two of a scene at rest.

Sixth differences along both axes take off whatever is smoother than two pixels, and leave of
independent noise its variance times the sum of the filter's squares. Two pictures of a scene at
rest differ by noise alone. Either way squares are fitted by a line over the grey values: shot noise
grows with them (EMVA 1288).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from gpusim.arrays.array_types import Bool, Float
from gpusim.field_summary import field_summary

DIFFERENCES = np.array([1.0, -6.0, 15.0, -20.0, 15.0, -6.0, 1.0])
GREY_WINDOW = 7  # px, over which the grey value that noise belongs to is averaged


@dataclass(frozen=True)
class ImageNoise:
    """Variance of a picture's noise: ``offset`` + ``slope`` x grey value, in squared grey levels.

    Examples
    --------
    >>> noise = gs.measure.ImageNoise(offset=1.0, slope=0.02)
    >>> float(noise.variance(np.array(150.0)))
    4.0
    """

    offset: float
    slope: float = 0.0
    __repr__ = field_summary

    def variance(self, grey: Float) -> Float:
        """Squared grey levels, from zero up."""
        return np.maximum(self.offset + self.slope * grey, 0.0)


def image_noise(picture: Float, still: Float | None, area: Bool) -> ImageNoise:
    """Noise of a picture (H, W) where ``area`` is True; from another one if there is a ``still``.

    The line is one from zero up; where it would fall, noise is alike everywhere.
    """
    square = picture
    if still is None:
        for axis in (0, 1):
            square = scipy.ndimage.correlate1d(square, DIFFERENCES, axis=axis)
        square = np.square(square / (DIFFERENCES @ DIFFERENCES))
    else:
        change = (still - picture)[area]
        square = 0.5 * np.square(still - picture - change.mean())
    grey = scipy.ndimage.uniform_filter(picture, GREY_WINDOW)[area]
    square = square[area]
    slope, offset = np.polynomial.Polynomial.fit(grey, square, 1).convert().coef[::-1]
    low = offset + slope * grey.min()
    if slope < 0 or low < 0:
        slope, offset = (0.0, square.mean()) if slope < 0 else (square.mean() / grey.mean(), 0.0)
    return ImageNoise(float(offset), float(slope))
