"""Host matrix-vector products on all processors: rows are shared out, so the sums don't change.

SciPy's own kernels for sparse matrices add to what is there, which its classes don't let one do
without copies. Their module is private to SciPy (``scipy.sparse._sparsetools``) and named here
alone.
"""

from __future__ import annotations

from functools import cached_property
from itertools import pairwise
from typing import Any, TypeVar

import numpy as np
from scipy.sparse import _sparsetools, bsr_matrix

from gpusim.arrays.array_types import Bool, Float, Int, Real
from gpusim.fem.sparse.block_rows import (
    BlockRows,
    block_diagonal,
    block_matrix,
    diagonal_blocks,
    invert_blocks,
)
from gpusim.parallel.machine import processors
from gpusim.parallel.threads import shared

T = TypeVar("T")
R = TypeVar("R")
Vectors = TypeVar("Vectors", bound=Real)

# below this many stored numbers a thread costs more than it saves, and a part of this many as well
_SMALL, _LEAST_PART = 600_000, 250_000
# parts per processor, so that none waits long for another
_PIECES = 4


def counting_sort(key: Int, other: Int, count: int) -> tuple[Int, Int, Int]:
    """Stable sort by ``key`` (below ``count``): where each key begins, ``other`` and positions."""
    length = len(key)
    start = np.empty(count + 1, dtype=np.int32)
    sorted_other, position = (np.empty(length, dtype=np.int32) for _ in range(2))
    _sparsetools.coo_tocsr(
        count, count, length, key, other, np.arange(length, dtype=np.int32),
        start, sorted_other, position,
    )  # fmt: skip
    return start, sorted_other, position


def transpose_pattern(start: Int, column: Int, value: Int) -> tuple[Int, Int, Int]:
    """Rows of a square matrix (``start``, ``column``, ``value``) as those of its transpose."""
    count = len(start) - 1
    result = np.empty_like(start), np.empty_like(column), np.empty_like(value)
    _sparsetools.csr_tocsc(count, count, start, column, value, *result)
    return result


def add_rows(table: Real, at: Int, values: Real) -> None:
    """Add ``values`` to the rows ``at`` (…) of ``table`` (T,w), one row after the other."""
    count, width = at.size, table.shape[1]
    _sparsetools.csc_matvecs(
        len(table), count, width, np.arange(count + 1, dtype=np.int32),
        np.ascontiguousarray(at, dtype=np.int32).ravel(), np.ones(count),
        np.ascontiguousarray(values).ravel(), table.ravel(),
    )  # fmt: skip


def add_block_product(
    blocks: tuple[Int, Int, Real], shape: tuple[int, int], x: Real, into: Real
) -> None:
    """Add A x to ``into``; ``blocks`` of A: start (R+1,), column and data (T,r,c); ``shape`` A's in
    blocks."""
    start, column, data = blocks
    _, high, wide = data.shape
    rows, columns = shape
    _sparsetools.bsr_matvec(rows, columns, high, wide, start, column, data.reshape(-1), x, into)


def row_shares(matrix: bsr_matrix, count: int) -> list[slice]:
    """Block rows in ``count`` parts with equal shares of the stored blocks."""
    rows = matrix.shape[0] // matrix.blocksize[0]
    share = np.linspace(0, matrix.indptr[-1], count + 1)
    cuts = np.searchsorted(matrix.indptr, share).tolist()
    return [slice(first, last) for first, last in pairwise([0, *cuts[1:-1], rows])]


class Product:
    """x (L,n) -> A x (L,m) for a block matrix, both of the matrix's own dtype.

    A is ``others``, or (``others`` + ``diagonal`` (B,s,s)) / ``scale`` where the diagonal is stored
    ``apart``; the scale is a power of two.
    """

    def __init__(
        self, matrix: bsr_matrix, diagonal: Float | None = None, scale: float = 1.0
    ) -> None:
        self.others, self.scale, self._diagonal = matrix, scale, diagonal
        numbers = matrix.data.size
        most = _PIECES * processors() if numbers > _SMALL else 1
        shares = row_shares(matrix, min(most, 1 + numbers // _LEAST_PART))
        stored = [matrix] if diagonal is None else [matrix, block_diagonal(diagonal)]
        self._parts = [[_Rows(one, share.start, share.stop) for one in stored] for share in shares]

    @staticmethod
    def of_rows(rows: BlockRows, scale: float) -> Product:
        """K / scale. Rows that are all of their own kind are the matrix, but for the diagonal, and
        aren't stored a second time."""
        count = rows.node_count
        if rows.class_count < count or (rows.row_class != np.arange(count)).any():
            return Product(block_matrix(rows, scale))
        others = bsr_matrix((rows.table, rows.neighbour, rows.start), shape=(3 * count, 3 * count))
        return Product(others, rows.diagonal, scale)

    @property
    def apart(self) -> bool:
        return self._diagonal is not None

    @cached_property
    def diagonal(self) -> Float:
        return diagonal_blocks(self.others) if self._diagonal is None else self._diagonal

    @property
    def matrix(self) -> bsr_matrix:
        """A with its diagonal."""
        if self._diagonal is None:
            return self.others
        return bsr_matrix((self.others + block_diagonal(self._diagonal)) / self.scale)

    def block_inverse(self, free: Bool) -> Float:
        """Inverted diagonal blocks (B,s,s) of A, zero where not ``free`` (B,s)."""
        return invert_blocks(np.asarray(self.diagonal / self.scale), free)

    @property
    def unknowns(self) -> int:
        """Number of rows."""
        return int(self.others.shape[0])

    def __call__(self, x: Vectors) -> Vectors:
        result: Any = np.zeros((len(x), self.unknowns), dtype=self.others.dtype)
        tasks = [
            (part, np.ascontiguousarray(one), into)
            for one, into in zip(x, result, strict=True)
            for part in self._parts
        ]
        shared(lambda task: self._add(*task), tasks)
        return result  # type: ignore[no-any-return]

    def _add(self, part: list[_Rows], x: Real, into: Real) -> None:
        for rows in part:
            rows.add(x, into)
        if self.scale != 1.0:
            into[part[0].own] /= self.scale


class _Rows:
    """Some rows of a block matrix. SciPy's own kernel, which its classes call, adds to what is
    there: no sums of parts, no copies."""

    def __init__(self, matrix: bsr_matrix, first: int, last: int) -> None:
        self.first, self.last = first, last
        low, high = int(matrix.indptr[first]), int(matrix.indptr[last])
        start = matrix.indptr[first : last + 1] - matrix.indptr[first]
        self._blocks = start, matrix.indices[low:high], matrix.data[low:high]
        self._columns = matrix.shape[1] // matrix.blocksize[1]
        self.own = slice(matrix.blocksize[0] * first, matrix.blocksize[0] * last)

    def add(self, x: Real, into: Real) -> None:
        """Add the product with all of ``x`` to the rows' part of ``into``."""
        shape = self.last - self.first, self._columns
        add_block_product(self._blocks, shape, x, into[self.own])
