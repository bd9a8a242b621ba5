"""The assembled stiffness as a table of distinct block rows, and its diagonal blocks.

On a structured mesh most nodes see the same surroundings, so their rows of 3x3 blocks are equal:
a few dozen distinct rows and one index per neighbour replace the whole matrix. On an
unstructured mesh every node has its own row, which is plain block storage.

The diagonal block isn't stored. Rigid translations cost no energy, so K_ii = -sum_j K_ij, and

    (K u)_i = sum_{j != i} K_ij (u_j - u_i)

needs off-diagonal blocks only; taking differences first also keeps the rounding error of slender
bodies, whose neighbours move nearly alike, well below that of the usual product.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.sparse import bsr_matrix, csr_matrix

from gpusim.arrays.array_types import Bool, Float, Int, Long, Real
from gpusim.parallel.threads import shared

# blocks that are inverted at a time
_PORTION = 2048


@dataclass(frozen=True, eq=False)
class BlockRows:
    """Distinct block rows of K, float64.

    ``links`` gives ``start`` and ``neighbour`` when they are first asked for: on a lattice of
    repeating rows hardly anything needs them. ``row_class`` (N,) int32. The blocks of class c, in
    the order of the neighbours, are ``table[table_start[c]:table_start[c+1]]``; ``table`` (T,3,3),
    ``table_start`` (C+1,) int64. ``diagonal`` (C,3,3). ``element_classes`` the number of distinct
    element matrices.
    """

    links: Callable[[], tuple[Long, Int]]
    row_class: Int
    table: Float
    table_start: Long
    diagonal: Float
    element_classes: int

    @cached_property
    def _linked(self) -> tuple[Long, Int]:
        return self.links()

    @property
    def start(self) -> Long:
        """(N+1,) int64: the neighbours of node i are ``neighbour[start[i]:start[i+1]]``."""
        return self._linked[0]

    @property
    def neighbour(self) -> Int:
        """(start[N],) int32 neighbours of every node, itself left out."""
        return self._linked[1]

    @property
    def node_count(self) -> int:
        return len(self.row_class)

    @property
    def class_count(self) -> int:
        return len(self.diagonal)

    @cached_property
    def degree(self) -> Long:
        """(N,) neighbours per node."""
        return np.asarray(np.diff(self.table_start)[self.row_class])

    @property
    def nbytes(self) -> int:
        """Bytes of the table and of the lists of neighbours."""
        links = 4 * int(self.degree.sum()) + 8 * (self.node_count + 1)
        return self.table.nbytes + self.row_class.nbytes + links


def ranges(start: Long, length: Long) -> Long:
    """start[0] … start[0]+length[0]-1, start[1] …, one after the other."""
    end = np.cumsum(length)
    total = int(end[-1]) if len(end) else 0
    offset = np.repeat(start - (end - length), length)
    return np.asarray(np.arange(total, dtype=np.int64) + offset)


def block_matrix(rows: BlockRows, scale: float = 1.0) -> bsr_matrix:
    """K / scale as a SciPy block matrix with 3x3 blocks, float64; the diagonal comes first."""
    count = rows.node_count
    start = rows.start + np.arange(count + 1)
    column = np.empty(int(start[-1]), dtype=np.int32)
    is_diagonal = np.zeros(int(start[-1]), dtype=bool)
    is_diagonal[start[:-1]] = True
    column[is_diagonal] = np.arange(count)
    column[~is_diagonal] = rows.neighbour
    source = np.empty(int(start[-1]), dtype=np.int64)
    source[is_diagonal] = rows.row_class
    source[~is_diagonal] = rows.class_count + ranges(rows.table_start[rows.row_class], rows.degree)
    data = np.take(np.concatenate([rows.diagonal, rows.table]) / scale, source, axis=0)
    return bsr_matrix((data, column, start), shape=(3 * count, 3 * count))


def block_rows(matrix: bsr_matrix, element_classes: int) -> BlockRows:
    """The block rows of a matrix of 3x3 blocks, each of its own kind, with the diagonal blocks that
    it has: where rows don't add up to zero they have no product in differences."""
    count = matrix.shape[0] // 3
    row = np.repeat(np.arange(count, dtype=matrix.indices.dtype), np.diff(matrix.indptr))
    beside = row != matrix.indices
    degree = np.bincount(row[beside], minlength=count)
    start = np.concatenate([[0], np.cumsum(degree)]).astype(np.int64)
    neighbour = matrix.indices[beside].astype(np.int32)
    return BlockRows(
        lambda: (start, neighbour), np.arange(count, dtype=np.int32), matrix.data[beside], start,
        diagonal_blocks(matrix), element_classes,
    )  # fmt: skip


