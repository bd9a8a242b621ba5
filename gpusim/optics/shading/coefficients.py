"""What the pixels of a triangle share: affine functions of the offset from its anchor pixel.

Found a few thousand triangles at a time, so that everything stays in the processor's cache: large
arrays in between cost more than the arithmetic.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from gpusim.arrays.array_types import Float, Long
from gpusim.arrays.unique import distinct
from gpusim.optics.camera.undistortion_table import undistorted
from gpusim.optics.geometry.triangle_corners import (
    NORMAL,
    ST,
    at_corners,
    barycentric_planes,
    corner_mean,
)
from gpusim.optics.geometry.view import View
from gpusim.optics.paint.bitmap import BitmapTable
from gpusim.optics.paint.feature_grid import FeatureGrid

BLOCK = 4096


@dataclass(frozen=True, eq=False)
class Coefficients:
    """Of some triangles of a view: ``planes`` (6, 3, n), ``anchor`` (2, n), ``cell`` (2, n),
    ``mean_inverse`` (n,), as in `PerTriangle` but for the order of the axes."""

    part: slice
    planes: Float
    anchor: Float
    cell: Float
    mean_inverse: Float


def coefficients(
    view: View, table: FeatureGrid, bitmaps: BitmapTable, lit: bool
) -> Iterator[Coefficients]:
    """All of a view's triangles in order, `BLOCK` at a time; the arrays are used again."""
    featured = table.paints["featured"] > 0
    patterned = bool(featured.any())
    cell_of_paint = table.paints["cell"].astype(np.float64)
    rows = [*([0, 1] if patterned else []), 2, *([3, 4, 5] if lit else [])]
    all_values, all_planes = np.ones((6, 3, BLOCK)), np.zeros((6, 3, BLOCK))
    for first in range(0, view.count, BLOCK):
        part = slice(first, min(first + BLOCK, view.count))
        corners = view.corners_of(part)
        count = len(corners)
        # of all corners what is affine in the image; of the reciprocal depth 1
        values, planes = all_values[:, :, :count], all_planes[:, :, :count]
        inverse = [1.0 / corners[:, i, 2] for i in range(3)]
        mean_inverse = (inverse[0] + inverse[1] + inverse[2]) / 3.0
        ideal = at_corners(view.ideal_place, list(view.corner[part].T))
        at = np.rint(corner_mean(ideal)).T
        cell = np.zeros_like(at)
        if patterned:
            paint = view.paint[part]
            size, printed = cell_of_paint[paint], featured[paint]
            st = corners[:, :, ST]
            if bitmaps.images:
                st = bitmaps.texel_positions(paint, st)
            cell[:] = np.floor(corner_mean(st).T / size) * printed
            values[:2] = st.T - (cell * size)[:, None]
        if lit:
            values[3:] = corners[:, :, NORMAL].T
        basis = np.moveaxis(barycentric_planes(corners, view.camera), 0, 2) * (1.0 / mean_inverse)
        for row in rows:
            plane = planes[row]
            np.multiply(values[row, 0], basis[0], out=plane)
            plane += values[row, 1] * basis[1]
            plane += values[row, 2] * basis[2]
            plane[2] += plane[0] * at[0]
            plane[2] += plane[1] * at[1]
        yield Coefficients(part, planes, at, cell, mean_inverse)


class PerTriangle(NamedTuple):
    """Coefficients triangle by triangle.

    ``planes`` (T, 6, 3): s, t, w and the three normal components as affine functions of (dx, dy,
    1), the offset from ``anchor`` (T, 2), whole px of the ideal image; ``cell`` (T, 2): the pattern
    cell that s and t are relative to; ``mean_inverse`` (T,): 1 / depth that w is relative to.
    """

    planes: Float
    anchor: Float
    cell: Long
    mean_inverse: Float


class CoefficientCache:
    """Coefficients in float64 of those triangles of a view that somebody has asked for: of few,
    where the host resolves what the device is in doubt about, and of all in the twins."""

    def __init__(self, view: View, table: FeatureGrid, bitmaps: BitmapTable, lit: bool) -> None:
        self._setup = view, table, bitmaps, lit
        # of each triangle its row + 1 among those found, which take no more room than they are
        self._row = np.zeros(view.count, np.int64)
        self._found = _none(0)

    def of(self, triangles: Long) -> PerTriangle:
        """Of some triangles (n,), again and again where they are."""
        new = distinct(triangles[self._row[triangles] == 0])
        if len(new):
            more = self._coefficients(self._setup[0].some(new), len(new))
            before = self._found
            self._row[new] = np.arange(1, len(new) + 1) + len(before.anchor)
            self._found = PerTriangle(
                np.concatenate([before.planes, more.planes]),
                np.concatenate([before.anchor, more.anchor]),
                np.concatenate([before.cell, more.cell]),
                np.concatenate([before.mean_inverse, more.mean_inverse]),
            )
        row, (planes, anchor, cell, mean_inverse) = self._row[triangles] - 1, self._found
        return PerTriangle(planes[row], anchor[row], cell[row], mean_inverse[row])

    def footprint(
        self, triangle: Long, x: Float, y: Float
    ) -> tuple[Long, Float, Float, Float, Float]:
        """At pixel positions, (n, 2) each: pattern cell, paint position in it, the change of this
        along the sides of a pixel's sensitive square, and the relative change of 1 / z along these.
        """
        ideal, change = undistorted(self._setup[0].camera, np.stack([x, y], axis=1))
        planes, anchor, cell, _ = self.of(triangle)
        d = ideal - anchor
        values = planes[:, :3, 0] * d[:, :1] + planes[:, :3, 1] * d[:, 1:] + planes[:, :3, 2]
        w = values[:, 2:3]
        st = values[:, :2] / w
        ex = (planes[:, :2, 0] - st * planes[:, 2:3, 0]) / w
        ey = (planes[:, :2, 1] - st * planes[:, 2:3, 1]) / w
        turned = np.stack([ex, ey], axis=2) @ change
        q = np.einsum("ni,nik->nk", planes[:, 2, :2] / w, change)
        return cell, st, turned[:, :, 0], turned[:, :, 1], q

    @cached_property
    def all(self) -> PerTriangle:
        """Of all triangles (T,)."""
        view = self._setup[0]
        self._found = self._coefficients(view, view.count)
        self._row = np.arange(1, view.count + 1)
        return self._found

    def _coefficients(self, view: View, count: int) -> PerTriangle:
        result = _none(count)
        for block in coefficients(view, *self._setup[1:]):
            result.planes[block.part] = np.moveaxis(block.planes, 2, 0)
            result.anchor[block.part], result.cell[block.part] = block.anchor.T, block.cell.T
            result.mean_inverse[block.part] = block.mean_inverse
        return result


def _none(count: int) -> PerTriangle:
    """Of so many triangles, nothing yet."""
    return PerTriangle(
        np.empty((count, 6, 3)), np.empty((count, 2)), np.empty((count, 2), np.int64),
        np.empty(count),
    )  # fmt: skip
