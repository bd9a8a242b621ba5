"""Markers of one image matched in another: searched to a pixel, correlated, and traced back.

Markers fill a small part of a large picture. Their surroundings are filtered together in one pass,
one below the other in a single spline image, and subsets of all of them are matched at once, each
within its own part.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from math import ceil

import numpy as np
import scipy

from gpusim.arrays.array_types import Bool, Float, Long
from gpusim.measure.correlation.icgn import correlate_numpy
from gpusim.measure.correlation.image_pair import Pair, Subsets
from gpusim.measure.correlation.matching import Correlation, Settings, Status
from gpusim.measure.correlation.start_values import search_template
from gpusim.measure.images import BLUR_REACH, PAD, SLACK, Image, SplineImage

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
    corners: Long
    limits: Float

    @classmethod
    def around(cls, image: Image, centres: Float, reach: float, blur_px: float) -> ImagePatches:
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

    def take(self, which: Long) -> ImagePatches:
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

    def stacked_mask(self, mask: Bool) -> Bool:
        """The parts of a mask (H, W) of the image, False outside, one below the other."""
        offset = np.arange(self.size)
        x, y = (self.corners[:, k, None] + offset for k in range(2))
        inside_x, inside_y = (x >= 0) & (x < mask.shape[1]), (y >= 0) & (y < mask.shape[0])
        x, y = np.where(inside_x, x, 0), np.where(inside_y, y, 0)
        parts = mask[y[:, :, None], x[:, None, :]] & inside_y[:, :, None] & inside_x[:, None, :]
        return np.asarray(parts.reshape(-1, self.size))

    def stack_offset(self, which: Long) -> Float:
        """What to add to positions in the image for those in the parts ``which`` (K,): (K, 2)."""
        shift = -self.corners[which].astype(np.float64)
        shift[:, 1] += which * self.size
        return shift

    def inside(self, x: Float, y: Float) -> Bool:
        """Whether each position lies in the valid box of its part, or within ``SLACK`` of it."""
        row = np.nan_to_num(y, nan=-1.0) // self.size
        known = (row >= 0) & (row < len(self.limits))
        part = np.where(known, row, 0).astype(np.int64)
        row_in_part = y - part * self.size
        x0, y0, x1, y1 = (self.limits[part, k] for k in range(4))
        return np.asarray(
            known
            & (x >= x0 - SLACK) & (x <= x1 + SLACK)
            & (row_in_part >= y0 - SLACK) & (row_in_part <= y1 + SLACK)
        )  # fmt: skip


def _part(image: Image, x: int, y: int, size: int) -> Float:
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


@dataclass(frozen=True)
class Matches(Correlation):
    """Markers matched, each from one prediction.

    backward : (M,) float64, distance by which the way back missed the marker, px; NaN where it
        wasn't tried.
    source : (M,) int64, the marker from which each was predicted, -1: from no displacement.
    """

    backward: Float
    source: Long

    @staticmethod
    def none(count: int) -> Matches:
        """``count`` markers of which nothing is known."""
        nothing = vars(Correlation.unmatched(count))
        return Matches(**nothing, backward=np.full(count, np.nan), source=np.full(count, -1))


@dataclass(frozen=True, eq=False)
class Matcher:
    """Subsets around ``points`` (M, 2) of a reference image, to be found in a deformed one.

    All in float64 on the host: the subsets of a few dozen markers are too little work for a
    device to gain anything by it.
    """

    reference: Image
    deformed: Image
    points: Float
    settings: Settings
    mask: Bool | None
    search_px: int
    backward_px: float
    blur_px: float

    @cached_property
    def patches(self) -> ImagePatches:
        """The surroundings of the points in the reference."""
        return self._around(self.reference, self.points)

    def _around(self, image: Image, places: Float) -> ImagePatches:
        """As far around places (K, 2) as a subset there may look."""
        reach = 1.5 * (self.settings.half + 2.0) + self.settings.max_move
        return ImagePatches.around(image, places, reach, self.blur_px)

    def search(self, index: int, c: Float) -> Float:
        """Displacement near the prediction ``c`` (2, 6) where the turned template fits best."""
        half, point = self.settings.half, self.points[index]
        offset = np.arange(-half, half + 1, dtype=np.float64)
        a, b = np.meshgrid(offset, offset)
        linear = np.eye(2) + c[:, 1:3] / half
        if not abs(np.linalg.det(linear)) > 0.1:
            return c[:, 0].copy()
        target = np.rint(point + c[:, 0])
        inverse = np.linalg.inv(linear)
        # the template's centre pixel shows the point moved by ``lag``
        lag = target - (point + c[:, 0])
        left, top = point - self.patches.corners[index]
        x = left + inverse[0, 0] * (a + lag[0]) + inverse[0, 1] * (b + lag[1])
        y = top + inverse[1, 0] * (a + lag[0]) + inverse[1, 1] * (b + lag[1])
        x0, y0, x1, y1 = self.patches.limits[index]
        if not (x0 <= x1 and y0 <= y1):
            return c[:, 0].copy()
        rows = slice(index * self.patches.size, (index + 1) * self.patches.size)
        # between pixels linearly: the search is for whole pixels, and the picture is blurred
        template = scipy.ndimage.map_coordinates(
            self.patches.pixels[rows], [np.clip(y, y0, y1), np.clip(x, x0, x1)], order=1
        )
        column, row, score = search_template(
            template, self.deformed, (int(target[0]), int(target[1])), self.search_px
        )
        if score < 0:
            return c[:, 0].copy()
        displacement: Float = c[:, 0] + np.array([column, row], dtype=np.float64) - target
        return displacement

    def match(self, indices: Sequence[int], starts: Float, sources: Sequence[int]) -> Matches:
        """Correlate the markers ``indices`` from ``starts`` (K, 2, 6), there and back."""
        which = np.array(indices, dtype=np.int64)
        if not which.size:
            return Matches.none(0)
        points = self.points[which]
        reference = self.patches.take(which)
        deformed = self._around(self.deformed, points + starts[:, :, 0])
        mask = None if self.mask is None else reference.stacked_mask(self.mask)
        forward = self._correlate(Pair(reference, deformed, mask, sparse=True), points, starts)
        missed = np.full(len(which), np.nan)
        good = np.flatnonzero(forward.ok)
        if good.size:
            missed[good] = self._back(
                points[good], forward.coefficients[good], reference.take(good), deformed.take(good)
            )
        forward.refuse(forward.ok & ~(missed <= self.backward_px), Status.BACKWARD)
        return Matches(**vars(forward), backward=missed, source=np.array(sources, dtype=np.int64))

    def _correlate(self, pair: Pair, points: Float, starts: Float) -> Correlation:
        """`correlate_numpy` for points and displacements as in the images, not in the piles."""
        assert isinstance(pair.reference, ImagePatches) and isinstance(pair.deformed, ImagePatches)
        every = np.arange(len(points))
        before, after = pair.reference.stack_offset(every), pair.deformed.stack_offset(every)
        begin = starts.copy()
        begin[:, :, 0] += after - before
        correlation = correlate_numpy(Subsets(pair, points + before, begin), self.settings)
        correlation.coefficients[:, :, 0] -= after - before
        return correlation

    def _back(
        self,
        points: Float,
        forward: Float,
        reference: ImagePatches,
        deformed: ImagePatches,
    ) -> Float:
        """Distances (K,) by which tracking from the deformed image misses the points; or NaN."""
        half = self.settings.half
        targets = points + forward[:, :, 0]
        linear = np.eye(2) + forward[:, :, 1:3] / half
        inverse = np.asarray(np.linalg.inv(linear), dtype=np.float64)
        start = np.zeros_like(forward)
        start[:, :, 0] = -forward[:, :, 0]
        start[:, :, 1:3] = (inverse - np.eye(2)) * half
        mask = self._turned_mask(points, targets, inverse, deformed)
        back = self._correlate(Pair(deformed, reference, mask, sparse=True), targets, start)
        return np.asarray(np.linalg.norm(targets + back.coefficients[:, :, 0] - points, axis=1))

    def _turned_mask(
        self, points: Float, targets: Float, inverse: Float, deformed: ImagePatches
    ) -> Bool | None:
        """The reference mask as it lies over the subsets in the deformed image, as a pile."""
        if self.mask is None:
            return None
        offset = np.arange(deformed.size)
        height, width = self.mask.shape
        parts = []
        for point, at, turn, corner in zip(points, targets, inverse, deformed.corners, strict=True):
            dx, dy = corner[0] + offset[None, :] - at[0], corner[1] + offset[:, None] - at[1]
            x = np.rint(point[0] + turn[0, 0] * dx + turn[0, 1] * dy).astype(np.int64)
            y = np.rint(point[1] + turn[1, 0] * dx + turn[1, 1] * dy).astype(np.int64)
            inside = (x >= 0) & (x < width) & (y >= 0) & (y < height)
            parts.append(inside & self.mask[np.where(inside, y, 0), np.where(inside, x, 0)])
        return np.concatenate(parts)
