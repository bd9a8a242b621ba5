"""Which triangle a camera sees at any place of its image, between pixel centres too.

Point location by buckets: the image without the lens's distortion, in which edges are straight, is
cut into square cells, each with the triangles whose boxes touch it. Of those that a ray meets the
nearest is seen. All in float64, exact to rounding; no picture is rasterised.
"""

from __future__ import annotations

import numpy as np

from gpusim.arrays.array_types import Float, Long
from gpusim.arrays.ragged import batches, expand
from gpusim.optics.geometry.view import View

_CELLS = 3.0, 64.0
"""Least and largest side of a cell, px; between them it is a third of a triangle's."""
_CHUNK = 1 << 20
"""Pairs of a place and a triangle that are looked at together."""
_ON_EDGE = 1e-9
"""Share of the inverse depth by which a place may lie outside a triangle and still be on it."""


class PointLocation:
    """The triangles of a ``view`` by where in its image they are."""

    def __init__(self, view: View) -> None:
        self.view = view
        width, height = view.camera.width, view.camera.height
        border = np.array([[-0.5, -0.5], [width - 0.5, -0.5], [-0.5, height - 0.5],
                           [width - 0.5, height - 0.5]])  # fmt: skip
        ideal = view.ideal
        low, high = ideal.min(axis=1, initial=np.inf), ideal.max(axis=1, initial=-np.inf)
        # a lens that bends outwards shows more than its corners do: half as much again
        image = np.nan_to_num(view.camera.undistort(border), posinf=0.0, neginf=0.0)
        reach = 0.5 * np.ptp(image, axis=0)
        self._low = np.maximum(low.min(axis=0, initial=np.inf), image.min(axis=0) - reach)
        top = np.minimum(high.max(axis=0, initial=-np.inf), image.max(axis=0) + reach)
        self._cell = float(np.clip(np.sqrt(2.0 * view.mean_pixels) / 3.0, *_CELLS))
        extent = np.nan_to_num(top - self._low, posinf=0.0, neginf=0.0)
        self._shape = np.maximum(np.ceil(extent / self._cell), 0.0).astype(np.int64)
        self._planes = view.planes_of(slice(None)) if len(ideal) else np.zeros((0, 3, 3))
        self._first, self._triangles = self._buckets(low, high)

    def _buckets(self, low: Float, high: Float) -> tuple[Long, Long]:
        """Triangles cell after cell, and where each cell's begin; from their boxes (T, 2) px."""
        last = self._shape - 1
        begin = np.floor((low - self._low) / self._cell)
        end = np.floor((high - self._low) / self._cell)
        inside = np.flatnonzero(((end >= 0) & (begin <= last)).all(axis=1))
        begin = np.clip(begin[inside], 0, last).astype(np.int64)
        wide, tall = (np.clip(end[inside], 0, last).astype(np.int64) - begin + 1).T
        owner, place = expand(wide * tall)
        row, column = np.divmod(place, wide[owner])
        cell = (begin[owner, 1] + row) * self._shape[0] + begin[owner, 0] + column
        order = np.argsort(cell, kind="stable")
        first = np.zeros(int(np.prod(self._shape)) + 1, np.int64)
        np.cumsum(np.bincount(cell, minlength=len(first) - 1), out=first[1:])
        return first, inside[owner[order]]

    def nearest(self, pixels: Float) -> tuple[Long, Float]:
        """The triangle of the view (n,) that is seen at ``pixels`` (n, 2), -1 for none, and the
        inverse (n,) of its depth there, 0 for none. Places needn't be inside the image."""
        triangle, inverse = np.full(len(pixels), -1, np.int64), np.zeros(len(pixels))
        ideal = self.view.camera.undistort(pixels)
        with np.errstate(invalid="ignore"):
            cell = np.floor((ideal - self._low) / self._cell)
            there = np.flatnonzero(((cell >= 0) & (cell < self._shape)).all(axis=1))
        column, row = cell[there].astype(np.int64).T
        number = row * self._shape[0] + column
        first, count = self._first[number], self._first[number + 1] - self._first[number]
        for part in batches(count, _CHUNK):
            found = self._of(ideal[there[part]], first[part], count[part])
            triangle[there[part]], inverse[there[part]] = found
        return triangle, inverse

    def _of(self, ideal: Float, first: Long, count: Long) -> tuple[Long, Float]:
        """The same of ``ideal`` places (n, 2) whose cells have ``count`` triangles from ``first``
        on."""
        owner, place = expand(count)
        candidates = self._triangles[np.repeat(first, count) + place]
        x, y = (np.take(column, owner) for column in ideal.T)
        depth, inside = np.zeros(len(owner)), np.full(len(owner), np.inf)
        for rows in np.moveaxis(self._planes, 0, 2):
            # column by column: arrays with short axes take three times as long
            along, across, rest = (np.take(coefficient, candidates) for coefficient in rows)
            share = along * x + across * y + rest
            depth += share
            np.minimum(inside, share, out=inside)
        hit = np.flatnonzero((inside >= -_ON_EDGE * depth) & (depth > 0.0))
        # the nearest one last, so that it is the one that stays
        order = hit[np.argsort(depth[hit], kind="stable")]
        triangle, inverse = np.full(len(ideal), -1, np.int64), np.zeros(len(ideal))
        triangle[owner[order]] = candidates[order]
        inverse[owner[order]] = depth[order]
        return triangle, inverse
