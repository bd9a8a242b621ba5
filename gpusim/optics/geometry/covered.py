"""Triangles of an open surface that its other side hides from the camera.

An open surface shows both sides, and the inside of a tube lies behind its outside, triangle by
triangle. Those of one side that look the same way in the image cover a place as often as their
border winds round it, so that what their border doesn't pass is covered all over, or not at all.
What is farther away than any of them there can't be seen: nothing of it has to be drawn, lit or
cut.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from gpusim.arrays.ragged import batches, cells_of, expand
from gpusim.optics.geometry.single_layer import border_of, sides_from
from gpusim.surface.topology import Topology

__all__ = ["FEWEST", "covered", "uncovered"]

Array = npt.NDArray[np.float64]
Numbers = npt.NDArray[np.int64]
Flags = npt.NDArray[np.bool_]

FEWEST = 256
"""Triangles of each side from which on it is worth while to find out."""

LEAST_CELL, MOST_CELL = 4.0, 32.0
"""px, side of the cells that places are looked up in: few triangles are larger."""

MOST = 1 << 22
"""Cells."""

WORTH = 0.5
"""px of edges that are looked at for each triangle that isn't."""

NEARLY, SAMPLE = 99, 4096
"""Of 100 triangles, and how many tell how large they are, or whether any are hidden."""

ASIDE = 0.1234567
"""px by which cells begin before what lies in them: borders on whole pixels don't pass their
middles."""

MARGIN = 0.05
"""px round a triangle that are covered, too: lenses bend what is straight, by less than this."""

BEYOND = 1e-6
"""Of its depth, by which a triangle is farther away than those that hide it."""

TORN = 0.25
"""Edges of a border, for each triangle that may be behind, beyond which not much is covered."""

CROWD, TOGETHER = 64, 1 << 20
"""Edges in a triangle's cell beyond which it isn't looked at, and pairs that are at once."""

EACH = 16
"""Cells for each triangle and for each edge of a border, in the mean, that are worth it."""


class _Cells(NamedTuple):
    """``origin`` (2,) px of cells, their ``side``, px, and number ``shape`` (rows, columns)."""

    origin: Array
    side: float
    shape: tuple[int, int]

    def from_origin(self, place: Array) -> Array:
        """Places (2, n) in sides of cells from their origin."""
        result: Array = place - self.origin[:, None]
        result /= self.side
        return result

    def of(self, low: Array, high: Array) -> tuple[Numbers, Numbers]:
        """First and last cell (2, n), column and row, of boxes of places (2, n) px; those of other
        places have the last one before the first one."""
        ends = []
        for least, values in ((0, low), (-1, high)):
            cell = self.from_origin(values)
            for row, count in zip(cell, self.shape[::-1], strict=True):
                np.clip(np.floor(row, out=row), least, count + least, out=row)
            ends.append(cell.astype(np.int64))
        return ends[0], ends[1]

    def filed(self, first: Numbers, last: Numbers) -> tuple[Numbers, Numbers] | None:
        """Which box, and which cell, of all cells from ``first`` to ``last`` (2, n); None where
        these are too many."""
        wide, tall = np.maximum(last - first + 1, 0)
        if (wide * tall).sum() > EACH * wide.size + self.shape[0] * self.shape[1]:
            return None
        return cells_of(first, last, self.shape[1])


def uncovered(
    topology: Topology, front: Flags, keep: Flags, place: Array, depth: Array
) -> tuple[Flags, Numbers]:
    """(T,) which triangles of a surface are to ``keep`` (T,) where those that are `covered` aren't;
    and the edges between these and others: a sheet ends there, behind what hides both. Coarse ones
    stay if pixels along such edges would have to be looked at for few of them."""
    none = np.zeros(0, np.int64)
    if topology.closed or front.all() or not front.any():
        return keep, none
    hidden = covered(topology, front, keep, place, depth)
    if not hidden.any():
        return keep, none
    left = keep & ~hidden
    edge = np.unique(topology.edge[hidden])
    edge = edge[topology.manifold[edge]]
    edge = edge[left[topology.first[edge]] | left[topology.second[edge]]]
    starts, ends = (place[v] for v in sides_from(topology, edge, topology.first[edge]))
    if np.hypot(*(ends - starts).T).sum() > WORTH * np.count_nonzero(hidden):
        return keep, none
    return left, edge


