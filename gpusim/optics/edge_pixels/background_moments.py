"""What is seen of a plain triangle behind all others of a pixel: what these leave of the pixel.

Where the outline of a fine mesh crosses a pixel before a wall, what is left of the wall has as many
sides as there are triangles along it, and would be cut by one after the other. But the area, the
centroid and the second moments of what is left are those of the pixel less those of what is seen of
the triangles in front; plain paint and light don't ask for more. That holds as long as its shadows
don't end where it does: what stands on the wall is followed piece by piece.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from gpusim.optics.edge_pixels.fragment_lists import EdgePixels
from gpusim.optics.edge_pixels.visible_polygons import depth_planes
from gpusim.optics.geometry.triangle_corners import corner_range
from gpusim.optics.shading.setup import Setup

__all__ = ["CONTACT", "SEVERAL", "backdrops", "fills", "left_open"]

Array = npt.NDArray[np.float64]
Long = npt.NDArray[np.int64]

CONTACT = 8.0
"""Pixels' sides, at its depth, from a backdrop to what is before it, where lamps cast shadows."""

SEVERAL = 6
"""Triangles before it that are worth it where lamps cast shadows: what is left beside fewer may be
in pieces apart from each other, as beside a thin bar, and a shadow end in one of them."""

PIXEL = (1.0, 0.0, 0.0, 1.0 / 12.0, 0.0, 1.0 / 12.0)
"""Area, first and second moments."""


def fills(planes: Array) -> npt.NDArray[np.bool_]:
    """(n,) which triangles fill their pixel, by their half planes (n, 3, 3) from its centre."""
    least = planes[..., 2] - 0.5 * (np.abs(planes[..., 0]) + np.abs(planes[..., 1]))
    return np.asarray(np.all(least >= 0.0, axis=1))


def backdrops(
    setup: Setup, edges: EdgePixels, full: npt.NDArray[np.bool_], corners: Array
) -> npt.NDArray[np.bool_]:
    """(n,) which of the triangles over edge pixels are such: those of ``full`` ones (n,), which
    fill their pixel, with ``corners`` (n, 3, 2) relative to its centre."""
    count, depth = len(edges.pixel), edges.depth
    result = np.zeros(len(full), bool)
    pixel = np.repeat(np.arange(count), depth)
    row = np.flatnonzero(full)
    # the nearest that fills each pixel, behind others
    row = row[np.flatnonzero(np.diff(pixel[row], prepend=-1))]
    own = pixel[row]
    suits = (row > edges.start[own]) & ~edges.pierced[own]
    triangle = edges.triangle[: len(full)]
    suits &= (setup.groups[triangle[row]] == 0) & ~setup.bumpy[triangle[row]]
    row, own = row[suits], own[suits]
    if setup.lighting.shadows is not None and len(row):
        several = row - edges.start[own] >= SEVERAL
        row, own = row[several], own[several]
        last = np.full(count, -1)
        last[own] = row
        front = np.flatnonzero(np.arange(len(full)) < last[pixel])
        farthest = np.full(count, np.inf)
        inverse = corner_range(setup.view.inverse_depth(triangle[front]))[0]
        np.minimum.at(farthest, pixel[front], inverse)
        a, b, c = depth_planes(corners[row], setup.view.inverse_depth(triangle[row])).T
        nearest = 1.0 / (c + 0.5 * (np.abs(a) + np.abs(b)))
        side = float(np.linalg.norm(setup.rays()[:, 0]))
        gap = nearest - 1.0 / farthest[own]
        row = row[gap > CONTACT * side * nearest]
    result[row] = True
    return result


def left_open(
    number: Long, count: int, size: Array, middle: Array, second: Array
) -> tuple[Array, Array, Array]:
    """What pieces leave of ``count`` pixels: area (m,), centroid (m, 2) and second moments (m, 3)
    about the pixel's centre, of which pieces have ``size`` (n,), ``middle`` (n, 2) and ``second``
    (n, 3). ``number`` (n,): the pixel of each piece, -1 for none."""
    own = np.flatnonzero(number >= 0)
    values = np.column_stack([size, size[:, None] * middle, second])[own]
    left = np.stack([
        total - np.bincount(number[own], column, count)
        for total, column in zip(PIXEL, values.T, strict=True)
    ], axis=1)  # fmt: skip
    area = np.maximum(left[:, 0], 0.0)
    return area, left[:, 1:3] / np.where(area > 0.0, area, 1.0)[:, None], left[:, 3:]
