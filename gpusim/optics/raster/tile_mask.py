"""Tiles of a picture under some of its triangles."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from gpusim.arrays.summed_area import covered
from gpusim.optics.geometry.view import View

__all__ = ["under"]


def under(view: View, triangles: npt.NDArray[np.int64], side: int) -> npt.NDArray[np.bool_]:
    """(rows, columns): tiles, ``side`` px wide, within a pixel of the boxes of ``triangles``
    (n,)."""
    shape = (-(-view.camera.height // side), -(-view.camera.width // side))
    first, last = (np.empty((2, len(triangles)), np.int64).T for _ in range(2))
    for ends, own, more in ((first, view.box[0], -0.5), (last, view.box[1], 1.5 + side)):
        for axis, limit in enumerate(shape[::-1]):
            place = np.take(own[:, axis], triangles)
            place += more
            place /= side
            ends[:, axis] = np.clip(np.floor(place), 0, limit)
    return covered(first, last, shape)
