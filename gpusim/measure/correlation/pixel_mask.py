"""Pixels that carry no measurement: masked, not a number, or saturated over an area.

A single white pixel of a speckle pattern at full scale does no harm, a highlight does: it stays
where the lamp is while the pattern moves. So a saturated pixel counts as unusable only where a
whole square of ``BLOB`` px around it is saturated; a binary pattern of black and white stays
usable as long as its white parts are smaller than that.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
import scipy

from gpusim.arrays.array_types import Bool, Float, Long
from gpusim.arrays.grey import grey_of
from gpusim.errors import InputError
from gpusim.measure.correlation.matching import Correlation, Settings, Status
from gpusim.measure.correlation.warp import basis
from gpusim.measure.images import Image, check_image, pixels_of
from gpusim.validation import require

BLOB = 0.4  # width of a saturated area that isn't pattern any more, over the subset's width
RIM = 2  # px around such an area over which its edge disturbs the interpolation
DEPTHS = (8, 10, 12, 14, 16)  # bits of cameras
# share of pixels at the highest level that makes it full scale and not chance
MIN_SATURATED_SHARE = 1e-4
MAX_COVERED_SHARE = 0.02  # share of a subset in the deformed image that may be unusable
# a subset that ended like this may have met with something that covers the deformed image
UNEXPLAINED = (Status.NOT_CONVERGED, Status.LOW_CORRELATION, Status.NO_GUESS, Status.INCOHERENT)
PROBES = 9  # positions across a subset at which that is looked up


@dataclass(frozen=True)
class MaskedImage:
    """An image without NaN, and where it can be used.

    image : (H, W), the image; pixels that aren't numbers hold the median of the others. Floats and
        integers of more than 16 bits are scaled to -1 … 1, see `_scaled`.
    masked : (H, W) bool, True = masked out or not a number; None = nowhere.
    saturated : (H, W) bool, True = within a saturated area; None = nowhere.
    """

    image: Image
    masked: Bool | None
    saturated: Bool | None

    @property
    def good(self) -> Bool | None:
        """(H, W) bool, True = usable; None if all are."""
        bad = [part for part in (self.masked, self.saturated) if part is not None]
        return ~np.logical_or.reduce(bad) if bad else None

    def reasons(self, points: Float, half: int) -> npt.NDArray[np.int8]:
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
            np.zeros(x.size) if part is None else box_means(part.astype(np.uint8), x, y, half)
            for part in (self.masked, self.saturated)
        )
        some = np.maximum(masked, saturated) > 0
        reason = np.where(saturated > masked, Status.SATURATED, Status.MASKED)
        status[inside] = np.where(some, reason, Status.OUTSIDE)
        return status

    def parts_at(self, positions: Float) -> Bool:
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
    pixels = pixels_of(image)
    array = grey_of(pixels)
    # of the type that the camera's have, and without what is masked
    given_pixels = pixels
    if isinstance(image, np.ma.MaskedArray):
        given_pixels = np.where(np.ma.getmaskarray(image), 0, np.ma.getdata(image))
    bad: Bool | None = None
    if array.ndim == 2 and array.dtype.kind == "f" and array.size:
        bad = ~np.isfinite(array)
        if bad.any() and not bad.all():
            array = np.where(bad, np.median(array[~bad]), array).astype(array.dtype)
        elif not bad.any():
            bad = None
    array = check_image(array, name)
    if mask is not None:
        given = _given_mask(mask, array, f"the {name} image")
        bad = ~given if bad is None else bad | ~given
    if saturation is None:
        level = full_scale(given_pixels)
    elif np.isfinite(saturation):
        level = float(saturation)
    else:
        raise InputError(f"saturation: got {saturation!r}; expected a finite grey level or None")
    # in colour, of any channel
    brightest = array if pixels.ndim == 2 else pixels.max(axis=2)
    if level is None or not (hot := brightest >= level).any():
        return MaskedImage(_scaled(array), bad, None)
    size = max(5, 2 * round(0.5 * BLOB * subset) + 1)
    square = np.ones((size, size), dtype=np.uint8)
    opened = cv2.morphologyEx(hot.astype(np.uint8), cv2.MORPH_OPEN, square)
    rim = np.ones((2 * RIM + 1, 2 * RIM + 1), dtype=np.uint8)
    area: Bool = np.asarray(cv2.dilate(opened, rim), dtype=np.bool_)
    return MaskedImage(_scaled(array), bad, area if area.any() else None)


def _given_mask(mask: npt.NDArray[Any], image: Image, whose: str) -> Bool:
    array = np.asarray(mask)
    fits = array.dtype == np.bool_ and array.shape == image.shape
    require(fits, "mask", f"{array.dtype} {array.shape}", f"bool {image.shape} as {whose}")
    return array


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


def box_means(values: npt.NDArray[Any], x: Long, y: Long, half: int) -> Float:
    """Means over squares of 2 half + 1 px around pixels inside."""
    table = cv2.integral(values, sdepth=cv2.CV_64F)
    x0, x1, y0, y1 = x - half, x + half + 1, y - half, y + half + 1
    total = table[y1, x1] - table[y0, x1] - table[y1, x0] + table[y0, x0]
    return np.asarray(total / (2 * half + 1) ** 2)


def without_pixels(points: Float, shape: tuple[int, ...], half: int, mask: Bool | None) -> Bool:
    """(M,) bool: points whose subset leaves an image of ``shape``, or is masked altogether."""
    place = np.rint(points)
    last = np.array(shape[::-1]) - 1 - half
    closed = np.asarray(((place < half) | (place > last)).any(axis=1))
    if mask is not None:
        x, y = place[~closed].astype(np.int64).T
        closed[~closed] = box_means(mask.astype(np.uint8), x, y, half) == 0.0
    return closed


def check_mask(mask: npt.NDArray[Any] | None, image: Image, blur_px: float) -> Bool | None:
    """Check that a mask is boolean and as large as the reference image, and shrink it.

    Pixels next to what is masked out are dropped too, as far as the interpolation and the blur
    mix them with it: 1 px + 2 standard deviations.
    """
    if mask is None:
        return None
    array = _given_mask(mask, image, "the reference")
    size = 2 * ceil(1.0 + 2.0 * blur_px) + 1
    kept = cv2.erode(array.astype(np.uint8), np.ones((size, size), dtype=np.uint8))
    return np.asarray(kept, dtype=np.bool_)


def name_failures(
    matches: Correlation,
    points: Float,
    settings: Settings,
    first: MaskedImage,
    second: MaskedImage,
) -> None:
    """Name subsets that are masked or saturated, in the reference or where they went to, and those
    that left the deformed image."""
    half = settings.half
    lost = np.flatnonzero(np.isin(matches.status, (Status.OUTSIDE, Status.NO_GUESS)))
    if lost.size and (first.masked is not None or first.saturated is not None):
        reasons = first.reasons(points[lost], half)
        named = reasons != Status.OUTSIDE
        matches.status[lost[named]] = reasons[named]
    # what wasn't found went with its nearest neighbour, as far as anybody can tell
    known = np.flatnonzero(matches.ok)
    if not known.size:
        return
    covers = second.masked is not None or second.saturated is not None
    unknown = np.isin(matches.status, UNEXPLAINED)
    asked = np.flatnonzero(unknown | (matches.ok & covers))
    if not asked.size:
        return
    guide = known[scipy.spatial.cKDTree(points[known]).query(points[asked])[1]]
    # at whole pixels: halfway between two, the last bit of a motion would choose
    offset = np.rint(np.linspace(-half, half, PROBES)) / half
    a, b = (axis.ravel() for axis in np.meshgrid(offset, offset))
    c = matches.coefficients[guide]
    here = points[asked][:, :, None] + half * np.stack([a, b])
    away = (points[asked] - points[guide]) / half
    motion = c @ basis(a, b, 6) + np.einsum("mij,mj->mi", c[:, :, 1:3], away)[:, :, None]
    there = here + motion
    last = np.array(second.image.shape[::-1])[:, None] - 0.5
    gone = ~((there >= -0.5) & (there <= last)).all(axis=(1, 2))
    gone &= unknown[asked] & (matches.status[asked] != Status.INCOHERENT)
    matches.status[asked[gone]] = Status.OUTSIDE
    if not covers:
        return
    # what the reference leaves out anyway may be covered: white patches of the pattern itself
    used = ~first.parts_at(here).any(axis=-1, keepdims=True)
    masked, saturated = (
        (part & used).sum(axis=(1, 2)) / np.maximum(used.sum(axis=(1, 2)), 1)
        for part in np.split(second.parts_at(there), 2, axis=-1)
    )
    covered = (masked + saturated > MAX_COVERED_SHARE) & ~gone
    reason = np.where(saturated > masked, Status.SATURATED, Status.MASKED)
    matches.refuse(asked[covered], reason[covered])
