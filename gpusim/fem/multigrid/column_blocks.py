"""Columns of nodes across flat cells, as blocks that are smoothed and aggregated as a whole.

Thin parts are meshed with cells several times as long as thick. Their nodes hang together across
the thickness far more stiffly than along the surface, so that smoothing node by node stalls: what
is left after it is rough along the surface and can't be seen by a coarser level. Solving for each
column at once (line relaxation; Trottenberg, Oosterlee & Schueller, Multigrid (2001), 5.1) leaves
the error of a plate whose cells are about square.

A thin body is a few cells thick everywhere, whatever their shape: near a hole they may be shorter
along the surface than across. Its stacks of bricks and wedges are told by the cells' neighbours,
not by numbers or lengths, so that blocks of a mesh may meet in any way.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from scipy.sparse import bsr_matrix, csr_matrix
from scipy.sparse.csgraph import connected_components

from gpusim.arrays.array_types import Bool, Float, Int, Long
from gpusim.fem.assembly.element_batches import Elements
from gpusim.fem.multigrid.smoothers import Relaxation, chebyshev
from gpusim.fem.sparse.block_rows import ranges
from gpusim.fem.sparse.matrix_product import Product, Vectors

EDGES: dict[str, tuple[tuple[tuple[int, int], ...], ...]] = {
    "hex8": (
        ((0, 1), (3, 2), (7, 6), (4, 5)),
        ((0, 3), (1, 2), (5, 6), (4, 7)),
        ((0, 4), (1, 5), (2, 6), (3, 7)),
    ),
    "wedge6": (
        ((0, 1), (3, 4)),
        ((1, 2), (4, 5)),
        ((2, 0), (5, 3)),
        ((0, 3), (1, 4), (2, 5)),
    ),
}
"""Edges of a cell along each of its axes, from one end to the other."""

# nodes of a cell: along an axis whose edges have all of them it may lie in a stack
_NODES = {"hex8": 8, "wedge6": 6}
# a stack is thin where it is at most this share of what the body measures the next way
_THIN = 1.0 / 3.0
# a cell is flat where it is this many times as long, along any other axis, as along its shortest
_FLAT = 1.15
# nodes of a column at most, and the share of cells that must be flat, and of nodes in columns
_LONGEST, _MOSTLY = 12, 0.5
# cells across a thin body, whatever their shape: aggregates of higher columns are too large
_FEW_CELLS = 6
# eigenvalues of the smoother, as of `gpusim.fem.multigrid.hierarchy`
_RANGE, _DEGREE = 16.0, 2
# columns that are inverted at a time
_PORTION = 1024


def thin_axes(groups: Sequence[Elements], points: Float, most: int) -> list[Long] | None:
    """For each group (M,) the axis along which its cells' stack is thin and of at most ``most``
    cells, -1 where there is none. None for cells other than hex8 and wedge6.

    ``points`` (N,3) are the nodes of the cells in ``groups``.
    """
    if any(group.name not in EDGES for group in groups):
        return None
    # a face is told by the sum of its corners' random numbers, modulo 2^64
    mark = np.random.default_rng(11).integers(0, 2**63, len(points), dtype=np.uint64)
    faces, lengths, parts = [], [], []
    for number, group in enumerate(groups):
        for axis, edges in enumerate(EDGES[group.name]):
            if 2 * len(edges) < _NODES[group.name]:
                continue
            low, high = (group.cells[:, list(end)] for end in zip(*edges, strict=True))
            faces.append(np.stack([mark[low].sum(axis=1), mark[high].sum(axis=1)], axis=1))
            across = points[high].mean(axis=1) - points[low].mean(axis=1)
            lengths.append(np.linalg.norm(across, axis=1))
            parts.append((number, axis))
    stack = _stacks(np.concatenate(faces))
    length = np.concatenate(lengths)
    total = np.asarray(np.bincount(stack, weights=length)[stack], dtype=np.float64)
    cells = np.bincount(stack).astype(np.int32)[stack]
    sizes = np.sort(np.ptp(points, axis=0))
    thinnest = [_Thinnest(len(group.cells), float(sizes[1])) for group in groups]
    first = 0
    for number, axis in parts:
        span = slice(first, first + len(groups[number].cells))
        thinnest[number].look(axis, total[span], cells[span])
        first = span.stop
    return [one.axes(most) for one in thinnest]


def _stacks(faces: npt.NDArray[np.uint64]) -> Int:
    """(S,) number of the stack that each cell belongs to along an axis, by its two faces (S,2)."""
    flat = faces.ravel()
    order = np.argsort(flat)
    equal = np.flatnonzero(flat[order[1:]] == flat[order[:-1]])
    one, other = order[equal] // 2, order[equal + 1] // 2
    count = len(faces)
    links = csr_matrix((np.ones(len(one), dtype=np.int8), (one, other)), shape=(count, count))
    return np.asarray(connected_components(links, directed=False)[1])


class _Thinnest:
    """Of a group's cells: the shortest stack and the next."""

    def __init__(self, count: int, size: float) -> None:
        self._least, self._next = np.full(count, np.inf), np.full(count, size)
        self._axis, self._cells = np.full(count, -1, dtype=np.int64), np.zeros(count, np.int32)

    def look(self, axis: int, length: Float, cells: Int) -> None:
        shorter = length < self._least
        self._next = np.minimum(self._next, np.where(shorter, self._least, length))
        self._least = np.where(shorter, length, self._least)
        self._axis[shorter], self._cells[shorter] = axis, cells[shorter]

    def axes(self, most: int) -> Long:
        thin = (self._cells <= most) & (self._least <= _THIN * self._next)
        return np.where(thin, self._axis, -1)


