"""Host matrix-vector products on all processors: rows are shared out, so the sums don't change."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from itertools import pairwise
from typing import TypeVar

import numpy as np
import numpy.typing as npt
from scipy.sparse import bsr_matrix

from gpusim.fem.assembly.block_rows import BlockRows, block_matrix
from gpusim.fem.assembly.scipy_kernels import add_block_product
from gpusim.parallel.machine import processors

__all__ = ["Product", "RowsProduct", "ahead", "row_shares", "shared"]

Float = npt.NDArray[np.float64]
T = TypeVar("T")
R = TypeVar("R")

# below this many stored numbers a thread costs more than it saves, and a part of this many as well
_SMALL, _LEAST_PART = 600_000, 250_000
# parts per processor, so that none waits long for another
_PIECES = 4


@cache
def _threads(count: int, process: int) -> ThreadPoolExecutor:
    """A copy of a process (`gpusim.parallel.processes`) has none of its threads."""
    del process
    return ThreadPoolExecutor(count, thread_name_prefix="gpusim")


def _pool() -> ThreadPoolExecutor:
    """As many threads as there are processors for this one."""
    return _threads(processors(), os.getpid())


def shared(work: Callable[[T], R], items: Sequence[T]) -> list[R]:
    """``work`` of each item in their order, on all processors that this thread may use; for work
    that NumPy and SciPy do outside the interpreter lock. Not to be called by ``work`` itself."""
    if processors() == 1 or len(items) == 1:
        return [work(item) for item in items]
    return list(_pool().map(work, items))


def ahead(work: Callable[[T], R], items: Sequence[T]) -> Iterator[R]:
    """The same, at most a few beyond the one taken."""
    threads = processors()
    if threads == 1:
        yield from map(work, items)
        return
    waiting = [_pool().submit(work, item) for item in items[:threads]]
    for number in range(len(items)):
        result = waiting.pop(0).result()
        if number + threads < len(items):
            waiting.append(_pool().submit(work, items[number + threads]))
        yield result


def row_shares(matrix: bsr_matrix, count: int) -> list[slice]:
    """Block rows in ``count`` parts with equal shares of the stored blocks."""
    rows = matrix.shape[0] // matrix.blocksize[0]
    share = np.linspace(0, matrix.indptr[-1], count + 1)
    cuts = np.searchsorted(matrix.indptr, share).tolist()
    return [slice(first, last) for first, last in pairwise([0, *cuts[1:-1], rows])]


class Product:
    """x (L,n) -> A x (L,m) for a block matrix, both of the matrix's own dtype."""

    def __init__(self, matrix: bsr_matrix) -> None:
        self._matrix = matrix
        numbers = matrix.data.size
        most = _PIECES * processors() if numbers > _SMALL else 1
        parts = min(most, 1 + numbers // _LEAST_PART)
        self._parts = [_Rows(matrix, own.start, own.stop) for own in row_shares(matrix, parts)]

    @property
    def matrix(self) -> bsr_matrix:
        return self._matrix

    @property
    def unknowns(self) -> int:
        """Number of rows."""
        return int(self._matrix.shape[0])

    def __call__(self, x: Float) -> Float:
        result = np.zeros((len(x), self.unknowns), dtype=self._matrix.dtype)
        tasks = [
            (part, np.ascontiguousarray(one), into)
            for one, into in zip(x, result, strict=True)
            for part in self._parts
        ]
        shared(lambda task: self._add(*task), tasks)
        return result

    def _add(self, part: _Rows, x: Float, into: Float) -> None:
        part.add(x, into)


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

    def add(self, x: Float, into: Float) -> None:
        """Add the product with all of ``x`` to the rows' part of ``into``."""
        shape = self.last - self.first, self._columns
        add_block_product(self._blocks, shape, x, into[self.own])


class RowsProduct(Product):
    """x (L,3N) -> K x / scale for block rows that are all of their own kind: their table is the
    matrix, but for the diagonal, and isn't stored a second time. ``scale`` is a power of two."""

    def __init__(self, rows: BlockRows, scale: float) -> None:
        count = rows.node_count
        shape = (3 * count, 3 * count)
        super().__init__(bsr_matrix((rows.table, rows.neighbour, rows.start), shape=shape))
        self._rows, self.scale = rows, scale
        one = np.arange(count + 1, dtype=np.int32)
        own = bsr_matrix((rows.diagonal, one[:-1], one), shape=shape)
        self._own = [_Rows(own, part.first, part.last) for part in self._parts]

    @staticmethod
    def fits(rows: BlockRows) -> bool:
        """Whether the rows' table is in the order of the nodes."""
        same = rows.class_count == rows.node_count
        return same and bool((rows.row_class == np.arange(rows.node_count)).all())

    @property
    def matrix(self) -> bsr_matrix:
        """K / scale with its diagonal."""
        return block_matrix(self._rows, self.scale)

    @property
    def others(self) -> bsr_matrix:
        """K without its diagonal blocks."""
        return self._matrix

    @property
    def diagonal(self) -> Float:
        """(N,3,3) diagonal blocks of K."""
        return self._rows.diagonal

    def _add(self, part: _Rows, x: Float, into: Float) -> None:
        part.add(x, into)
        self._own[self._parts.index(part)].add(x, into)
        into[part.own] /= self.scale
