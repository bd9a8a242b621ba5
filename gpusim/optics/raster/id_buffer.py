"""Visibility: which triangle the centre of each pixel sees.

On the device this is the hardware rasteriser, a band of rows at a time; the twin scans rows with
the same rule (a pixel centre on an edge belongs to the triangle on its right or below). The two
may differ by one pixel along an edge, where screen positions are snapped to 1/256 px; such pixels
are edge pixels and are resolved from the exact geometry in `gpusim.optics.edge_pixels.resolve`.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from gpusim.arrays.ragged import batches, expand
from gpusim.optics.geometry.view import View

__all__ = ["visibility_twin"]

CHUNK = 4_000_000


def visibility_twin(view: View) -> npt.NDArray[np.uint32]:
    """Triangle number + 1 (0: none) per pixel, (H, W) uint32, by scanning rows in float64."""
    camera = view.camera
    shape = (camera.height, camera.width)
    nearest = np.zeros(shape[0] * shape[1])
    ids = np.zeros(shape[0] * shape[1], np.uint32)
    screen = np.rint(view.screen * 65536) / 65536
    low = np.maximum(np.ceil(screen[:, :, 1].min(axis=1)), 0).astype(np.int64)
    high = np.minimum(np.ceil(screen[:, :, 1].max(axis=1)), shape[0]).astype(np.int64)
    spans = np.maximum(high - low, 0)
    triangle, row = expand(spans)
    row += low[triangle]
    left, right = _row_interval(screen[triangle], row.astype(np.float64))
    first = np.maximum(np.ceil(left), 0).astype(np.int64)
    count = np.maximum(np.minimum(np.ceil(right), shape[1]).astype(np.int64) - first, 0)
    depth_plane = _depth_planes(screen, view.inverse_depth())
    for part in batches(count, CHUNK):
        span, column = expand(count[part])
        span += part.start
        column += first[span]
        plane = depth_plane[triangle[span]]
        depth = plane[:, 0] * column + plane[:, 1] * row[span] + plane[:, 2]
        pixel = row[span] * shape[1] + column
        better = np.flatnonzero(depth > nearest[pixel])
        better = better[np.argsort(depth[better], kind="stable")]
        nearest[pixel[better]] = depth[better]
        ids[pixel[better]] = triangle[span[better]] + 1
    return ids.reshape(shape)


def _row_interval(
    corners: npt.NDArray[np.float64], row: npt.NDArray[np.float64]
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Where the line y = row enters and leaves each triangle (n, 3, 2)."""
    left = np.full(len(row), np.inf)
    right = np.full(len(row), -np.inf)
    for k in range(3):
        a, b = corners[:, k], corners[:, (k + 1) % 3]
        lower, upper = np.minimum(a[:, 1], b[:, 1]), np.maximum(a[:, 1], b[:, 1])
        crosses = (lower <= row) & (row < upper)
        rise = np.where(crosses, b[:, 1] - a[:, 1], 1.0)
        x = a[:, 0] + (row - a[:, 1]) * (b[:, 0] - a[:, 0]) / rise
        left = np.where(crosses, np.minimum(left, x), left)
        right = np.where(crosses, np.maximum(right, x), right)
    empty = ~(right > left)
    return np.where(empty, 0.0, left), np.where(empty, 0.0, right)


def _depth_planes(
    screen: npt.NDArray[np.float64], inverse: npt.NDArray[np.float64]
) -> npt.NDArray[np.float64]:
    """(T, 3) coefficients of 1 / z = a x + b y + c."""
    d1, d2 = screen[:, 1] - screen[:, 0], screen[:, 2] - screen[:, 0]
    determinant = d1[:, 0] * d2[:, 1] - d1[:, 1] * d2[:, 0]
    determinant = np.where(determinant != 0.0, determinant, np.inf)
    z1, z2 = inverse[:, 1] - inverse[:, 0], inverse[:, 2] - inverse[:, 0]
    a = (z1 * d2[:, 1] - z2 * d1[:, 1]) / determinant
    b = (z2 * d1[:, 0] - z1 * d2[:, 0]) / determinant
    c = inverse[:, 0] - a * screen[:, 0, 0] - b * screen[:, 0, 1]
    return np.stack([a, b, c], axis=1)
