"""Skins of bodies made of cells, for the tests."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt


def skin_of(filled: npt.NDArray[np.bool_]) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """Corners (n, 3), in cells, and quads (m, 4), wound outwards, of the cells that are
    ``filled``."""
    padded, quads = np.pad(filled, 1), []
    for axis in range(3):
        for way in (1, -1):
            corner = np.argwhere(padded & ~np.roll(padded, -way, axis=axis)) - 1
            corner[:, axis] += way == 1
            own = np.repeat(corner[:, None], 4, axis=1)
            own[:, [1, 2], (axis + 1) % 3] += 1
            own[:, [2, 3], (axis + 2) % 3] += 1
            quads.append(own[:, ::way])
    every = np.concatenate(quads).reshape(-1, 3)
    corners, number = np.unique(every, axis=0, return_inverse=True)
    return corners, number.reshape(-1, 4)