def covered(topology: Topology, front: Flags, keep: Flags, place: Array, depth: Array) -> Flags:
    """(T,) which triangles of a surface are hidden all over by others of it, of those to
    ``keep`` (T,) that look to the ``front`` (T,) by those that don't, and the other way round.

    ``place`` (P, 2): of its vertices in the image, px, without the lens's distortion; ``depth``
    (P,): along the camera's axis, above 0.
    """
    result = np.zeros(len(keep), bool)
    sides = [keep & front, keep & ~front]
    few = min(np.count_nonzero(side) for side in sides) < FEWEST
    # what reaches behind the camera lies nowhere in the image
    if few or not topology.oriented or not np.isfinite(place).all():
        return result
    boxes = [_Boxes.of(topology.triangles[side], place, depth) for side in sides]
    for (near, far), (ahead, beyond) in zip(
        (sides, sides[::-1]), (boxes, boxes[::-1]), strict=True
    ):
        layer = _Layer.of(ahead)
        # some tell whether any are behind it
        if layer is None or not layer.before(beyond.sample()).any():
            continue
        rows = np.flatnonzero(far)[layer.before(beyond)]
        starts, ends = (place[vertices].T for vertices in border_of(topology, near))
        if starts.shape[1] > TORN * len(rows):
            continue
        corners = place[topology.triangles[rows]].transpose(1, 2, 0)
        result[rows[_inside(layer.cells, starts, ends, corners)]] = True
    return result


