"""Pixels that carry no measurement: masked, not a number, or saturated over an area.

A single white pixel of a speckle pattern at full scale does no harm, a highlight does: it stays
where the lamp is while the pattern moves. So a saturated pixel counts as unusable only where a
whole square of ``BLOB`` px around it is saturated; a binary pattern of black and white stays
usable as long as its white parts are smaller than that.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from gpusim.errors import InputError
from gpusim.measure.correlation.matching import Status
from gpusim.measure.images import FloatArray, Image, check_image, pixels_of

__all__ = ["MaskedImage", "full_scale", "masked_image"]

BoolArray = npt.NDArray[np.bool_]

BLOB = 0.4  # width of a saturated area that isn't pattern any more, over the subset's width
RIM = 2  # px around such an area over which its edge disturbs the interpolation
DEPTHS = (8, 10, 12, 14, 16)  # bits of cameras
# share of pixels at the highest level that makes it full scale and not chance
MIN_SATURATED_SHARE = 1e-4


@dataclass(frozen=True)
class MaskedImage:
    """An image without NaN, and where it can be used.

    image : (H, W), the image; pixels that aren't numbers hold the median of the others. Floats and
        integers of more than 16 bits are scaled to -1 … 1, see `_scaled`.
    masked : (H, W) bool, True = masked out or not a number; None = nowhere.
    saturated : (H, W) bool, True = within a saturated area; None = nowhere.
    """

    image: Image
    masked: BoolArray | None
    saturated: BoolArray | None

    @property
    def good(self) -> BoolArray | None:
        """(H, W) bool, True = usable; None if all are."""
        bad = [part for part in (self.masked, self.saturated) if part is not None]
        return ~np.logical_or.reduce(bad) if bad else None

    def reasons(self, points: FloatArray, half: int) -> npt.NDArray[np.int8]:
        """Why subsets at ``points`` (M, 2) in this image can't be used: (M,) ``Status``.

        OUTSIDE where a subset leaves the image; otherwise what takes more of its pixels.
        """
        height, width = self.image.shape
        column, row = np.rint(points[:, 0]), np.rint(points[:, 1])
        inside = (column >= half) & (column < width - half)
        inside &= (row >= half) & (row < height - half)
        status = np.full(len(points), Status.OUTSIDE, dtype=np.int8)
        x, y = column[inside].astype(np.int64), row[inside].astype(np.int64)
        masked, saturated = (
            np.zeros(x.size) if part is None else _share(part, x, y, half)
            for part in (self.masked, self.saturated)
        )
        some = np.maximum(masked, saturated) > 0
        reason = np.where(saturated > masked, Status.SATURATED, Status.MASKED)
        status[inside] = np.where(some, reason, Status.OUTSIDE)
        return status

    def parts_at(self, positions: FloatArray) -> BoolArray:
        """Whether the pixels at positions (M, 2, n) are masked, and saturated: (M, n, 2)."""
        height, width = self.image.shape
        column, row = (
            np.clip(np.rint(np.nan_to_num(positions[:, axis], nan=-1.0)), 0, size - 1).astype(int)
            for axis, size in ((0, width), (1, height))
        )
        parts = np.zeros((*column.shape, 2), dtype=bool)
        for k, part in enumerate((self.masked, self.saturated)):
            if part is not None:
                parts[..., k] = part[row, column]
        return parts

    def bad_at(self, positions: FloatArray) -> BoolArray:
        """Whether the pixels at positions (M, 2, n) can't be used: (M, n)."""
        return np.asarray(self.parts_at(positions).any(axis=-1))


def masked_image(
    image: object,
    name: str,
    subset: int,
    mask: npt.NDArray[Any] | None = None,
    saturation: float | None = None,
) -> MaskedImage:
    """Check an image, fill what isn't a number and find its saturated areas.

    ``saturation`` is the lowest saturated grey level; None: ``full_scale`` of the image.
    """
    array = pixels_of(image)
    # of the type that the camera's have, and without what is masked
    given_pixels = array
    if isinstance(image, np.ma.MaskedArray):
        given_pixels = np.where(np.ma.getmaskarray(image), 0, np.ma.getdata(image))
    bad: BoolArray | None = None
    if array.ndim == 2 and array.dtype.kind == "f" and array.size:
        bad = ~np.isfinite(array)
        if bad.any() and not bad.all():
            array = np.where(bad, np.median(array[~bad]), array).astype(array.dtype)
        elif not bad.any():
            bad = None
    array = check_image(array, name)
    if mask is not None:
        given = np.asarray(mask)
        if given.dtype != np.bool_ or given.shape != array.shape:
            raise InputError(
                f"mask: got {given.dtype} {given.shape}; expected bool {array.shape} as the "
                f"{name} image"
            )
        bad = ~given if bad is None else bad | ~given
    if saturation is None:
        level = full_scale(given_pixels)
    elif np.isfinite(saturation):
        level = float(saturation)
    else:
        raise InputError(f"saturation: got {saturation!r}; expected a finite grey level or None")
    if level is None or not float(array.max()) >= level:
        return MaskedImage(_scaled(array), bad, None)
    size = max(5, 2 * round(0.5 * BLOB * subset) + 1)
    hot = (array >= level).astype(np.uint8)
    square = np.ones((size, size), dtype=np.uint8)
    opened = cv2.morphologyEx(hot, cv2.MORPH_OPEN, square)
    rim = np.ones((2 * RIM + 1, 2 * RIM + 1), dtype=np.uint8)
    area: BoolArray = np.asarray(cv2.dilate(opened, rim), dtype=np.bool_)
    return MaskedImage(_scaled(array), bad, area if area.any() else None)


def _scaled(image: Image) -> Image:
    """Grey values of any size as -1 … 1: what is measured depends neither on an offset nor on a
    factor, but sums of squares do, once rounding or the smallest number of a type matters."""
    kind = image.dtype
    if kind.kind in "ui" and kind.itemsize <= 2:
        return image
    low, high = float(image.min()), float(image.max())
    values = image.astype(np.float64)
    values -= 0.5 * low + 0.5 * high
    if high > low:
        values /= 0.5 * high - 0.5 * low
    return values.astype(np.float32) if kind.kind == "f" and kind.itemsize <= 4 else values


def full_scale(image: Image) -> float | None:
    """The level at which a camera of 8, 10, 12, 14 or 16 bits saturates, if this image does.

    Integer images only: the highest value must be 2^bits - 1, or that shifted into the upper
    bits of 16 as some cameras deliver it, and more than a few pixels must have it.
    """
    if image.dtype.kind not in "ui":
        return None
    top = int(image.max())
    levels = {(1 << bits) - 1 for bits in DEPTHS}
    levels |= {((1 << bits) - 1) << (16 - bits) for bits in DEPTHS}
    if top not in levels or np.count_nonzero(image == top) < MIN_SATURATED_SHARE * image.size:
        return None
    return float(top)


def _share(part: BoolArray, x: npt.NDArray[Any], y: npt.NDArray[Any], half: int) -> FloatArray:
    """Share of True in squares of 2 half + 1 px around pixels inside."""
    table = cv2.integral(part.astype(np.uint8), sdepth=cv2.CV_64F)
    x0, x1, y0, y1 = x - half, x + half + 1, y - half, y + half + 1
    total = table[y1, x1] - table[y0, x1] - table[y1, x0] + table[y0, x0]
    return np.asarray(total / (2 * half + 1) ** 2)
