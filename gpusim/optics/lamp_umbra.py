"""Where casters hide all of a lamp: cells of its view that a sheet of them covers without a gap.

Deep in the shadow of a bumpy surface no single face, and no single bump, hides the lamp by itself:
many do in turn, and the edges at which the shadow of one ends lie in that of another. Faces that
share edges and turn the same side to the lamp are a sheet, which in the lamp's view (p, q, s) lies
over p and q like a map: over a cell that no border of it enters it covers all, or nothing. What is
below such a sheet is dark. A ray to another point of the lamp's face runs aslant through several
cells: it meets a sheet if that goes on from cell to cell.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
import numpy.typing as npt
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from gpusim.distinct import distinct
from gpusim.optics.casters import Casters
from gpusim.optics.lamp_grid import LampGrid
from gpusim.optics.lamp_view import Reach
from gpusim.optics.ragged import expand
from gpusim.optics.windows import Windows

__all__ = ["Umbra"]

Array = npt.NDArray[np.float64]
Numbers = npt.NDArray[np.int64]
Flags = npt.NDArray[np.bool_]


class Umbra:
    """How low, in each cell of a ``grid``, a sheet is that covers the cell."""

    def __init__(self, grid: LampGrid, casters: Casters) -> None:
        self.grid = grid
        box, cell = grid.cells()
        middle, half = grid.rectangles(cell)
        rim, links = _links(grid, casters)
        met, centre, cut = np.ones((3, len(box)), bool)
        cut[:] = False
        for k, (gap, width) in enumerate(grid.beside(box, middle, half)):
            met &= gap <= width
            centre &= gap <= 0.0
            cut |= rim[:, k][box] & (np.abs(gap) <= width)
        known = grid.outlined[box]
        label = self._sheets(links, met)
        count = int(label.max(initial=-1)) + 1
        torn = np.zeros(count, bool)
        torn[label[met & (cut | ~known)]] = True
        low = np.full(count, np.inf)
        np.minimum.at(low, label[met], grid.reach.s[0][box[met]])
        covers = np.flatnonzero(met & centre & known & ~torn[label])
        # the highest one of each cell
        covers = covers[np.argsort(low[label[covers]], kind="stable")]
        cells = int(grid.shape.prod())
        self._best = np.full(cells, -1)
        self._best[cell[covers]] = label[covers]
        self._low = np.append(low, -np.inf)[self._best]
        self._nodes = box, cell, label, met

    def _sheets(self, links: Numbers, met: Flags) -> Numbers:
        """(n,): number of the sheet, within one cell, of casters in cells: ``met`` (n,) where they
        may lie in them; ``links`` (m, 2) casters that go on in each other."""
        grid = self.grid
        wide, tall = grid.last - grid.first + 1
        start = np.cumsum(wide * tall) - wide * tall
        one, other = links.T
        first = np.maximum(grid.first[:, one], grid.first[:, other])
        across, down = np.minimum(grid.last[:, one], grid.last[:, other]) - first + 1
        link, offset = expand(np.maximum(across, 0) * np.maximum(down, 0))
        row, column = np.divmod(offset, across[link])
        column += first[0][link]
        row += first[1][link]
        ends = []
        for side in (one, other):
            caster = side[link]
            place = (row - grid.first[1][caster]) * wide[caster] + column - grid.first[0][caster]
            ends.append(start[caster] + place)
        both = np.flatnonzero(met[ends[0]] & met[ends[1]])
        graph = coo_array(
            (np.ones(len(both), bool), (ends[0][both], ends[1][both])), shape=(len(met), len(met))
        )
        return np.asarray(connected_components(graph, directed=False)[1], np.int64)

    def hides(self, reach: Reach) -> Flags:
        """(n,) whether all of the lamp is hidden from all of receivers in boxes; never wrong."""
        usable = np.flatnonzero(np.isfinite(reach.s[0]))
        first, last = self.grid.window(reach[usable])
        below = -self._lowest.highest(first, last) > reach.s[1][usable]
        below &= (last >= first).all(axis=0)
        rows = np.flatnonzero(below)
        if self.grid.view.lamp.extended:
            rows = rows[~self._torn(first[:, rows], last[:, rows])]
        result = np.zeros(reach.s.shape[1], bool)
        result[usable[rows]] = True
        return result

    @cached_property
    def _lowest(self) -> Windows:
        return Windows(-self._low.reshape(self.grid.shape))

    def _torn(self, first: Numbers, last: Numbers) -> Flags:
        """(n,) whether sheets don't go on from cell to cell in windows (2, n) of cells."""
        result = np.zeros(first.shape[1], bool)
        for axis, sums in enumerate(self._gaps):
            (left, top), (right, bottom) = first, last
            # between the cells of a window only
            right, bottom = (right, bottom + 1) if axis == 0 else (right + 1, bottom)
            total = sums[bottom, right] - sums[top, right] - sums[bottom, left] + sums[top, left]
            result |= total > 0
        return result

    @cached_property
    def _gaps(self) -> list[Numbers]:
        """Sums, up to each row and column, of cells that don't go on to the right, and below."""
        grid = self.grid
        box, cell, label, met = self._nodes
        rows, columns = (int(n) for n in grid.shape)
        own = met & (label == self._best[cell])
        wide = (grid.last - grid.first + 1)[0][box]
        column, row = cell % columns, cell // columns
        result = []
        for axis, (step, place) in enumerate(((np.ones_like(wide), column), (wide, row))):
            node = np.flatnonzero(own & (place < grid.last[axis][box]))
            after = node + step[node]
            node = node[own[after]]
            middle, half = grid.rectangles(cell[node])
            middle[axis] = middle[axis] + half[axis]  # of the side between both
            inside = np.ones(len(node), bool)
            for gap, _ in grid.beside(box[node], middle, half):
                inside &= gap <= 0.0
            open_ = np.ones(rows * columns, np.int64)
            open_[cell[node[inside]]] = 0
            sums = np.zeros((rows + 1, columns + 1), np.int64)
            sums[1:, 1:] = open_.reshape(rows, columns).cumsum(axis=0).cumsum(axis=1)
            result.append(sums)
        return result


def _links(grid: LampGrid, casters: Casters) -> tuple[Flags, Numbers]:
    """Edges (n, 4) at which sheets of a grid's casters end, and casters (m, 2) across others."""
    number = np.full(len(casters.faces), -1)
    number[grid.face] = np.arange(grid.count)
    one, place = number[casters.edge[:, 0]], casters.edge[:, 1]
    other = np.where(casters.beside >= 0, number[np.maximum(casters.beside, 0)], -1)
    known = np.flatnonzero((one >= 0) & (casters.beside != -2))
    one, place, other = one[known], place[known], other[known]
    alike = (other >= 0) & (grid.side[other] == grid.side[one]) & (grid.side[one] != 0)
    rim = grid.rim.copy()
    rim[one[~alike], place[~alike]] = True
    one, other = one[alike], other[alike]
    # the faces of joined ones meet in several edges
    pair = distinct((one * grid.count + other)[one < other])
    return rim, np.stack(np.divmod(pair, max(grid.count, 1)), axis=1)