class _Boxes(NamedTuple):
    """``low`` and ``high`` (2, n) px of boxes around triangles, and their ``least`` and ``most``
    depth (n,)."""

    low: Array
    high: Array
    least: Array
    most: Array

    @staticmethod
    def of(triangles: Numbers, place: Array, depth: Array) -> _Boxes:
        """Those around triangles (n, 3) of vertices at ``place`` (P, 2) px and ``depth`` (P,)."""
        corner = [triangles[:, k] for k in range(3)]
        low, high = np.empty((2, 3, len(triangles)))
        for values, least, most in zip((*place.T, depth), low, high, strict=True):
            a, b, c = (np.take(values, own) for own in corner)
            np.minimum(np.minimum(a, b), c, out=least)
            np.maximum(np.maximum(a, b), c, out=most)
        return _Boxes(low[:2], high[:2], low[2], high[2])

    def sample(self) -> _Boxes:
        """Some of them."""
        step = -(-len(self.least) // SAMPLE)
        return _Boxes(*(values[..., ::step] for values in self))


class _Layer(NamedTuple):
    """Triangles in the image: their greatest depth in ``cells``, ``far`` (n,), -inf where none
    are."""

    cells: _Cells
    far: Array

    @staticmethod
    def of(boxes: _Boxes) -> _Layer | None:
        """Those in some boxes; None where they are too large."""
        low, high, _, most = boxes
        some = boxes.sample()
        side = np.percentile((some.high - some.low).max(axis=0), NEARLY) + 2.0 * MARGIN
        side = float(np.clip(side, LEAST_CELL, MOST_CELL))
        origin = low.min(axis=1) - ASIDE
        size = np.floor((high.max(axis=1) - origin) / side) + 1.0
        if not size.prod() <= MOST:
            return None
        cells = _Cells(origin, side, (int(size[1]), int(size[0])))
        filed = cells.filed(*cells.of(low, high))
        if filed is None:
            return None
        far = np.full(cells.shape[0] * cells.shape[1], -np.inf)
        np.maximum.at(far, filed[1], most[filed[0]])
        return _Layer(cells, far)

    def before(self, boxes: _Boxes) -> Flags:
        """(n,) which others lie in cells, four at most, in which all of these are nearer."""
        low, high, least = boxes.low - MARGIN, boxes.high + MARGIN, boxes.least
        (left, top), (right, bottom) = self.cells.of(low, high)
        result = (right - left <= 1) & (bottom - top <= 1)
        for axis, own in enumerate(self.cells.origin):
            result &= low[axis] >= own
            result &= high[axis] < own + self.cells.side * self.cells.shape[1 - axis]
        beyond = np.full(len(least), -np.inf)
        for row in (top, bottom):
            for column in (left, right):
                cell = row * self.cells.shape[1] + column
                np.maximum(beyond, np.take(self.far, cell, mode="clip"), out=beyond)
        result &= (least > beyond * (1.0 + BEYOND)) & (beyond > 0.0)
        return np.asarray(result)


def _inside(cells: _Cells, start: Array, end: Array, corners: Array) -> Numbers:
    """Which triangles with ``corners`` (3, 2, n) px closed chains of edges, from ``start`` to
    ``end`` (2, E), wind round, and pass none of."""
    reach = np.minimum(start, end) - cells.side, np.maximum(start, end) + cells.side
    filed = cells.filed(*cells.of(*reach))
    if filed is None:
        return np.zeros(0, np.int64)
    edge, cell = filed
    order = np.argsort(cell, kind="stable")
    edge = edge[order]
    count = np.bincount(cell, minlength=cells.shape[0] * cells.shape[1])
    first = np.cumsum(count) - count
    middle = corners.mean(axis=0)
    column, row = np.floor(cells.from_origin(middle)).astype(np.int64)
    own = row * cells.shape[1] + column
    winds = _winds(cells, start, end).reshape(-1)[own]
    begin = cells.origin[:, None] + cells.side * (np.stack([column, row]) + 0.5)
    clear = count[own] <= CROWD
    some = np.flatnonzero(clear & (count[own] > 0))
    for part in batches(count[own[some]], TOGETHER):
        box, step = expand(count[own[some[part]]])
        box = some[part.start + box]
        near = edge[first[own[box]] + step]
        a, b = start[:, near], end[:, near]
        passed = ~_beside(a, b, corners[:, :, box])
        # which way round an edge is crossed between the cell's middle and the triangle's
        left_of = [_left(a, b, at[:, box]) for at in (begin, middle)]
        ends_of = [_left(begin[:, box], middle[:, box], at) for at in (a, b)]
        crossed = (left_of[0] != left_of[1]) & (ends_of[0] != ends_of[1])
        turn = np.where(crossed, left_of[1].astype(np.int64) - left_of[0], 0)
        winds += np.bincount(box, turn, len(winds)).astype(np.int64)
        clear[box[passed]] = False
    return np.flatnonzero((winds != 0) & clear)


def _winds(cells: _Cells, start: Array, end: Array) -> Numbers:
    """(rows, columns) how often closed chains of edges wind round the middles of cells, to the left
    of each edge once more than to its right."""
    (x, y), (end_x, end_y) = (cells.from_origin(v) - 0.5 for v in (start, end))
    low, high = np.minimum(y, end_y), np.maximum(y, end_y)
    first = np.clip(np.ceil(low), 0, cells.shape[0]).astype(np.int64)
    stop = np.clip(np.ceil(high), 0, cells.shape[0]).astype(np.int64)
    edge, row = expand(np.maximum(stop - first, 0))
    row += first[edge]
    # only edges with a height have rows
    share = (row - y[edge]) / (end_y[edge] - y[edge])
    column = np.ceil(x[edge] + share * (end_x[edge] - x[edge]))
    column = np.clip(column, 0, cells.shape[1]).astype(np.int64)
    wide = cells.shape[1] + 1
    way = np.where(end_y > y, 1.0, -1.0)[edge]
    table = np.bincount(row * wide + column, way, cells.shape[0] * wide).reshape(-1, wide)
    # those to the right of each middle
    beyond = table.sum(axis=1, keepdims=True) - table.cumsum(axis=1)
    return np.asarray(np.rint(beyond[:, :-1]), np.int64)


def _left(start: Array, end: Array, point: Array) -> Flags:
    """(n,) whether points are to the left of lines (2, n), where y is to the left of x."""
    way, to = end - start, point - start
    return np.asarray(way[0] * to[1] - way[1] * to[0] >= 0.0)


def _beside(start: Array, end: Array, corners: Array) -> Flags:
    """(n,) whether triangles with ``corners`` (3, 2, n) lie beside edges (2, n)."""
    a, b, c = corners
    result = np.zeros(start.shape[1], bool)
    for axis in range(2):
        low = np.minimum(np.minimum(a[axis], b[axis]), c[axis]) - MARGIN
        high = np.maximum(np.maximum(a[axis], b[axis]), c[axis]) + MARGIN
        result |= np.maximum(start[axis], end[axis]) < low
        result |= np.minimum(start[axis], end[axis]) > high
    way = end - start
    p, q, r = (way[0] * (y - start[1]) - way[1] * (x - start[0]) for x, y in corners)
    reach = MARGIN * np.hypot(*way)
    result |= np.minimum(np.minimum(p, q), r) > reach
    result |= np.maximum(np.maximum(p, q), r) < -reach
    return result
