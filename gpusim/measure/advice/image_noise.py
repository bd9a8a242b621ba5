"""Noise of a picture by its grey values, from itself or from two of a scene at rest.

Sixth differences along both axes take off whatever is smoother than two pixels, and leave of
independent noise its variance times the sum of the filter's squares, and so belong to the mean grey
value by these squares. Two pictures of a scene at rest differ by noise alone. Either way squares
are fitted by a line over the grey values: shot noise grows with them (EMVA 1288).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from gpusim.arrays.array_types import Bool, Float
from gpusim.field_summary import field_summary
from gpusim.validation import require

DIFFERENCES = np.array([1.0, -6.0, 15.0, -20.0, 15.0, -6.0, 1.0])
AT_REST = 0.1
"""px, from which on motion and not noise makes most of a difference."""


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

    Where the line would fall, noise is taken as the same at all grey values. Raises InputError if
    the ``still`` has moved.
    """
    if still is None:
        rest = _filtered(picture, DIFFERENCES) / (DIFFERENCES @ DIFFERENCES)
        grey = _filtered(picture, np.square(DIFFERENCES)) / (DIFFERENCES @ DIFFERENCES) ** 2
    else:
        rest = (still - picture - (still - picture)[used].mean()) / np.sqrt(2.0)
        grey = 0.5 * (still + picture)
        slopes = np.stack([*np.gradient(grey)], axis=-1)[used]
        moved = np.linalg.norm(np.linalg.lstsq(slopes, (picture - still)[used])[0])
        require(moved <= AT_REST, "still", f"a picture moved by {moved:.2g} px",
                "the same scene at rest, for its noise")  # fmt: skip
    square, grey = np.square(rest)[used], grey[used]
    slope = max(float(np.cov(grey, square)[0, 1] / max(grey.var(), 1e-300)), 0.0)
    return ImageNoise(float(square.mean() - slope * grey.mean()), slope)


def _filtered(picture: Float, taps: Float) -> Float:
    for axis in (0, 1):
        picture = scipy.ndimage.correlate1d(picture, taps, axis=axis)
    return picture
