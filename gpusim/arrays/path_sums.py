"""Sums along the paths of a tree back to its root."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

__all__ = ["along_paths"]


def along_paths(
    before: npt.NDArray[np.int32], steps: npt.NDArray[np.int64]
) -> npt.NDArray[np.int64]:
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
