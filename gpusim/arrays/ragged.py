"""Lists of lists laid out one after another, and running sums over cells and paths."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import numpy.typing as npt

from gpusim.arrays.array_types import Bool, Int, Long

WORKGROUP = 64


def expand(count: Long) -> tuple[Long, Long]:
    """Owner and running number of ``count[i]`` items of each owner i."""
    owner = np.repeat(np.arange(len(count)), count)
    return owner, np.arange(len(owner)) - np.repeat(np.cumsum(count) - count, count)


def cells_of_boxes(first: Long, stop: Long) -> tuple[Long, Long]:
    """Owner (n,) and place (n, 2) of every cell (column, row) of boxes from ``first`` (m, 2) up to
    ``stop`` (m, 2), which lies beyond them."""
    columns, rows = np.maximum(stop - first, 0).T
    owner, number = expand(columns * rows)
    row, column = np.divmod(number, columns[owner])
    return owner, first[owner] + np.stack([column, row], axis=1)


def batches(count: Long, most: int) -> Iterator[slice]:
    """Slices of owners with at most so many items together, or of one that has more."""
    stops = np.cumsum(count)
    start = done = 0
    while start < len(count):
        stop = max(int(np.searchsorted(stops, done + most, side="right")), start + 1)
        yield slice(start, stop)
        start, done = stop, int(stops[stop - 1])


def summed(cells: npt.NDArray[np.integer] | Bool) -> Long:
    """The summed-area table of cells (H, W): (H + 1, W + 1), sums of all before each corner."""
    total = np.zeros((cells.shape[0] + 1, cells.shape[1] + 1), np.int64)
    total[1:, 1:] = cells.cumsum(axis=0).cumsum(axis=1)
    return total


def in_boxes(total: Long, left: Long, top: Long, right: Long, bottom: Long) -> Long:
    """Sums (n,) over boxes of cells, ``right`` and ``bottom`` beyond them, by a `summed` table."""
    flat, across = total.ravel(), total.shape[1]
    # one linear index: faster than two
    top, bottom = top * across, bottom * across
    result: Long = flat[bottom + right] - flat[top + right] - flat[bottom + left] + flat[top + left]
    return result


def along_paths(before: Int, steps: Long) -> Long:
    """(n,…) sums from the root of ``steps`` (n,…), each a node's from the one ``before`` it (n,),
    which is negative where there is none. In each turn twice as far back."""
    total = steps.copy()
    total[before < 0] = 0
    back = np.where(before >= 0, before, np.arange(len(before)))
    while (back != back[back]).any():
        total += total[back]
        back = back[back]
    # all that is left is one step from a root, whose own is zero
    return total


def dealt(order: Long) -> Long:
    """``order`` workgroup by workgroup, so that any run of them has those that it begins with and
    others.

    Software rasterisers give each of their threads one run.
    """
    group = np.arange(len(order)) // WORKGROUP
    turn = np.where(group < len(order) // WORKGROUP, group % WORKGROUP, WORKGROUP)
    return order[np.argsort(turn, kind="stable")]
