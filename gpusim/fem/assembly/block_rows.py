"""The assembled stiffness as a table of distinct block rows.

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
import numpy.typing as npt
from scipy.sparse import bsr_matrix, csr_matrix

__all__ = ["BlockRows", "block_matrix", "pattern", "ranges"]

Float = npt.NDArray[np.float64]
Int = npt.NDArray[np.int32]
Long = npt.NDArray[np.int64]


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
    data = np.empty((int(start[-1]), 3, 3))
    column = np.empty(int(start[-1]), dtype=np.int32)
    own = np.zeros(int(start[-1]), dtype=bool)
    own[start[:-1]] = True
    column[own] = np.arange(count)
    column[~own] = rows.neighbour
    few = rows.class_count <= count // 8
    diagonal, table = rows.diagonal / scale, rows.table / scale
    if few:
        # row by row from a padded table: one gather
        joined = np.concatenate([diagonal, table])
        classes = rows.row_class
        at = ranges(rows.table_start[classes], rows.degree) + len(diagonal)
        source = np.empty(int(start[-1]), dtype=np.int64)
        source[own], source[~own] = classes, at
        np.take(joined, source, axis=0, out=data, mode="clip")
    else:
        data[own] = diagonal[rows.row_class]
        same = bool((rows.row_class == np.arange(count)).all())
        order = ranges(rows.table_start[rows.row_class], rows.degree)
        data[~own] = table if same else table[order]
    return bsr_matrix((data, column, start), shape=(3 * count, 3 * count))


def pattern(matrix: bsr_matrix) -> csr_matrix:
    """Where a block matrix has blocks: true at their rows and columns."""
    rows, columns = (n // size for n, size in zip(matrix.shape, matrix.blocksize, strict=True))
    there = np.ones(len(matrix.indices), dtype=bool)
    return csr_matrix((there, matrix.indices, matrix.indptr), shape=(rows, columns))