def columns_across(groups: Sequence[Elements], points: Float) -> Long | None:
    """(N,) numbers of the columns, each node in one; None where the body isn't flat in most places.

    ``points`` (N,3) are the nodes of the cells in ``groups``.
    """
    for find in (_thin_edges, _flat_edges):
        ends = find(groups, points)
        column = None if ends is None else _joined(ends, len(points))
        if column is not None:
            return column
    return None


def _joined(ends: Int, count: int) -> Long | None:
    """(N,) numbers of columns along edges (E,2); None where most nodes are in none."""
    first, second = ends.T
    links = csr_matrix((np.ones(len(first), dtype=bool), (first, second)), shape=(count, count))
    _, number = connected_components(links, directed=False)
    size = np.bincount(number)[number]
    inside = (size > 1) & (size <= _LONGEST)
    if inside.mean() < _MOSTLY:
        return None
    # all others stand for themselves
    label = np.where(inside, number, number.max() + 1 + np.arange(count))
    return np.asarray(np.unique(label, return_inverse=True)[1], dtype=np.int64)


def _flat_edges(groups: Sequence[Elements], points: Float) -> Int | None:
    """(E,2) edges along which cells are flat; None where they aren't, in most places."""
    ends, flat_cells = [], 0
    for group in groups:
        axes = EDGES.get(group.name)
        if axes is None:
            return None
        lengths = np.stack([_mean_length(points, group.cells, edges) for edges in axes])
        order = np.sort(lengths, axis=0)
        flat = order[1] >= _FLAT * order[0]
        flat_cells += int(flat.sum())
        shortest = lengths.argmin(axis=0)
        for axis, edges in enumerate(axes):
            flat_along = group.cells[flat & (shortest == axis)]
            ends += [flat_along[:, list(edge)] for edge in edges]
    return np.concatenate(ends) if _mostly(flat_cells, groups) else None


def _thin_edges(groups: Sequence[Elements], points: Float) -> Int | None:
    """(E,2) edges across the body where it is a few cells thick; None where it isn't, mostly."""
    thin_axis = thin_axes(groups, points, _FEW_CELLS)
    if thin_axis is None or not _mostly(sum(int((axis >= 0).sum()) for axis in thin_axis), groups):
        return None
    ends = []
    for group, thin in zip(groups, thin_axis, strict=True):
        for axis, edges in enumerate(EDGES[group.name]):
            thin_cells = group.cells[thin == axis]
            ends += [thin_cells[:, list(edge)] for edge in edges]
    return np.concatenate(ends)


