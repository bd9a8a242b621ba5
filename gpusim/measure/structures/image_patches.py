"""Small parts of one image, one below the other in a single spline image.

Markers fill a small part of a large picture. Their surroundings are filtered together in one pass,
and subsets of all of them can be matched at once, each within its own part.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil

import numpy as np
import numpy.typing as npt
import scipy

from gpusim.measure.images import FloatArray, Image
from gpusim.measure.interpolation import BLUR_REACH, PAD, SLACK, SplineImage

__all__ = ["ImagePatches"]

BoolArray = npt.NDArray[np.bool_]

MARGIN = 20  # pixels around a part: what happens at its border has faded to 5e-8 there
MIN_PIXELS = 8  # pixels of the image in a part


@dataclass(frozen=True)
class ImagePatches(SplineImage):
    """M parts of S x S pixels; positions are those of the pile, see ``stack_offset``.

    Attributes
    ----------
    size : S.
    corners : (M, 2) int64, position x, y of each part's first pixel in the image.
    limits : (M, 4) float64, the box x0, y0, x1, y1 of each part, from its first pixel, in which
        interpolation equals that of the whole image.
    """

    size: int
    corners: npt.NDArray[np.int64]
    limits: FloatArray

    @classmethod
    def around(
        cls, image: Image, centres: FloatArray, reach: float, blur_px: float
    ) -> ImagePatches:
        """Parts that can be read up to ``reach`` px beside ``centres`` (M, 2), blurred first.

        Beyond the image's border it is continued, point-reflected, but not valid.
        """
        height, width = image.shape
        margin = MARGIN + ceil(BLUR_REACH * blur_px)
        half = ceil(reach) + margin
        size = 2 * half + 1
        # a centre far outside any image has no part of it
        bound = 4.0 * (height + width + size)
        corners = np.rint(np.clip(centres, -bound, bound)).astype(np.int64) - half
        pixels = np.stack([_part(image, int(x), int(y), size) for x, y in corners])
        if blur_px > 0:
            for axis in (1, 2):
                pixels = scipy.ndimage.gaussian_filter1d(
                    pixels, blur_px, axis=axis, mode="mirror", truncate=BLUR_REACH
                )
        filtered = pixels
        for axis in (1, 2):
            filtered = scipy.ndimage.spline_filter1d(filtered, order=5, axis=axis, mode="mirror")
        low = np.maximum(margin, -corners)
        high = np.minimum(size - 1 - margin, np.array([width, height]) - 1 - corners)
        return cls(
            pixels=pixels.reshape(-1, size),
            coefficients=np.pad(filtered.reshape(-1, size), PAD),
            origin=(0, 0),
            valid=(0.0, 0.0, size - 1.0, len(corners) * size - 1.0),
            size=size,
            corners=corners,
            limits=np.concatenate([low, high], axis=1).astype(np.float64),
        )

    def take(self, which: npt.NDArray[np.int64]) -> ImagePatches:
        """The parts ``which`` (K,) alone."""
        inner = self.coefficients[PAD:-PAD, PAD:-PAD]
        pixels, coefficients = (
            a.reshape(-1, self.size, self.size)[which].reshape(-1, self.size)
            for a in (self.pixels, inner)
        )
        return ImagePatches(
            pixels=pixels,
            coefficients=np.pad(coefficients, PAD),
            origin=(0, 0),
            valid=(0.0, 0.0, self.size - 1.0, len(which) * self.size - 1.0),
            size=self.size,
            corners=self.corners[which],
            limits=self.limits[which],
        )

    def stacked_mask(self, mask: BoolArray) -> BoolArray:
        """The parts of a mask (H, W) of the image, False outside, one below the other."""
        offset = np.arange(self.size)
        x, y = (self.corners[:, k, None] + offset for k in range(2))
        inside_x, inside_y = (x >= 0) & (x < mask.shape[1]), (y >= 0) & (y < mask.shape[0])
        x, y = np.where(inside_x, x, 0), np.where(inside_y, y, 0)
        parts = mask[y[:, :, None], x[:, None, :]] & inside_y[:, :, None] & inside_x[:, None, :]
        return np.asarray(parts.reshape(-1, self.size))

    def stack_offset(self, which: npt.NDArray[np.int64]) -> FloatArray:
        """What to add to positions in the image for those in the parts ``which`` (K,): (K, 2)."""
        shift = -self.corners[which].astype(np.float64)
        shift[:, 1] += which * self.size
        return shift

    def inside(self, x: FloatArray, y: FloatArray) -> BoolArray:
        """Whether each position lies in the valid box of its part, or within ``SLACK`` of it."""
        row = np.nan_to_num(y, nan=-1.0) // self.size
        known = (row >= 0) & (row < len(self.limits))
        part = np.where(known, row, 0).astype(np.int64)
        own = y - part * self.size
        x0, y0, x1, y1 = (self.limits[part, k] for k in range(4))
        return np.asarray(
            known
            & (x >= x0 - SLACK) & (x <= x1 + SLACK)
            & (own >= y0 - SLACK) & (own <= y1 + SLACK)
        )  # fmt: skip


def _part(image: Image, x: int, y: int, size: int) -> FloatArray:
    """A square of ``size`` px from (x, y); zeros if the image has next to nothing of it."""
    height, width = image.shape
    x0, x1, y0, y1 = max(x, 0), min(x + size, width), max(y, 0), min(y + size, height)
    if min(x1 - x0, y1 - y0) < MIN_PIXELS:
        return np.zeros((size, size))
    part = image[y0:y1, x0:x1].astype(np.float64)
    missing = (y0 - y, y + size - y1), (x0 - x, x + size - x1)
    if np.any(missing):
        part = np.pad(part, missing, mode="reflect", reflect_type="odd")
    return part
