"""SciPy's own kernels for sparse matrices, which its classes call but don't let one call without
copies. The module is private to SciPy (``scipy.sparse._sparsetools``) and is named here alone."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.sparse import _sparsetools

__all__ = ["add_block_product", "add_rows", "counting_sort", "transpose_pattern"]

Float = npt.NDArray[np.floating]
Int = npt.NDArray[np.int32]


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


def add_rows(table: Float, at: Int, values: Float) -> None:
    """Add the rows of ``values`` (…,9) to the rows ``at`` (…) of ``table``, one after the other."""
    count = at.size
    _sparsetools.csc_matvecs(
        len(table), count, 9, np.arange(count + 1, dtype=np.int32),
        np.ascontiguousarray(at, dtype=np.int32).ravel(), np.ones(count),
        np.ascontiguousarray(values).ravel(), table.ravel(),
    )  # fmt: skip


def add_block_product(
    blocks: tuple[Int, Int, Float], shape: tuple[int, int], x: Float, into: Float
) -> None:
    """Add A x to ``into``; ``blocks`` of A: start (R+1,), column and data (T,r,c); ``shape`` A's in
    blocks."""
    start, column, data = blocks
    _, high, wide = data.shape
    rows, columns = shape
    _sparsetools.bsr_matvec(rows, columns, high, wide, start, column, data.reshape(-1), x, into)
