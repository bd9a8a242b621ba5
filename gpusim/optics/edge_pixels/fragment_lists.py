"""Edge pixels and the triangles that touch them, nearest first (float64, vectorised).

A pixel is an edge pixel if a silhouette, border, crease or region border of the view passes
through its square, or a line in which two bodies cut each other. The list is exact up to a small
margin outwards, so that no pixel that needs resolving is missed; extra ones cost time, not
accuracy.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from gpusim.arrays.array_types import Bool, Float, Long
from gpusim.arrays.ragged import expand, in_boxes, summed
from gpusim.arrays.unique import distinct
from gpusim.optics.edge_pixels.visible_polygons import order_overlapping
from gpusim.optics.geometry.clipping import ImagePlane
from gpusim.optics.geometry.interpenetration import piercings
from gpusim.optics.geometry.polygon_clipping import pick
from gpusim.optics.geometry.triangle_corners import CHUNK, POSITION, corner_range
from gpusim.optics.geometry.view import View

TILE = 8
"""px, side of the tiles by which triangles far from all edges are sorted out."""

DEPTH = slice(POSITION.stop - 1, POSITION.stop)

MARGIN = 2e-3
"""px by which the square of a pixel is enlarged when edges are looked up."""


@dataclass(frozen=True, eq=False)
class EdgePixels:
    """``pixel`` (E,) linear indices; triangles ``triangle[start[k] : start[k + 1]]``.

    ``pierced`` (E,): bodies cut each other there, so that no order of the triangles is right.
    """

    pixel: Long
    start: Long
    triangle: Long
    pierced: Bool

    @property
    def depth(self) -> Long:
        """(E,) number of triangles over each pixel."""
        return np.diff(self.start)

    def select(self, wanted: Bool | Long) -> EdgePixels:
        """The pixels that are ``wanted`` (E,), or those of these numbers in their order."""
        depth = self.depth[wanted]
        start = np.concatenate([[0], np.cumsum(depth)])
        entries = np.repeat(self.start[:-1][wanted] - start[:-1], depth) + np.arange(start[-1])
        return EdgePixels(self.pixel[wanted], start, self.triangle[entries], self.pierced[wanted])


def segment_pixels(segments: Float, width: int, height: int) -> Long:
    """Sorted linear indices of the pixels whose squares the segments (E, 2, 2) px touch."""
    return distinct(segment_hits(segments, width, height)[0])


def segment_hits(segments: Float, width: int, height: int) -> tuple[Long, Long]:
    """Linear index of a pixel and number of a segment (E, 2, 2) px that touches its square, once
    or more for every such pair."""
    a, b = segments[:, 0], segments[:, 1]
    # clip to the image (Liang and Barsky 1984)
    low = np.full(2, -0.5 - MARGIN)
    high = np.array([width, height]) - 0.5 + MARGIN
    d = b - a
    with np.errstate(divide="ignore", invalid="ignore"):
        t0 = np.where(d != 0.0, (low - a) / d, np.where((a >= low) & (a <= high), -np.inf, np.inf))
        t1 = np.where(d != 0.0, (high - a) / d, np.where((a >= low) & (a <= high), np.inf, -np.inf))
    enter = np.maximum(np.minimum(t0, t1).max(axis=1), 0.0)
    leave = np.minimum(np.maximum(t0, t1).min(axis=1), 1.0)
    keep = np.flatnonzero(enter <= leave)
    a, d = a[keep] + enter[keep, None] * d[keep], (leave - enter)[keep, None] * d[keep]
    b = a + d
    first = np.floor(np.minimum(a[:, 1], b[:, 1]) + 0.5 - MARGIN).astype(np.int64)
    last = np.floor(np.maximum(a[:, 1], b[:, 1]) + 0.5 + MARGIN).astype(np.int64)
    segment, step = expand(last - first + 1)
    row = first[segment] + step
    rise = np.where(d[:, 1] != 0.0, d[:, 1], 1.0)[segment]
    sloped = (d[:, 1] != 0.0)[segment]
    t_low = np.where(sloped, np.clip((row - 0.5 - MARGIN - a[segment, 1]) / rise, 0, 1), 0.0)
    t_high = np.where(sloped, np.clip((row + 0.5 + MARGIN - a[segment, 1]) / rise, 0, 1), 1.0)
    x0 = a[segment, 0] + t_low * d[segment, 0]
    x1 = a[segment, 0] + t_high * d[segment, 0]
    left = np.floor(np.minimum(x0, x1) + 0.5 - MARGIN).astype(np.int64)
    right = np.floor(np.maximum(x0, x1) + 0.5 + MARGIN).astype(np.int64)
    run, step = expand(right - left + 1)
    column, row = left[run] + step, row[run]
    inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
    return row[inside] * width + column[inside], keep[segment[run[inside]]]


def find_edge_pixels(view: View) -> EdgePixels:
    """The edge pixels of a view, each with the triangles over it from the nearest to the farthest.

    The order is that of 1 / z at the triangle's point nearest to the pixel's centre, which never
    extrapolates a steep plane beyond the triangle; where things touch, a place that both cover
    decides.
    """
    width, height = view.camera.width, view.camera.height
    pixel = segment_pixels(view.edges, width, height)
    cut = segment_pixels(_cuts(view), width, height)
    if len(cut):
        pixel = distinct(np.concatenate([pixel, cut]))
    near_triangles, place, low, high = _near_pixels(pixel, view)
    triangle, step = expand(np.maximum(high[:, 1] - low[:, 1] + 1, 0))
    row = low[triangle, 1] + step
    first = np.searchsorted(pixel, row * width + low[triangle, 0])
    last = np.searchsorted(pixel, row * width + high[triangle, 0] + 1)
    run, step = expand(np.maximum(last - first, 0))
    entry, near_row = first[run] + step, triangle[run]
    row, column = np.divmod(pixel, width)
    at = np.stack([column, row]).astype(np.float64)
    corners = _relative(place, near_row, np.take(at, entry, axis=1))
    keep = np.flatnonzero(_touches(corners))
    entry, triangle, corners = entry[keep], near_triangles[near_row[keep]], pick(corners, keep)
    pierced = np.zeros(len(pixel), bool)
    pierced[np.searchsorted(pixel, cut)] = True
    start = np.concatenate([[0], np.cumsum(np.bincount(entry, minlength=len(pixel)))])
    order = np.argsort(entry, kind="stable")
    order = order[_sorted(view, entry[order], triangle[order], pick(corners, order))]
    return EdgePixels(pixel, start, triangle[order], pierced)


def _sorted(
    view: View,
    entry: Long,
    triangle: Long,
    corners: Float,
) -> Long:
    """The order of triangles (n,) over pixels ``entry``, ascending: by pixel, the nearest first."""
    few = distinct(triangle)
    inverse = (1.0 / view.corners_of(few, DEPTH)[:, :, 0])[np.searchsorted(few, triangle)]
    depth = _nearest_depth(corners, inverse)
    order = np.lexsort((triangle, -depth, entry))
    return order_overlapping(order, entry, view.paint[triangle], corners, inverse)


def _cuts(view: View) -> Float:
    """Segments (S, 2, 2) px in which surfaces cut each other ahead of the camera."""
    if not view.count or view.body[0] == view.body[-1]:
        return np.zeros((0, 2, 2))
    number = np.searchsorted(view.body, np.arange(int(view.body[-1]) + 2))
    triangles = view.corners[:, :, POSITION]
    lines = piercings([triangles[a:b] for a, b in pairwise(number)])
    lines = lines[(lines[:, :, 2] > 0.0).all(axis=1)]
    screen = ImagePlane(view.camera)
    ideal = screen.ideal(lines)
    if view.camera.lens is None:
        return ideal
    return screen.bent(ideal.reshape(-1, 2)).reshape(ideal.shape)


def _near_pixels(pixel: Long, view: View) -> tuple[Long, Float, Long, Long]:
    """Numbers (n,) of the triangles in whose boxes a tile holds an edge pixel, where their corners
    are (n, 3, 2), and these boxes: lowest and highest column and row (n, 2) in the image.

    Most faces of a fine mesh have none near; a summed-area table of the tiles tells.
    """
    width, height = view.camera.width, view.camera.height
    held = np.zeros((-(-height // TILE), -(-width // TILE)), np.int32)
    held[pixel // width // TILE, pixel % width // TILE] = 1
    total = summed(held)
    none = np.zeros((0, 2), np.int64)
    parts = [(np.zeros(0, np.int64), np.zeros((2, 3, 0)).T, none, none)]
    count = view.count if len(pixel) else 0
    for start in range(0, count, CHUNK):
        chunk = np.arange(start, min(start + CHUNK, count))
        place = view.screen_of(chunk)
        lowest, highest = corner_range(place)
        low = np.maximum(np.floor(lowest + 0.5), 0.0).astype(np.int64)
        high = np.minimum(np.floor(highest + 0.5), [width - 1, height - 1]).astype(np.int64)
        # beside the image a box is empty
        within = (low[:, 0] <= high[:, 0]) & (low[:, 1] <= high[:, 1])
        if not within.all():
            chunk, low, high = chunk[within], pick(low, within), pick(high, within)
            place = pick(place, within)
        (left, top), (right, bottom) = (low // TILE).T, (high // TILE + 1).T
        near = np.flatnonzero(in_boxes(total, left, top, right, bottom) > 0)
        parts.append((chunk[near], pick(place, near), pick(low, near), pick(high, near)))
    triangles, low, high = (np.concatenate([part[k] for part in parts]) for k in (0, 2, 3))
    # corner by corner in memory
    place = np.concatenate([part[1].T for part in parts], axis=2).T
    return triangles, place, low, high


def _relative(
    place: Float,
    triangle: Long,
    at: Float,
) -> Float:
    """Corners (n, 3, 2) px of some of the triangles ``place`` (T, 3, 2), from places ``at`` (2, n)
    each."""
    result = np.empty((2, 3, len(triangle)))
    for k in range(3):
        for axis in range(2):
            np.take(place[:, k, axis], triangle, out=result[axis, k], mode="clip")
            result[axis, k] -= at[axis]
    return result.T


def _touches(corners: Float) -> Bool:
    """Whether triangles (n, 3, 2) overlap the unit square about the origin (separating axes)."""
    x, y = np.asfortranarray(corners).T
    sides = []
    for k, after in ((0, 1), (1, 2), (2, 0)):
        nx, ny = y[k] - y[after], x[after] - x[k]
        sides.append((nx, ny, -(nx * x[k] + ny * y[k])))
    nx, ny, _ = sides[0]
    sign = np.where(nx * (x[2] - x[0]) + ny * (y[2] - y[0]) < 0.0, -1.0, 1.0)
    result = np.ones(len(corners), bool)
    for nx, ny, offset in sides:
        result &= sign * offset + 0.5 * (np.abs(nx) + np.abs(ny)) > 0.0
    return result


def _nearest_depth(corners: Float, inverse: Float) -> Float:
    """1 / z where the triangle comes closest to the origin (by clamped barycentrics)."""
    x, y = np.asfortranarray(corners).T
    z = np.asfortranarray(inverse).T
    weights = [x[i] * y[j] - y[i] * x[j] for i, j in ((1, 2), (2, 0), (0, 1))]
    total = weights[0] + weights[1] + weights[2]
    scale = 1.0 / np.where(total != 0.0, total, 1.0)
    inside = [np.maximum(weight * scale, 0.0) for weight in weights]
    total = inside[0] + inside[1] + inside[2]
    mean = (inside[0] * z[0] + inside[1] * z[1] + inside[2] * z[2]) / np.where(
        total > 0.0, total, 1.0
    )
    result: Float = np.where(total > 0.0, mean, (z[0] + z[1] + z[2]) / 3.0)
    return result
