"""Where sheets of casters hide all of a lamp, and where none: in cells of its view.

Faces that share edges and turn the same side to the lamp are a sheet, which in the lamp's view
(p, q, s) lies over p and q like a map: over a cell that no border of it enters it covers all, once.
What is below it is dark; what is on it is lit, unless something else is above. Deep in the shadow
of a bumpy surface no single face, and no single bump, hides the lamp: many do in turn, and the
edges at which the shadow of one ends lie in that of another. And beside any point of a bent surface
there are faces that rise above it, of which each would have to be looked at.

A ray to a point of a lamp's face runs aslant through several cells: it meets a sheet below which it
begins if that goes on from cell to cell, and none on which it begins, as the whole lamp is before
the planes of its faces.
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

__all__ = ["Sheets"]

Array = npt.NDArray[np.float64]
Numbers = npt.NDArray[np.int64]
Flags = npt.NDArray[np.bool_]


CELLS = 64
"""That receivers lie in at most of which is looked for whether they are lit."""


class Sheets:
    """Of each cell of a ``grid`` the highest sheet that covers it, how low that is, and how high
    everything else."""

    def __init__(self, grid: LampGrid, casters: Casters) -> None:
        self.grid = grid
        self._into = np.append(_numbers(grid, casters), -1)[casters.into]
        self._wide, tall = grid.last - grid.first + 1
        self._start = np.cumsum(self._wide * tall) - self._wide * tall
        box, cell = grid.cells()
        rim, links = _links(grid, casters)
        met, centre, cut = np.ones((3, len(box)), bool)
        cut[:] = False
        middle, half = grid.rectangles(cell)
        for k, (gap, width) in enumerate(grid.beside(box, middle, half)):
            met &= gap <= width
            centre &= gap <= 0.0
            cut |= rim[:, k][box] & (np.abs(gap) <= width)
        known = grid.outlined[box]
        label = self._labels(links, met)
        count = int(label.max(initial=-1)) + 1
        torn = np.zeros(count, bool)
        torn[label[met & (cut | ~known)]] = True
        low = np.full(count, np.inf)
        np.minimum.at(low, label[met], grid.reach.s[0][box[met]])
        covers = np.flatnonzero(met & centre & known & ~torn[label])
        # the highest one of each cell
        covers = covers[np.argsort(low[label[covers]], kind="stable")]
        cells = int(grid.shape.prod())
        best = np.full(cells, -1)
        best[cell[covers]] = label[covers]
        others = np.flatnonzero(met & (label != best[cell]))
        self._others = np.full(cells, -np.inf)
        np.maximum.at(self._others, cell[others], grid.highest[box[others]])
        self._low = np.append(low, -np.inf)[best]
        self._box, self._cell, self._met = box, cell, met
        self._own = met & (label == best[cell])

    def _labels(self, links: Numbers, met: Flags) -> Numbers:
        """(n,): number of the sheet, within one cell, of casters in cells: ``met`` (n,) where they
        may lie in them; ``links`` (m, 2) casters that go on in each other."""
        grid = self.grid
        one, other = links.T
        first = np.maximum(grid.first[:, one], grid.first[:, other])
        across, down = np.minimum(grid.last[:, one], grid.last[:, other]) - first + 1
        link, offset = expand(np.maximum(across, 0) * np.maximum(down, 0))
        row, column = np.divmod(offset, across[link])
        column += first[0][link]
        row += first[1][link]
        ends = [self._node(side[link], column, row) for side in (one, other)]
        both = np.flatnonzero(met[ends[0]] & met[ends[1]])
        graph = coo_array(
            (np.ones(len(both), bool), (ends[0][both], ends[1][both])), shape=(len(met), len(met))
        )
        return np.asarray(connected_components(graph, directed=False)[1], np.int64)

    def _node(self, caster: Numbers, column: Numbers, row: Numbers) -> Numbers:
        """Place among all casters in cells of some casters (n,) in cells that they are filed in."""
        first = self.grid.first
        place = (row - first[1][caster]) * self._wide[caster] + column - first[0][caster]
        return np.asarray(self._start[caster] + place)

    def hides(self, reach: Reach) -> Flags:
        """(n,) whether all of the lamp is hidden from all of receivers in boxes; never wrong."""
        usable = np.flatnonzero(np.isfinite(reach.s[0]))
        first, last = self.grid.window(reach[usable])
        below = -self._lowest.highest(first, last) > reach.s[1][usable]
        below &= (last >= first).all(axis=0)
        return self._whole(reach, usable, below, first, last)

    def shows(self, reach: Reach, face: Numbers) -> Flags:
        """(n,) whether nothing hides any of the lamp from receivers in boxes, each on one of the
        surfaces' faces (n,); never wrong."""
        own = self._into[face]
        usable = np.flatnonzero(np.isfinite(reach.s[0]) & (own >= 0).all(axis=1))
        some, own = reach[usable], own[usable]
        first, last = self.grid.around(some)
        wide, tall = last - first + 1
        lit = (wide > 0) & (tall > 0) & (wide * tall <= CELLS)
        box, offset = expand(np.where(lit, wide * tall, 0))
        row, column = np.divmod(offset, wide[box])
        column += first[0][box]
        row += first[1][box]
        found = np.zeros(len(usable), bool)
        for caster in own.T:
            filed = caster[box]
            inside = np.ones(len(box), bool)
            for axis, place in enumerate((column, row)):
                inside &= self.grid.first[axis][filed] <= place
                inside &= self.grid.last[axis][filed] >= place
            at = np.flatnonzero(inside)
            node = self._node(filed[at], column[at], row[at])
            # a face that isn't in a cell has no receiver there
            at, node = at[self._met[node]], node[self._met[node]]
            found[box[at]] = True
            lit[box[at[~self._own[node]]]] = False
        first, last = self.grid.window(some)
        lit &= found & (self._highest.highest(first, last) <= some.s[0])
        return self._whole(reach, usable, lit, first, last)

    def _whole(
        self, reach: Reach, usable: Numbers, flags: Flags, first: Numbers, last: Numbers
    ) -> Flags:
        """``flags`` of the boxes ``usable`` as those of all, where sheets go on from cell to cell
        in windows (2, n), if that counts."""
        rows = np.flatnonzero(flags)
        if self.grid.view.lamp.extended:
            rows = rows[~self._torn(first[:, rows], last[:, rows])]
        result = np.zeros(reach.s.shape[1], bool)
        result[usable[rows]] = True
        return result

    @cached_property
    def _lowest(self) -> Windows:
        return Windows(-self._low.reshape(self.grid.shape))

    @cached_property
    def _highest(self) -> Windows:
        return Windows(self._others.reshape(self.grid.shape))

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
        grid, box, cell, own = self.grid, self._box, self._cell, self._own
        rows, columns = (int(n) for n in grid.shape)
        row, column = np.divmod(cell, columns)
        result = []
        for axis, place in enumerate((column, row)):
            node = np.flatnonzero(own & (place < grid.last[axis][box]))
            after = node + (1 if axis == 0 else self._wide[box[node]])
            node = node[own[after]]
            middle, half = grid.rectangles(cell[node])
            middle[axis] = middle[axis] + half[axis]  # of the side between both
            inside = np.ones(len(node), bool)
            for gap, _ in grid.beside(box[node], middle, half):
                inside &= gap <= 0.0
            ends = np.ones(rows * columns, np.int64)
            ends[cell[node[inside]]] = 0
            sums = np.zeros((rows + 1, columns + 1), np.int64)
            sums[1:, 1:] = ends.reshape(rows, columns).cumsum(axis=0).cumsum(axis=1)
            result.append(sums)
        return result


def _numbers(grid: LampGrid, casters: Casters) -> Numbers:
    """Which of a grid's casters each of all casters is; -1 for none."""
    number = np.full(len(casters.faces), -1)
    number[grid.face] = np.arange(grid.count)
    return number


def _links(grid: LampGrid, casters: Casters) -> tuple[Flags, Numbers]:
    """Edges (n, 4) at which sheets of a grid's casters end, and casters (m, 2) across others."""
    number = _numbers(grid, casters)
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
