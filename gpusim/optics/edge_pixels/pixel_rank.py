"""How many of an image's listed pixels come before others: a search without steps.

A word of 64 bits holds 64 pixels, and a number what comes before them. Looking a million pixels up
takes a fifth of what searching the sorted list does.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from gpusim.optics.geometry.triangle_corners import CHUNK

__all__ = ["Ranks"]

Numbers = npt.NDArray[np.int64]


class Ranks:
    """Of ``listed`` (n,) linear indices, ascending and below ``size``."""

    def __init__(self, listed: Numbers, size: int) -> None:
        word = listed >> 6
        self._bits = np.zeros((size >> 6) + 1, np.uint64)
        bit = np.uint64(1) << (listed & 63).astype(np.uint64)
        np.bitwise_or.at(self._bits, word, bit)
        many = np.bitwise_count(self._bits)
        self._before = np.cumsum(many, dtype=np.int64) - many

    def of(self, index: Numbers) -> Numbers:
        """(m,): how many come before linear indices 0 … ``size``."""
        result = np.empty(len(index), np.int64)
        one = np.uint64(1)
        for first in range(0, len(index), CHUNK):
            own = index[first : first + CHUNK]
            word = own >> 6
            below = (one << (own & 63).view(np.uint64)) - one
            below &= np.take(self._bits, word, mode="clip")
            out = result[first : first + CHUNK]
            np.take(self._before, word, out=out, mode="clip")
            out += np.bitwise_count(below)
        return result
