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


def image_noise(picture: Float, still: Float | None, used: Bool) -> ImageNoise:
    """Noise of a picture (H, W) where ``used`` is True; from another one if there is a ``still``.

    Where the line would fall, noise is taken as the same at all grey values.
    """
    if still is None:
        rest = scipy.ndimage.correlate1d(picture, DIFFERENCES, axis=0)
        rest = scipy.ndimage.correlate1d(rest, DIFFERENCES, axis=1) / (DIFFERENCES @ DIFFERENCES)
    else:
        rest = (still - picture - (still - picture)[used].mean()) / np.sqrt(2.0)
    square = np.square(rest)[used]
    grey = scipy.ndimage.uniform_filter(picture, GREY_WINDOW)[used]
    slope = max(float(np.cov(grey, square)[0, 1] / max(grey.var(), 1e-300)), 0.0)
    return ImageNoise(float(square.mean() - slope * grey.mean()), slope)
