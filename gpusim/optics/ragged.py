"""Lists of lists, laid out one after another."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import numpy.typing as npt

__all__ = ["expand", "parts"]

TOGETHER = 1 << 16
"""Items at a time whose temporary arrays stay in a processor's caches."""


def expand(count: npt.NDArray[np.int64]) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """Owner and running number of ``count[i]`` items of each owner i."""
    owner = np.repeat(np.arange(len(count)), count)
    return owner, np.arange(len(owner)) - np.repeat(np.cumsum(count) - count, count)


def parts(count: int) -> Iterator[slice]:
    """Slices of so many items that are looked at together, in order."""
    for first in range(0, count, TOGETHER):
        yield slice(first, min(first + TOGETHER, count))