def _mostly(cells: int, groups: Sequence[Elements]) -> bool:
    return cells >= _MOSTLY * sum(len(group.cells) for group in groups)


def _mean_length(points: Float, cells: Int, edges: Sequence[tuple[int, int]]) -> Float:
    lengths = [np.linalg.norm(points[cells[:, b]] - points[cells[:, a]], axis=1) for a, b in edges]
    return np.asarray(np.mean(lengths, axis=0))


class Columns:
    """r -> D^-1 r with the blocks of a matrix that belong to one column each."""

    def __init__(self, matrix: Product, free: Bool, column: Long) -> None:
        self.column = column
        self.product = Product(_inverse(matrix, free, column))

    @property
    def matrix(self) -> bsr_matrix:
        """D^-1 in blocks of 3x3, zero where nothing is free."""
        return self.product.matrix

    def apply(self, r: Vectors) -> Vectors:
        """(L,3N) -> (L,3N)."""
        return self.product(r)

    def steps(self, largest: float) -> tuple[Relaxation, ...]:
        """Of Chebyshev's iteration, for the greatest eigenvalue of D^-1 A."""
        return chebyshev(largest / _RANGE, largest, _DEGREE)


def _inverse(matrix: Product, free: Bool, column: Long) -> bsr_matrix:
    count = len(column)
    size = np.bincount(column)
    members = np.argsort(column, kind="stable")
    start = np.concatenate([[0], np.cumsum(size)])
    place = np.empty(count, dtype=np.int64)
    place[members] = np.arange(count) - start[column[members]]
    row, other, value = _inner_blocks(matrix, column)
    order = np.argsort(column[row], kind="stable")
    begin = np.concatenate([[0], np.cumsum(np.bincount(column[row], minlength=len(size)))])
    pointer = np.concatenate([[0], np.cumsum(size[column])])
    indices = np.empty(pointer[-1], dtype=np.int32)
    data = np.empty((pointer[-1], 3, 3))
    portions = (
        (int(high), equal[first : first + _PORTION])
        for high in np.unique(size)
        for equal in [np.flatnonzero(size == high)]
        for first in range(0, len(equal), _PORTION)
    )
    for high, columns in portions:
        nodes = members[start[columns][:, None] + np.arange(high)]
        here = order[ranges(begin[columns], begin[columns + 1] - begin[columns])]
        block = np.zeros((len(columns), high, 3, high, 3))
        number = np.searchsorted(columns, column[row[here]])
        block[number, place[row[here]], :, place[other[here]]] = value[here]
        inside = free[nodes].reshape(len(columns), -1)
        both = inside[:, :, None] & inside[:, None]
        dense = np.where(both, block.reshape(both.shape), 0.0)
        # what isn't free stands for itself, and is left out afterwards
        dense += ~inside[:, :, None] * np.eye(3 * high)
        dense = np.where(both, np.linalg.inv(0.5 * (dense + dense.transpose(0, 2, 1))), 0.0)
        into = pointer[nodes][:, :, None] + np.arange(high)
        indices[into] = nodes[:, None]
        data[into] = dense.reshape(block.shape).transpose(0, 1, 3, 2, 4)
    return bsr_matrix((data, indices, pointer), shape=(3 * count, 3 * count))


def _inner_blocks(matrix: Product, column: Long) -> tuple[Int, Int, Float]:
    """Rows, columns and values (B,3,3) of the blocks between nodes of one column."""
    off = matrix.others
    row = np.repeat(np.arange(len(column), dtype=np.int32), np.diff(off.indptr))
    short = column.astype(np.int32)
    same = np.flatnonzero(short[row] == short[off.indices])
    row, other, value = row[same], off.indices[same], off.data[same]
    if matrix.apart:
        nodes = np.arange(len(column), dtype=np.int32)
        row, other = np.concatenate([row, nodes]), np.concatenate([other, nodes])
        value = np.concatenate([value, matrix.diagonal]) / matrix.scale
    return row, other, value
