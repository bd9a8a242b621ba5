"""The highest of values in cells, over windows of these."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

__all__ = ["Windows"]

Array = npt.NDArray[np.float64]
Numbers = npt.NDArray[np.int64]

HALVINGS = 64
"""More than a side of a window can be halved."""


class Windows:
    """Tables of ``values`` (rows, columns), -inf where a cell has none.

    Four blocks of 2^i x 2^j cells, which overlap, are a window; the tables of all blocks are made
    as they are asked for (sparse tables: Bender and Farach-Colton, "The LCA problem revisited",
    2000).
    """

    def __init__(self, values: Array) -> None:
        self.shape = values.shape
        self._tables = {(0, 0): values}

    def highest(self, first: Numbers, last: Numbers) -> Array:
        """(n,) the highest of windows from cells ``first`` to ``last`` (2, n), column and row each;
        -inf where they are empty."""
        size = last - first + 1
        result = np.full(size.shape[1], -np.inf)
        some = np.flatnonzero((size > 0).all(axis=0))
        first, last, size = first[:, some], last[:, some], size[:, some]
        column_level, row_level = np.frexp(size)[1] - 1
        level = row_level * HALVINGS + column_level
        for one in np.unique(level):
            own = np.flatnonzero(level == one)
            i, j = divmod(int(one), HALVINGS)
            block = self._table(i, j)
            left, top = first[:, own]
            right, bottom = last[:, own] + 1 - np.array([[1 << j], [1 << i]])
            most = np.maximum(block[top, left], block[top, right])
            np.maximum(most, block[bottom, left], out=most)
            result[some[own]] = np.maximum(most, block[bottom, right], out=most)
        return result

    def _table(self, i: int, j: int) -> Array:
        """The highest of blocks of 2^i rows and 2^j columns by where they begin."""
        if (i, j) not in self._tables:
            if i:
                half, step = self._table(i - 1, j), 1 << (i - 1)
                self._tables[i, j] = np.maximum(half[:-step], half[step:])
            else:
                half, step = self._table(0, j - 1), 1 << (j - 1)
                self._tables[i, j] = np.maximum(half[:, :-step], half[:, step:])
        return self._tables[i, j]
