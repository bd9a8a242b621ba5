"""The triangle that each pixel sees, where triangles are small.

A rasteriser sets triangles up one after another (a software one in a single thread: 600,000 take
0.13 s of processor time). Triangles of a few pixels are drawn here by a compute program, one
invocation each, which takes a third of that. A pixel keeps the largest of 64-bit numbers: depth,
then the triangle's number, so that the result doesn't depend on the order of work. Places are
snapped to 1/256 px, as rasterisers do, and edges are whole numbers from there on: neighbours leave
no gaps. Devices without 64-bit atomics, and views with large triangles, take the rasteriser.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from gpusim.arrays.ragged import expand
from gpusim.optics.geometry.view import FIXED, View

__all__ = ["compute_raster_twin"]

STEPS = 256
"""Of a pixel, to which places are snapped."""


def compute_raster_twin(view: View, row0: int, rows: int) -> npt.NDArray[np.uint32]:
    """Triangle number + 1 (0: none) per pixel of a band, (rows, W) uint32, box by box."""
    width, none = view.camera.width, np.zeros(0, np.int64)
    result = np.zeros((rows, width), np.uint32)
    fixed = np.rint(view.screen * FIXED).astype(np.int64)
    at = (fixed + FIXED // STEPS // 2) // (FIXED // STEPS)
    at[:, :, 1] -= STEPS * row0
    depth = view.inverse_depth()
    area = _cross(at[:, 1] - at[:, 0], at[:, 2] - at[:, 0])
    turned = area < 0
    at[turned], depth[turned] = at[turned][:, [0, 2, 1]], depth[turned][:, [0, 2, 1]]
    low = np.maximum(-(-at.min(axis=1) // STEPS), 0)
    high = np.minimum(at.max(axis=1) // STEPS, [width - 1, rows - 1])
    wide, tall = np.maximum(high - low + 1, 0).T
    owner, offset = expand(np.where(area != 0, wide * tall, 0))
    x = low[owner, 0] + offset % np.maximum(wide, 1)[owner]
    y = low[owner, 1] + offset // np.maximum(wide, 1)[owner]
    centre = STEPS * np.stack([x, y], axis=1)
    inside, z = np.ones(len(owner), bool), np.zeros(len(owner))
    for k in range(3):
        start, end = at[owner, k], at[owner, (k + 1) % 3]
        edge = end - start
        upper = (edge[:, 1] < 0) | ((edge[:, 1] == 0) & (edge[:, 0] > 0))
        opposite = _cross(edge, centre - start)
        inside &= opposite > np.where(upper, -1, 0)
        z += depth[owner, (k + 2) % 3] * opposite
    z = np.where(inside, z, 0.0)[inside] / np.abs(area[owner[inside]])
    owner, pixel = owner[inside], (y * width + x)[inside]
    # the last one of a pixel is the nearest, and the first of those as near
    order = np.lexsort((-owner, z, pixel)) if len(owner) else none
    result.reshape(-1)[pixel[order]] = owner[order] + 1
    return result


def _cross(a: npt.NDArray[np.int64], b: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])
