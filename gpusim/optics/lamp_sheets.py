"""Where sheets of casters hide all of a lamp, and where none: in cells of its view.

Faces that share edges and turn the same side to the lamp's centre are a sheet, which in the lamp's
view (p, q, s) lies over p and q like a map: over a cell that no border of it enters it covers all,
once. What is below it is dark; what is on it is lit, unless something else is above. Deep in the
shadow of a bumpy surface no single face, and no single bump, hides the lamp: many do in turn, and
the edges at which the shadow of one ends lie in that of another. And beside any point of a bent
surface there are faces that rise above it, of which each would have to be looked at.

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
from gpusim.optics.sheet_blocks import SheetBlocks
from gpusim.optics.windows import Windows

__all__ = ["Sheets"]

Array = npt.NDArray[np.float64]
Numbers = npt.NDArray[np.int64]
Flags = npt.NDArray[np.bool_]


CELLS = 64
"""That receivers lie in at most of which is looked for whether they are lit."""

LAYERS, ROUNDS = 3, 4
"""Sheets above a receiver that are looked at, and how often the window for one is widened."""


class Sheets:
    """The sheets of a ``grid`` of ``casters``, each over one cell."""

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
        own, count = label[met], int(label.max(initial=-1)) + 1
        # of each sheet: whether it covers its cell
        whole, torn = np.zeros((2, count), bool)
        whole[label[met & centre & known]] = True
        torn[label[met & (cut | ~known)]] = True
        whole &= ~torn
        low, high = np.full(count, np.inf), np.full(count, -np.inf)
        np.minimum.at(low, own, grid.reach.s[0][box[met]])
        np.maximum.at(high, own, grid.highest[box[met]])
        place = np.zeros(count, np.int64)
        place[own] = cell[met]
        self._low, self._high, self._whole, self._place = low, high, whole, place
        self._others = _others(place, high, int(grid.shape.prod()))
        # what a lamp sees aslant may hide some of it from itself
        self._others[label[met & (grid.side[box] == 0)]] = np.inf
        self._box, self._cell, self._met, self._label = box, cell, met, label
        # sheets that cover cells, those of each by how low they are
        covers = np.flatnonzero(whole)
        self._covers = covers[np.lexsort((low[covers], place[covers]))]
        self._first = np.searchsorted(place[self._covers], np.arange(grid.shape.prod() + 1))

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
        some = reach[usable]
        if self.grid.view.lamp.extended:
            below = self._under(some)
        else:
            first, last = self.grid.around(some)
            below = -self._lowest.highest(first, last) > some.s[1]
            below &= (last >= first).all(axis=0)
        result = np.zeros(reach.s.shape[1], bool)
        result[usable] = below
        return result

    @cached_property
    def _lowest(self) -> Windows:
        """How low the highest sheets that cover cells are, turned round."""
        found = np.full(len(self._first) - 1, np.inf)
        filled = np.flatnonzero(np.diff(self._first))
        found[filled] = -self._low[self._covers[self._first[filled + 1] - 1]]
        return Windows(found.reshape(self.grid.shape))

    def _under(self, reach: Reach) -> Flags:
        """`hides`, where the lamp has a size: whether a sheet lies over all that rays pass before
        they are above it."""
        result = np.zeros(reach.s.shape[1], bool)
        column, row = self._middle(reach)
        cell = row * self.grid.shape[1] + column
        first, last = self._first[cell], self._first[cell + 1]
        low = self._low[self._covers]
        # of each cell the sheets above the receiver
        for _ in range(int((last - first).max(initial=0))):
            rows = np.flatnonzero(first < last)
            first[rows[low[first[rows]] <= reach.s[1][rows]]] += 1
        for layer in range(LAYERS):
            rows = np.flatnonzero((first + layer < last) & ~result)
            node = self._covers[first[rows] + layer]
            high = self._high[node]
            for _ in range(ROUNDS):
                own = reach[rows]
                least, (most, _) = self._over(own, node, column[rows], row[rows], high)
                under = least > own.s[1]
                result[rows[under & (most <= high)]] = True
                rows, node, high = (v[under & (most > high)] for v in (rows, node, most))
        return result

    def _middle(self, reach: Reach) -> tuple[Numbers, Numbers]:
        """Column and row of the cells in the middle of boxes."""
        first, last = self.grid.around(reach)
        limit = self.grid.shape[::-1] - 1
        column, row = ((a + b) // 2 for a, b in zip(first, last, strict=True))
        return np.clip(column, 0, limit[0]), np.clip(row, 0, limit[1])

    def _over(
        self, reach: Reach, node: Numbers, column: Numbers, row: Numbers, high: Array
    ) -> tuple[Array, Array]:
        """As `SheetBlocks.over`, of sheets ``node`` (n,) in cells, in the windows of boxes up to s
        = ``high`` (n,)."""
        first, last = self.grid.window(reach, high)
        inside = (last > first - 1).all(axis=0)
        # blocks have two cells each way
        last = np.maximum(last, first + 1)
        inside &= (first[0] <= column) & (column <= last[0])
        inside &= (first[1] <= row) & (row <= last[1])
        blocks = self._blocks
        start = np.full(len(node), len(self._low))
        start[inside] = blocks.moved(
            node[inside], (first[0] - column)[inside], (first[1] - row)[inside]
        )
        wide, tall = last - first + 1
        return blocks.over(start, wide, tall)

    @cached_property
    def _blocks(self) -> SheetBlocks:
        grid, box, cell = self.grid, self._box, self._cell
        own = self._met & self._whole[self._label]
        after = []
        for axis, place in enumerate(np.divmod(cell, grid.shape[1])[::-1]):
            node = np.flatnonzero(own & (place < grid.last[axis][box]))
            other = node + (1 if axis == 0 else self._wide[box[node]])
            node, other = node[own[other]], other[own[other]]
            # both cover the middle of the side between them by the same caster
            middle, half = grid.rectangles(cell[node])
            middle[axis] = middle[axis] + half[axis]
            inside = np.ones(len(node), bool)
            for gap, _ in grid.beside(box[node], middle, half):
                inside &= gap <= 0.0
            on = np.full(len(self._low), -1)
            on[self._label[node[inside]]] = self._label[other[inside]]
            after.append(on)
        right, below = after
        return SheetBlocks(right, below, self._low, np.stack([self._high, self._others]))

    def shows(self, reach: Reach, face: npt.NDArray[np.int32]) -> Flags:
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
        sheet = np.full(len(usable), -1)
        for caster in own.T:
            filed = caster[box]
            inside = np.ones(len(box), bool)
            for axis, place in enumerate((column, row)):
                inside &= self.grid.first[axis][filed] <= place
                inside &= self.grid.last[axis][filed] >= place
            at = np.flatnonzero(inside)
            entry = self._node(filed[at], column[at], row[at])
            # a face that isn't in a cell has no receiver there
            at, entry = at[self._met[entry]], entry[self._met[entry]]
            label = self._label[entry]
            sheet[box[at]] = label
            clear = self._whole[label] & (self._others[label] <= some.s[0][box[at]])
            lit[box[at[~clear]]] = False
        rows = np.flatnonzero(lit & (sheet >= 0))
        if self.grid.view.lamp.extended:
            left, node = some[rows], sheet[rows]
            row, column = np.divmod(self._place[node], self.grid.shape[1])
            least, (_, most) = self._over(left, node, column, row, self.grid.top(left))
            rows = rows[(least > -np.inf) & (most <= left.s[0])]
        result = np.zeros(reach.s.shape[1], bool)
        result[usable[rows]] = True
        return result


def _others(place: Numbers, high: Array, cells: int) -> Array:
    """(n,) how high other sheets are in the cells (n,) of sheets ``high`` (n,)."""
    order = np.lexsort((high, place))
    ordered = place[order]
    last = np.searchsorted(ordered, np.arange(cells), side="right") - 1
    top = order[last[place]]
    before = np.maximum(last - 1, 0)
    second = np.where(
        (last > 0) & (ordered[before] == np.arange(cells)), high[order[before]], -np.inf
    )
    return np.where(top == np.arange(len(high)), second[place], high[top])


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
    lamp, faces = grid.view.lamp, grid.face
    to = lamp.centre - (0.0 if lamp.far else 1.0) * casters.points[casters.faces[faces, 0]]
    turn = np.sign(np.einsum("fa,fa->f", to, casters.normal[faces]))
    alike = (other >= 0) & (turn[other] == turn[one]) & (turn[one] != 0.0)
    rim = np.zeros((grid.count, 4), bool)
    rim[one[~alike], place[~alike]] = True
    one, other = one[alike], other[alike]
    # the faces of joined ones meet in several edges
    pair = distinct((one * grid.count + other)[one < other])
    return rim, np.stack(np.divmod(pair, max(grid.count, 1)), axis=1)
