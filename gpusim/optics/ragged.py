"""Lists of lists, laid out one after another."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

__all__ = ["expand"]


def expand(count: npt.NDArray[np.int64]) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """Owner and running number of ``count[i]`` items of each owner i."""
    owner = np.repeat(np.arange(len(count)), count)
    return owner, np.arange(len(owner)) - np.repeat(np.cumsum(count) - count, count)
