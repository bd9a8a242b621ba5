"""Lists of lists, laid out one after another."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import numpy.typing as npt

__all__ = ["batches", "cells_of", "expand"]


def expand(count: npt.NDArray[np.int64]) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """Owner and running number of ``count[i]`` items of each owner i."""
    owner = np.repeat(np.arange(len(count)), count)
    return owner, np.arange(len(owner)) - np.repeat(np.cumsum(count) - count, count)


def cells_of(
    first: npt.NDArray[np.int64], last: npt.NDArray[np.int64], columns: int
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """Owner and number of every cell, row by row, of the boxes ``first`` … ``last`` (2, n), column
    and row, of a grid with so many ``columns``; boxes that end before they begin have none."""
    wide, tall = np.maximum(last - first + 1, 0)
    own, step = expand(wide * tall)
    down, across = np.divmod(step, wide[own])
    return own, (first[1][own] + down) * columns + first[0][own] + across


def batches(count: npt.NDArray[np.int64], most: int) -> Iterator[slice]:
    """Slices of owners with at most so many items together, or of one that has more."""
    stops = np.cumsum(count)
    start = done = 0
    while start < len(count):
        stop = max(int(np.searchsorted(stops, done + most, side="right")), start + 1)
        yield slice(start, stop)
        start, done = stop, int(stops[stop - 1])
