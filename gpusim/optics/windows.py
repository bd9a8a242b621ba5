"""The highest of values in cells, over windows of these."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

__all__ = ["Windows"]

Array = npt.NDArray[np.float64]
Numbers = npt.NDArray[np.int64]


class Windows:
    """Tables of ``values`` (rows, columns), -inf where a cell has none."""

    def __init__(self, values: Array) -> None:
        self.shape = values.shape
        # of squares of 1, 2, 4 … cells that begin at each cell, as far as they fit
        self._blocks = [values]
        while 2 << len(self._blocks) <= 2 * min(values.shape):
            step = 1 << (len(self._blocks) - 1)
            own = self._blocks[-1]
            own = np.maximum(own[:-step], own[step:])
            self._blocks.append(np.maximum(own[:, :-step], own[:, step:]))

    def highest(self, first: Numbers, last: Numbers) -> Array:
        """(n,) the highest of windows from cells ``first`` to ``last`` (2, n), column and row each;
        -inf where they are empty."""
        wide, tall = last - first + 1
        result = np.full(len(wide), -np.inf)
        short = np.minimum(wide, tall)
        for level in np.unique(np.frexp(short[short > 0])[1] - 1):
            own = np.flatnonzero((short > 0) & (np.frexp(short)[1] - 1 == level))
            block, size = self._blocks[level], 1 << int(level)
            across, down = (-(-int(span[own].max()) // size) for span in (wide, tall))
            for k in range(down):
                row = np.minimum(first[1][own] + k * size, last[1][own] + 1 - size)
                for j in range(across):
                    column = np.minimum(first[0][own] + j * size, last[0][own] + 1 - size)
                    result[own] = np.maximum(result[own], block[row, column])
        return result
