"""What the pixels of a triangle share: affine functions of the offset from its anchor pixel.

Found a few thousand triangles at a time, so that everything stays in the processor's cache: large
arrays in between cost more than the arithmetic.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from gpusim.distinct import distinct
from gpusim.optics.bitmap import BitmapTable
from gpusim.optics.corners import NORMAL, ST, at_corners, barycentric_planes, corner_mean
from gpusim.optics.pattern import PatternTable
from gpusim.optics.view import View

__all__ = ["BLOCK", "Coefficients", "Found", "PerTriangle", "coefficients"]

Array = npt.NDArray[np.float64]
BLOCK = 4096


@dataclass(frozen=True, eq=False)
class Coefficients:
    """Of some triangles of a view: ``planes`` (6, 3, n), ``anchor`` (2, n), ``cell`` (2, n),
    ``mean_inverse`` (n,), as in `gpusim.optics.setup.Setup` but for the order of the axes."""

    part: slice
    planes: Array
    anchor: Array
    cell: Array
    mean_inverse: Array


def coefficients(
    view: View, table: PatternTable, bitmaps: BitmapTable, lit: bool
) -> Iterator[Coefficients]:
    """All of a view's triangles in order, `BLOCK` at a time; the arrays are used again."""
    featured = table.paints["featured"] > 0
    patterned = bool(featured.any())
    cell_of_paint = table.paints["cell"].astype(np.float64)
    all_planes, all_basis = np.zeros((6, 3, BLOCK)), np.empty((3, 3, BLOCK))
    spare, all_local = np.empty(BLOCK), np.empty((2, 3, BLOCK))
    for first in range(0, view.count, BLOCK):
        part = slice(first, min(first + BLOCK, view.count))
        count = part.stop - first
        corners = view.corners_of(part)
        own = barycentric_planes(corners, view.camera)
        planes, basis, term = all_planes[:, :, :count], all_basis[:, :, :count], spare[:count]
        inverse = [1.0 / corners[:, i, 2] for i in range(3)]
        mean_inverse = (inverse[0] + inverse[1] + inverse[2]) / 3.0
        ideal = at_corners(view.ideal_place, list(view.corner[part].T))
        at = np.rint(corner_mean(ideal)).T
        cell = np.zeros_like(at)
        values: dict[int, list[Array]] = {}
        if patterned:
            paint = view.paint[part]
            size, some = cell_of_paint[paint], featured[paint]
            st = corners[:, :, ST]
            if bitmaps.images:
                st = bitmaps.texel_positions(paint, st)
            for axis in range(2):
                across = [st[:, i, axis] for i in range(3)]
                cell[axis] = np.floor((across[0] + across[1] + across[2]) / 3.0 / size) * some
                corner = cell[axis] * size
                local = all_local[axis, :, :count]
                for i in range(3):
                    np.subtract(across[i], corner, out=local[i])
                values[axis] = list(local)
        if lit:
            for axis in range(3):
                values[3 + axis] = [corners[:, i, NORMAL.start + axis] for i in range(3)]
        scale = 1.0 / mean_inverse
        for i in range(3):
            for k in range(3):
                np.multiply(own[:, i, k], scale, out=basis[i, k])
        for k in range(3):
            np.add(basis[0, k], basis[1, k], out=planes[2, k])
            planes[2, k] += basis[2, k]
        for row, corner_values in values.items():
            for k in range(3):
                slope = planes[row, k]
                np.multiply(corner_values[0], basis[0, k], out=slope)
                for i in (1, 2):
                    np.multiply(corner_values[i], basis[i, k], out=term)
                    slope += term
        for row in (2, *values):
            for k in range(2):
                np.multiply(planes[row, k], at[k], out=term)
                planes[row, 2] += term
        yield Coefficients(part, planes, at, cell, mean_inverse)


class PerTriangle(NamedTuple):
    """Coefficients triangle by triangle, as in `gpusim.optics.setup.Setup`."""

    planes: Array
    anchor: Array
    cell: npt.NDArray[np.int64]
    mean_inverse: Array


class Found:
    """Coefficients in float64 of those triangles of a view that somebody has asked for: of few,
    where the host resolves what the device is in doubt about, and of all in the twins."""

    def __init__(self, view: View, table: PatternTable, bitmaps: BitmapTable, lit: bool) -> None:
        self._setup, count = (view, table, bitmaps, lit), view.count
        # memory that isn't written to isn't taken
        self._found = PerTriangle(
            np.zeros((count, 6, 3)), np.zeros((count, 2)), np.zeros((count, 2), np.int64),
            np.zeros(count),
        )  # fmt: skip
        self._known = np.zeros(count, bool)

    def of(self, triangles: npt.NDArray[np.int64]) -> PerTriangle:
        """Of some triangles (n,), again and again where they are."""
        self._find(distinct(triangles[~self._known[triangles]]))
        planes, anchor, cell, mean_inverse = self._found
        return PerTriangle(
            planes[triangles], anchor[triangles], cell[triangles], mean_inverse[triangles]
        )

    def all(self) -> PerTriangle:
        """Of all triangles (T,)."""
        self._find(np.flatnonzero(~self._known))
        return self._found

    def _find(self, new: npt.NDArray[np.int64]) -> None:
        if not len(new):
            return
        view, table, bitmaps, lit = self._setup
        part = view if len(new) == view.count else view.some(new)
        planes, anchor, cell, mean_inverse = self._found
        for own in coefficients(part, table, bitmaps, lit):
            rows = new[own.part]
            planes[rows] = np.moveaxis(own.planes, 2, 0)
            anchor[rows], cell[rows] = own.anchor.T, own.cell.T
            mean_inverse[rows] = own.mean_inverse
        self._known[new] = True
