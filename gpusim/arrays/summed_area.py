"""Boxes on grids of cells: which cells they cover, and how much lies in each of them."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

__all__ = ["covered", "in_boxes", "summed"]

Numbers = npt.NDArray[np.int64]


def covered(first: Numbers, last: Numbers, shape: tuple[int, int]) -> npt.NDArray[np.bool_]:
    """Cells (rows, columns) of boxes from ``first`` to before ``last`` (n, 2), column and row."""
    # the number of boxes over a cell is a sum over their corners
    across, steps = shape[1] + 1, np.zeros((shape[0] + 1) * (shape[1] + 1), np.int64)
    for x, y, sign in ((first, first, 1), (last, first, -1), (first, last, -1), (last, last, 1)):
        steps += sign * np.bincount(y[:, 1] * across + x[:, 0], minlength=len(steps))
    steps = steps.reshape(-1, across).cumsum(axis=0).cumsum(axis=1)
    result: npt.NDArray[np.bool_] = steps[:-1, :-1] > 0
    return result


def summed(cells: npt.NDArray[np.integer] | npt.NDArray[np.bool_]) -> Numbers:
    """The summed-area table of cells (H, W): (H + 1, W + 1), sums of all before each corner."""
    total = np.zeros((cells.shape[0] + 1, cells.shape[1] + 1), np.int64)
    total[1:, 1:] = cells.cumsum(axis=0).cumsum(axis=1)
    return total


def in_boxes(
    total: Numbers, left: Numbers, top: Numbers, right: Numbers, bottom: Numbers
) -> Numbers:
    """Sums (n,) over boxes of cells, ``right`` and ``bottom`` beyond them, by a `summed` table."""
    flat, across = total.ravel(), total.shape[1]
    # one linear index: faster than two
    top, bottom = top * across, bottom * across
    result: Numbers = (
        flat[bottom + right] - flat[top + right] - flat[bottom + left] + flat[top + left]
    )
    return result
