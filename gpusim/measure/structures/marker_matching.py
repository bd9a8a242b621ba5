"""Markers of one image matched in another: searched to a pixel, correlated, and traced back."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import scipy

from gpusim.measure.correlation.icgn import correlate_numpy
from gpusim.measure.correlation.matching import Correlation, Pair, Settings, Status, Subsets
from gpusim.measure.correlation.pixel_search import search_template
from gpusim.measure.images import FloatArray, Image
from gpusim.measure.structures.image_patches import ImagePatches

__all__ = ["Match", "Matcher"]

BoolArray = npt.NDArray[np.bool_]


@dataclass(frozen=True)
class _StackedPair(Pair):
    """A pair whose subsets fill a small part of the patches around them."""

    def planes_at(
        self, x: npt.NDArray[np.int64], y: npt.NDArray[np.int64], size: int
    ) -> FloatArray:
        """As `Pair.planes_at`, without those of the whole pile."""
        found = np.zeros((x.size, size, size, 4))
        for i, (left, top) in enumerate(zip(x.tolist(), y.tolist(), strict=True)):
            self.fill_planes((left, top, left + size, top + size), found[i])
        return found.reshape(x.size, size * size, 4)


@dataclass(frozen=True)
class Match:
    """One marker matched from one prediction.

    coefficients : (2, 6), px.      zncc, sigma : as in `Correlation`.
    backward : distance by which the way back missed the marker, px; NaN where it wasn't tried.
    source : the marker from which it was predicted, -1: from no displacement.
    """

    coefficients: FloatArray
    zncc: float
    sigma: float
    iterations: int
    status: int
    backward: float
    source: int

    @property
    def good(self) -> bool:
        """Whether the marker was found."""
        return self.status == Status.OK


class Matcher:
    """Subsets around ``points`` (M, 2) of a reference image, to be found in a deformed one.

    All in float64 on the host: the subsets of a few dozen markers are too little work for a
    device to gain anything by it.
    """

    def __init__(
        self,
        reference: Image,
        deformed: Image,
        points: FloatArray,
        settings: Settings,
        mask: BoolArray | None,
        search_px: int,
        backward_px: float,
        blur_px: float,
    ) -> None:
        self.deformed = deformed
        self.points = points
        self.settings = settings
        self.mask = mask
        self.search_px = search_px
        self.backward_px = backward_px
        self.blur_px = blur_px
        self.reach = 1.5 * (settings.half + 2.0) + settings.max_move
        self.patches = ImagePatches.around(reference, points, self.reach, blur_px)

    def search(self, index: int, c: FloatArray) -> FloatArray:
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
        found: FloatArray = c[:, 0] + np.array([column, row], dtype=np.float64) - target
        return found

    def match(
        self, indices: Sequence[int], starts: FloatArray, sources: Sequence[int]
    ) -> list[Match]:
        """Correlate the markers ``indices`` from ``starts`` (K, 2, 6), there and back."""
        which = np.array(indices, dtype=np.int64)
        if not which.size:
            return []
        points = self.points[which]
        reference = self.patches.take(which)
        target = points + starts[:, :, 0]
        deformed = ImagePatches.around(self.deformed, target, self.reach, self.blur_px)
        mask = None if self.mask is None else reference.stacked_mask(self.mask)
        found = self._correlate(_StackedPair(reference, deformed, mask), points, starts)
        missed = np.full(len(which), np.nan)
        good = np.flatnonzero(found.status == Status.OK)
        if good.size:
            missed[good] = self._back(
                points[good], found.coefficients[good], reference.take(good), deformed.take(good)
            )
        lost = (found.status == Status.OK) & ~(missed <= self.backward_px)
        return [
            Match(
                np.full((2, 6), np.nan) if lost[k] else found.coefficients[k],
                float(found.zncc[k]),
                np.nan if lost[k] else float(found.sigma[k]),
                int(found.iterations[k]),
                int(Status.BACKWARD if lost[k] else found.status[k]),
                float(missed[k]),
                source,
            )
            for k, source in enumerate(sources)
        ]

    def _correlate(self, pair: _StackedPair, points: FloatArray, starts: FloatArray) -> Correlation:
        """`correlate_numpy` for points and displacements as in the images, not in the piles."""
        assert isinstance(pair.reference, ImagePatches) and isinstance(pair.deformed, ImagePatches)
        every = np.arange(len(points))
        before, after = pair.reference.stack_offset(every), pair.deformed.stack_offset(every)
        begin = starts.copy()
        begin[:, :, 0] += after - before
        found = correlate_numpy(Subsets(pair, points + before, begin), self.settings)
        found.coefficients[:, :, 0] -= after - before
        return found

    def _back(
        self,
        points: FloatArray,
        forward: FloatArray,
        reference: ImagePatches,
        deformed: ImagePatches,
    ) -> FloatArray:
        """Distances (K,) by which tracking from the deformed image misses the points; or NaN."""
        half = self.settings.half
        there = points + forward[:, :, 0]
        linear = np.eye(2) + forward[:, :, 1:3] / half
        inverse = np.asarray(np.linalg.inv(linear), dtype=np.float64)
        start = np.zeros_like(forward)
        start[:, :, 0] = -forward[:, :, 0]
        start[:, :, 1:3] = (inverse - np.eye(2)) * half
        mask = self._turned_mask(points, there, inverse, deformed)
        back = self._correlate(_StackedPair(deformed, reference, mask), there, start)
        return np.asarray(np.linalg.norm(there + back.coefficients[:, :, 0] - points, axis=1))

    def _turned_mask(
        self, points: FloatArray, there: FloatArray, inverse: FloatArray, deformed: ImagePatches
    ) -> BoolArray | None:
        """The reference mask as it lies over the subsets in the deformed image, as a pile."""
        if self.mask is None:
            return None
        offset = np.arange(deformed.size)
        height, width = self.mask.shape
        parts = []
        for point, at, turn, corner in zip(points, there, inverse, deformed.corners, strict=True):
            dx, dy = corner[0] + offset[None, :] - at[0], corner[1] + offset[:, None] - at[1]
            x = np.rint(point[0] + turn[0, 0] * dx + turn[0, 1] * dy).astype(np.int64)
            y = np.rint(point[1] + turn[1, 0] * dx + turn[1, 1] * dy).astype(np.int64)
            inside = (x >= 0) & (x < width) & (y >= 0) & (y < height)
            parts.append(inside & self.mask[np.where(inside, y, 0), np.where(inside, x, 0)])
        return np.concatenate(parts)