def pattern(matrix: bsr_matrix) -> csr_matrix:
    """Where a block matrix has blocks: true at their rows and columns."""
    rows, columns = (n // size for n, size in zip(matrix.shape, matrix.blocksize, strict=True))
    present = np.ones(len(matrix.indices), dtype=bool)
    return csr_matrix((present, matrix.indices, matrix.indptr), shape=(rows, columns))


def block_diagonal(blocks: Real) -> bsr_matrix:
    """A matrix with (B,s,s) ``blocks`` on its diagonal, and none elsewhere."""
    one = np.arange(len(blocks) + 1, dtype=np.int32)
    return bsr_matrix((blocks, one[:-1], one), shape=(len(blocks) * blocks.shape[1],) * 2)


def diagonal_blocks(matrix: bsr_matrix) -> Float:
    """(B,s,s) diagonal blocks, zero where none is stored."""
    size = matrix.blocksize[0]
    count = matrix.shape[0] // size
    row = np.repeat(np.arange(count, dtype=matrix.indices.dtype), np.diff(matrix.indptr))
    blocks = np.zeros((count, size, size))
    here = np.flatnonzero(matrix.indices == row)
    blocks[row[here]] = matrix.data[here]
    return blocks


def invert_blocks(blocks: Float, free: Bool) -> Float:
    """Inverse of the free sub-block of each symmetric (B,s,s) block, zeros elsewhere.

    ``free`` (B,s). Blocks that are singular on their free unknowns get a pseudo-inverse.
    """
    every = free.all(axis=1)
    result = np.zeros_like(blocks)
    regular = np.flatnonzero(every)

    def fill(first: int) -> None:
        part = regular[first : first + _PORTION]
        result[part] = _regular(blocks[part])

    shared(fill, range(0, len(regular), _PORTION))
    # what rounding has spoilt, or what is partly fixed, goes the careful way
    careful = np.flatnonzero(~every | ~np.isfinite(result).all(axis=(1, 2)))
    result[careful] = _careful(blocks[careful], free[careful])
    return result


def invert_repeated(blocks: Float, kind: Int, free: Bool) -> Float:
    """The same for blocks ``blocks[kind]``: each distinct one is inverted once for all nodes where
    the same unknowns are free. ``blocks`` (C,s,s), ``kind`` (B,), ``free`` (B,s)."""
    size = free.shape[1]
    key = kind.astype(np.int64) << size
    for column in range(size):
        key |= free[:, column].astype(np.int64) << column
    used, number = np.unique(key, return_inverse=True)
    free_unknowns = (used[:, None] >> np.arange(size) & 1).astype(bool)
    return np.asarray(invert_blocks(blocks[used >> size], free_unknowns)[number])


def _regular(blocks: Float) -> Float:
    """Inverses of positive definite blocks, scaled to a unit diagonal; NaN where they aren't."""
    diagonal = np.einsum("bii->bi", blocks)
    good = (diagonal > 0.0).all(axis=1)
    scale = 1.0 / np.sqrt(np.where(good[:, None], diagonal, 1.0))
    scaled = blocks * scale[:, :, None] * scale[:, None, :]
    scaled[~good] = np.eye(blocks.shape[1])
    good &= np.linalg.det(scaled) > 1e-6
    scaled[~good] = np.eye(blocks.shape[1])
    inverse = np.linalg.inv(scaled)
    inverse = 0.5 * (inverse + inverse.transpose(0, 2, 1)) * scale[:, :, None] * scale[:, None, :]
    return np.where(good[:, None, None], inverse, np.nan)


def _careful(blocks: Float, free: Bool) -> Float:
    size = blocks.shape[1]
    both = free[:, :, None] & free[:, None, :]
    diagonal = np.where(free, np.einsum("bii->bi", blocks), 1.0)
    scale = 1.0 / np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))
    scaled = np.where(both, blocks * scale[:, :, None] * scale[:, None, :], 0.0)
    scaled += np.where(free, 0.0, 1.0)[:, :, None] * np.eye(size)
    values, vectors = np.linalg.eigh(scaled)
    good = values > 1e-12
    inverse_values = np.where(good, 1.0 / np.where(good, values, 1.0), 0.0)
    inverse = np.matmul(vectors * inverse_values[:, None, :], vectors.transpose(0, 2, 1))
    return np.where(both, inverse * scale[:, :, None] * scale[:, None, :], 0.0)
