"""What the pixels of a triangle share: affine functions of the offset from its anchor pixel.

Found a few thousand triangles at a time, so that everything stays in the processor's cache: large
arrays in between cost more than the arithmetic.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from gpusim.optics.bitmap import BitmapTable
from gpusim.optics.corners import corner_mean
from gpusim.optics.pattern import PatternTable
from gpusim.optics.view import NORMAL, ST, View

__all__ = ["BLOCK", "Coefficients", "coefficients"]

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
    patterned = bool((table.paints["featured"] > 0).any())
    rows = [*((0, 1) if patterned else ()), 2, *((3, 4, 5) if lit else ())]
    all_planes = np.zeros((6, 3, BLOCK))
    ideal = view.ideal
    for first in range(0, view.count, BLOCK):
        part = slice(first, min(first + BLOCK, view.count))
        corners, own = view.corners[part], view.planes[part]
        planes = all_planes[:, :, : part.stop - first]
        inverse = [1.0 / corners[:, i, 2] for i in range(3)]
        mean_inverse = (inverse[0] + inverse[1] + inverse[2]) / 3.0
        at = np.rint(corner_mean(ideal[part])).T
        cell = np.zeros_like(at)
        local: list[Array] = []
        if patterned:
            record = table.paints[view.paint[part]]
            size = record["cell"].astype(np.float64)
            st = bitmaps.texel_positions(view.paint[part], corners[:, :, ST])
            cell = np.floor(corner_mean(st).T / size) * (record["featured"] > 0)
            local = [st[:, i].T - cell * size for i in range(3)]
        scale = 1.0 / mean_inverse
        basis = [[own[:, i, k] * scale for k in range(3)] for i in range(3)]
        for row in rows:
            for k in range(3):
                if row == 2:
                    slope = basis[0][k] + basis[1][k] + basis[2][k]
                elif row < 2:
                    slope = local[0][row] * basis[0][k] + local[1][row] * basis[1][k]
                    slope += local[2][row] * basis[2][k]
                else:
                    value = NORMAL.start + row - 3
                    slope = corners[:, 0, value] * basis[0][k] + corners[:, 1, value] * basis[1][k]
                    slope += corners[:, 2, value] * basis[2][k]
                planes[row, k] = slope
            planes[row, 2] = planes[row, 2] + planes[row, 0] * at[0] + planes[row, 1] * at[1]
        yield Coefficients(part, planes, at, cell, mean_inverse)
