"""Triangles that `gpusim.optics.geometry.clipping.split` would leave as they are: they keep their
vertices.

On fine meshes that is all but some at the border of the picture, and those whose edges show while a
lens bends them.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from gpusim.optics.geometry.clipping import (  # fmt: skip
    CHORD,
    CHORD_INSIDE,
    MAX_BENT_EDGE,
    SURELY_SHORT,
    ImagePlane,
    without_area,
)
from gpusim.optics.geometry.index_buffer import IndexedTriangles
from gpusim.optics.geometry.triangle_corners import CHUNK

__all__ = ["whole_triangles"]

Flags = npt.NDArray[np.bool_]

SHORT = 0.7
"""No edge of a triangle within a box of this side is longer than 1."""


def whole_triangles(
    found: IndexedTriangles, screen: ImagePlane, crossing: Flags
) -> tuple[IndexedTriangles, Flags]:
    """What is drawn as it is of triangles on the ideal image, at its place through the lens.

    ``crossing`` (n,): which have to be clipped. The flags (n,) tell which are done with: what isn't
    drawn of them is out of view.
    """
    # vertices behind the camera are those of triangles that are clipped
    ideal = place = np.where(np.isfinite(found.place), found.place, 0.0)
    bent = screen.camera.lens is not None
    limits = [SURELY_SHORT, SURELY_SHORT]
    if bent:
        place = np.empty((2, len(ideal))).T
        for first in range(0, len(ideal), CHUNK):
            place[first : first + CHUNK] = screen.bent(ideal[first : first + CHUNK])
        limits = [
            SHORT * min(np.sqrt(chord) * screen.straight, MAX_BENT_EDGE)
            for chord in (CHORD_INSIDE, CHORD)
        ]
    count = len(found.source)
    done, drawn, extent = np.empty(count, bool), np.empty(count, bool), 0.0
    for first in range(0, count, CHUNK):
        part = slice(first, first + CHUNK)
        corner = [found.corner[part, k] for k in range(3)]
        straight, own = (
            [[np.take(at[:, axis], c, mode="clip") for c in corner] for axis in range(2)]
            for at in (ideal, place)
        )
        size = np.zeros(len(corner[0]))
        seen = ~without_area(*straight)
        for axis, (a, b, c) in enumerate(own):
            low, high = np.minimum(np.minimum(a, b), c), np.maximum(np.maximum(a, b), c)
            np.maximum(size, high - low, out=size)
            if bent:
                seen &= (high > screen.image[0][axis]) & (low < screen.image[1][axis])
        if bent:
            seen &= _twice_area(*straight) * _twice_area(*own) > 0.0
        done[part] = size <= np.where(found.shows[part].any(axis=1), limits[1], limits[0])
        done[part] &= ~crossing[part]
        drawn[part] = seen & done[part]
        extent = max(extent, float((size * drawn[part]).max()))
    return found.some(drawn, place, extent), done


def _twice_area(
    x: list[npt.NDArray[np.float64]], y: list[npt.NDArray[np.float64]]
) -> npt.NDArray[np.float64]:
    result: npt.NDArray[np.float64]
    result = (x[1] - x[0]) * (y[2] - y[0]) - (y[1] - y[0]) * (x[2] - x[0])
    return result
