"""A direct solver for long bodies: banded Cholesky factors in float64, on the host.

Numbered along its length, a body whose cross-section holds c unknowns has a matrix of bandwidth
little more than c: the factorisation takes n b^2 operations and 8 n b bytes. It is done in tiles
(LAPACK's own banded routine works on 32 columns at a time and is several times slower). Beams,
frames and small models are faster that way than by any iteration, and as accurate as float64
allows whatever their proportions. Everything else belongs to multigrid.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg.blas import dtrsm, dtrsv
from scipy.linalg.lapack import dpotrf, dtrtri
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import breadth_first_order, reverse_cuthill_mckee

from gpusim.arrays.array_types import Bool, Float, Int, Long
from gpusim.arrays.ragged import along_paths
from gpusim.fem.assembly.stiffness_rounding import indefinite
from gpusim.fem.sparse.block_rows import BlockRows, ranges

# rows of a tile; a band is cut into equal ones, as half a tile too much costs half as much again
_LARGEST_TILE = 128


@dataclass(frozen=True, eq=False)
class Ordering:
    """``position`` (N,3) of each free unknown in the banded matrix, -1 where fixed; ``bandwidth``
    the greatest distance of two coupled unknowns; ``size`` the number of free unknowns."""

    position: Long
    bandwidth: int
    size: int

    @property
    def operations(self) -> float:
        """Multiplications and additions of the factorisation."""
        return float(self.size) * float(self.bandwidth) ** 2

    @property
    def nbytes(self) -> int:
        """Of the factor."""
        tile, deep = _tiles(self.bandwidth)
        return 8 * (self.size + tile) * tile * deep


def band_ordering(rows: BlockRows, free: Bool, points: Float, hopeless: float = np.inf) -> Ordering:
    """The best of three numberings: along the longest coordinate, along the longest principal
    axis, and reverse Cuthill-McKee (George & Liu 1981), which follows a frame around its corners.
    The first one is enough where its bandwidth is ``hopeless`` and the body, from end to end, is
    as wide."""
    count = rows.node_count
    owner = np.repeat(np.arange(count, dtype=np.int32), rows.degree)
    longest = np.argsort(np.ptp(points, axis=0))
    grid = max(float(np.ptp(points, axis=0).max()), 1e-300) * 1e-9

    def along(coordinates: Float) -> tuple[Long, Ordering]:
        order = np.lexsort(np.rint(coordinates / grid).T)
        return order, _number(order, owner, rows.neighbour, free)

    order, first = along(points[:, longest])
    graph = csr_matrix(
        (np.ones(len(rows.neighbour), dtype=np.int8), rows.neighbour, rows.start),
        shape=(count, count),
    )
    if first.bandwidth > hopeless and 3 * _widest(graph, int(order[0])) > hopeless:
        return first
    centred = points - points.mean(axis=0)
    _, axes = np.linalg.eigh(centred.T @ centred)
    order = reverse_cuthill_mckee(graph, symmetric_mode=True).astype(np.int64)
    others = [along(centred @ axes)[1], _number(order, owner, rows.neighbour, free)]
    return min([first, *others], key=lambda one: one.bandwidth)


def _widest(graph: csr_matrix, begin: int) -> int:
    """The most nodes that are equally far, in steps from neighbour to neighbour, from one."""
    _, before = breadth_first_order(graph, begin)
    steps = along_paths(before, np.ones(len(before), dtype=np.int64))
    return int(np.bincount(steps[steps > 0]).max(initial=1))


def _number(order: Long, owner: Int, neighbour: Int, free: Bool) -> Ordering:
    ordered = free[order]
    position = np.full(free.shape, -1, dtype=np.int64)
    number = np.where(ordered, np.cumsum(ordered.ravel()).reshape(-1, 3) - 1, -1)
    position[order] = number
    # axis by axis: several times as fast as along the rows
    last = np.maximum.reduce(list(position.T))
    first = np.minimum.reduce(list(np.where(position >= 0, position, np.int64(2**62)).T))
    # negative where either has no unknown
    reach = last[owner] - first[neighbour]
    width = max(int(reach.max(initial=0)), int((last - first).max(initial=0)))
    return Ordering(position, width, int(ordered.sum()))


def _tiles(bandwidth: int) -> tuple[int, int]:
    """(tile size, tiles below and with the diagonal one that a column of tiles holds)."""
    tile = max(8, -(-bandwidth // max(1, -(-bandwidth // _LARGEST_TILE))))
    return tile, -(-bandwidth // tile) + 1


class BandedFactor:
    """The factorised stiffness K / scale on the free unknowns."""

    name = "direct"

    def __init__(self, rows: BlockRows, ordering: Ordering, scale: float) -> None:
        self._position = ordering.position
        self._tile, deep = _tiles(ordering.bandwidth)
        count = -(-ordering.size // self._tile)
        # column of tiles J, row r below its first row, column c: [J, r, c]; lower triangle
        self._columns = np.zeros((count, deep * self._tile, self._tile))
        chunk = 1 << 16
        for first in range(0, rows.node_count, chunk):
            nodes = np.arange(first, min(first + chunk, rows.node_count))
            _fill(self._columns, rows, ordering.position, nodes, 1.0 / scale)
        rest = np.arange(ordering.size % self._tile or self._tile, self._tile)
        self._columns[-1, rest, rest] = 1.0
        self._factorise(deep)
        self._inverses: list[Float] = []

    def _factorise(self, deep: int) -> None:
        tile, columns = self._tile, self._columns
        for number in range(len(columns)):
            column = columns[number]
            # C order is the transpose in Fortran's eyes: U^T U = L L^T
            diagonal, info = dpotrf(column[:tile].T, lower=0, clean=1)
            if info > 0:
                raise indefinite("direct solver")
            column[:tile] = diagonal.T
            last = min(deep, len(columns) - number)
            if last == 1:
                continue
            below = dtrsm(1.0, diagonal, column[tile : last * tile].T, lower=0, trans_a=1).T
            column[tile : last * tile] = below
            for k in range(1, last):
                rest = below[(k - 1) * tile :]
                columns[number + k, : len(rest)] -= rest @ below[(k - 1) * tile : k * tile].T

    def invert(self) -> None:
        """Invert the diagonal tiles, for hundreds of right-hand sides: several at a time then take
        little longer than one."""
        self._inverses = [dtrtri(one[: self._tile].T)[0].T for one in self._columns]

    def apply(self, r: Float) -> Float:
        """K^-1 r for (L,3N) r; zero on fixed unknowns."""
        if self._inverses:
            return self._by_products(r)
        tile, columns = self._tile, self._columns
        high = columns.shape[1]
        position = self._position.ravel()
        inside = position >= 0
        result = np.zeros_like(r)
        for case in range(len(r)):
            x = np.zeros(len(columns) * tile + high)
            x[position[inside]] = r[case, inside]
            for number in range(len(columns)):
                at = number * tile
                x[at : at + tile] = dtrsv(columns[number, :tile].T, x[at : at + tile], trans=1)
                x[at + tile : at + high] -= columns[number, tile:] @ x[at : at + tile]
            x[len(columns) * tile :] = 0.0
            for number in range(len(columns) - 1, -1, -1):
                at = number * tile
                x[at : at + tile] -= x[at + tile : at + high] @ columns[number, tile:]
                x[at : at + tile] = dtrsv(columns[number, :tile].T, x[at : at + tile])
            result[case, inside] = x[position[inside]]
        return result

    def _by_products(self, r: Float) -> Float:
        """The same by inverted tiles, of all cases together."""
        tile, columns, high = self._tile, self._columns, self._columns.shape[1]
        first = range(0, tile * len(columns), tile)
        tiles = list(zip(first, columns, self._inverses, strict=True))
        position = self._position.ravel()
        inside = position >= 0
        x = np.zeros((len(tiles) * tile + high, len(r)))
        x[position[inside]] = r[:, inside].T
        for at, column, inverse in tiles:
            x[at : at + tile] = inverse @ x[at : at + tile]
            x[at + tile : at + high] -= column[tile:] @ x[at : at + tile]
        x[len(tiles) * tile :] = 0.0
        for at, column, inverse in reversed(tiles):
            rest = x[at : at + tile] - column[tile:].T @ x[at + tile : at + high]
            x[at : at + tile] = inverse.T @ rest
        result = np.zeros_like(r)
        result[:, inside] = x[position[inside]].T
        return result


def _fill(columns: Float, rows: BlockRows, position: Long, nodes: Long, factor: float) -> None:
    tile, high = columns.shape[2], columns.shape[1]
    flat = columns.reshape(-1)
    low, end = rows.start[nodes[0]], rows.start[nodes[-1] + 1]
    degree = rows.degree[nodes]
    owner = np.concatenate([np.repeat(nodes, degree), nodes])
    other = np.concatenate([rows.neighbour[low:end].astype(np.int64), nodes])
    classes = rows.row_class[nodes]
    at = ranges(rows.table_start[classes], degree)
    for i in range(3):
        for j in range(3):
            row, column = position[owner, i], position[other, j]
            keep = np.flatnonzero((row >= column) & (column >= 0))
            value = np.concatenate([rows.table[at, i, j], rows.diagonal[classes, i, j]])
            row, column = row[keep], column[keep]
            block = column // tile
            place = (block * high + row - block * tile) * tile + column - block * tile
            flat[place] = factor * value[keep]
