"""What is seen of triangles that others hide in part, as exact convex pieces (float64).

Each triangle's polygon inside its pixel loses the triangles in front of it one by one. A convex
polygon less a triangle is at most three convex polygons: the part beyond the first side, the rest
of it beyond the second, and beyond the third (Weiler and Atherton, "Hidden surface removal using
polygon area sorting", SIGGRAPH 1977, with convex parts only). Twin of
``shaders/lib/raster/visible_polygons.wgsl``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from gpusim.arrays.ragged import batches, expand
from gpusim.optics.geometry.polygon_clipping import MIN_AREA, beyond, clip, moments, pick

__all__ = ["SLIVER", "TOUCH", "Cutting", "depth_planes", "visible_polygons"]

Array = npt.NDArray[np.float64]
Long = npt.NDArray[np.int64]

TOUCH = 2e-5
"""px by which neighbours may overlap from rounding alone."""

CORNERS = 8
"""Corners of a piece at most: as each cut may add one, pieces that have too many are halved first,
but no others: a mean over a patterned polygon isn't quite that over its halves."""

SLIVER = 1e-7
"""px^2; smaller parts of what is cut are left out."""

PAIRS = 1 << 20
"""Pairs of triangles that are looked at together, which bounds the memory."""


@dataclass(frozen=True, eq=False)
class Cutting:
    """Which rows (n,) lie over pixels where bodies cut each other, and what tells who is in front.

    ``last`` (n,): the row after the last one over the same pixel; ``depth`` (n, 3): 1 / z as an
    affine function of the place from the pixel's centre.
    """

    pierced: npt.NDArray[np.bool_]
    last: Long
    depth: Array


def depth_planes(corners: Array, inverse: Array) -> Array:
    """(n, 3): 1 / z = a x + b y + c through corners (n, 3, 2), where it is ``inverse`` (n, 3)."""
    x, y = np.asfortranarray(corners).T
    z = np.asfortranarray(inverse).T
    ux, uy, vx, vy = x[1] - x[0], y[1] - y[0], x[2] - x[0], y[2] - y[0]
    area = ux * vy - uy * vx
    safe = np.where(area != 0.0, area, np.inf)
    p, q = z[1] - z[0], z[2] - z[0]
    a = (p * vy - q * uy) / safe
    b = (q * ux - p * vx) / safe
    return np.stack([a, b, z[0] - a * x[0] - b * y[0]]).T


def visible_polygons(
    polygon: Array,
    count: Long,
    planes: Array,
    corners: Array,
    first: Long,
    cutting: Cutting | None = None,
    without: npt.NDArray[np.bool_] | None = None,
) -> tuple[Long, Array]:
    """Visible parts of triangles: the row (M,) that each belongs to, and the part (M, 8, 2).

    Parameters
    ----------
    polygon, count : (n, 8, 2) and (n,), each triangle inside its pixel.
    planes, corners : (n, 3, 3) half planes and (n, 3, 2) corners, relative to the pixel's centre.
    first : (n,) row of the first triangle over the same pixel; those up to the row itself are in
        front of it.
    cutting : where bodies cut each other, triangles hide each other only where they are nearer.
    without : (n,) rows that hide what is behind them, and whose own parts aren't asked for.
    """
    area, _ = moments(polygon)
    vertex_buffers = area > MIN_AREA
    # nothing shows behind a triangle that fills the pixel
    filled = np.concatenate([[0], np.cumsum(area >= 1.0 - MIN_AREA)])
    row = np.arange(len(polygon))
    fronts = row - first
    ahead = filled[:-1] == filled[first]
    if cutting is not None:
        fronts = np.where(cutting.pierced, cutting.last - first, fronts)
        ahead |= cutting.pierced
    vertex_buffers &= ahead
    if without is not None:
        vertex_buffers &= ~without
    before = np.where(vertex_buffers, fronts, 0)
    behind, before_it = [], []
    for part in batches(before, PAIRS):
        own, step = expand(before[part])
        own += part.start
        other = first[own] + step
        meets = _overlap(polygon, planes, corners, own, other)
        behind.append(own[meets])
        before_it.append(other[meets])
    hidden, by = (
        np.concatenate([np.zeros(0, np.int64), *behind]),
        np.concatenate([np.zeros(0, np.int64), *before_it]),
    )
    many = np.bincount(hidden, minlength=len(row))
    begin = np.cumsum(many) - many
    owner = np.flatnonzero(vertex_buffers)
    pieces, size = pick(polygon, owner), count[owner]
    finished: list[tuple[Long, Array]] = []
    turn = 0
    while len(owner):
        due = many[owner] > turn
        finished.append((owner[~due], pick(pieces, ~due)))
        owner, pieces, size = owner[due], pick(pieces, due), size[due]
        front = by[begin[owner] + turn]
        if cutting is None or not cutting.pierced[owner].any():
            owner, pieces, size = _subtracted(owner, pieces, size, pick(planes, front))
        else:
            cut = cutting.pierced[owner]
            nearer = cutting.depth[front[cut]] - cutting.depth[owner[cut]]
            cutter = np.concatenate([planes[front[cut]], nearer[:, None]], axis=1)
            parts = [
                _subtracted(owner[~cut], pick(pieces, ~cut), size[~cut], pick(planes, front[~cut])),
                _subtracted(owner[cut], pick(pieces, cut), size[cut], cutter),
            ]
            owner, pieces, size = (np.concatenate([part[k] for part in parts]) for k in range(3))
        turn += 1
    none = np.zeros(0, np.int64)
    whose = np.concatenate([none, *(part[0] for part in finished)])
    shapes = np.concatenate([pick(polygon, none), *(part[1] for part in finished)])
    order = np.argsort(whose, kind="stable")
    return whose[order], pick(shapes, order)


def _overlap(
    polygon: Array, planes: Array, corners: Array, own: Long, other: Long
) -> npt.NDArray[np.bool_]:
    """Whether no side of either triangle separates those of rows ``own`` from ``other`` (n,)."""
    near = np.ones(len(own), bool)
    for axis in np.asfortranarray(polygon).T:
        low, high = axis.min(axis=0), axis.max(axis=0)
        near &= (low[own] < high[other]) & (low[other] < high[own])
    some = np.flatnonzero(near)
    for shapes, sides, a, b in ((polygon, planes, own, other), (corners, planes, other, own)):
        some = some[~beyond(pick(sides, b[some]), pick(shapes, a[some]), TOUCH)]
    result = np.zeros(len(own), bool)
    result[some[own[some] != other[some]]] = True
    return result


def _subtracted(owner: Long, pieces: Array, size: Long, planes: Array) -> tuple[Long, Array, Long]:
    """Pieces less the convex shapes with half planes (n, K, 3)."""
    owner, pieces, size, planes = _halved(owner, pieces, size, planes)
    rest, corners, n = pieces, size, len(owner)
    shapes, counts = [], []
    for k in range(planes.shape[1]):
        both = np.concatenate([rest, rest])
        sides = np.concatenate([-planes[:, k], planes[:, k]])
        shape, count = clip(both, np.concatenate([corners, corners]), sides)
        shapes.append(shape[:n])
        counts.append(count[:n])
        rest, corners = shape[n:], count[n:]
    touched = moments(rest)[0] > SLIVER
    shape, count, whose = (
        np.concatenate(shapes),
        np.concatenate(counts),
        np.tile(owner, len(shapes)),
    )
    some = np.tile(touched, len(shapes)) & (moments(shape)[0] > SLIVER)
    return (
        np.concatenate([owner[~touched], whose[some]]),
        np.concatenate([pick(pieces, ~touched), pick(shape, some)]),
        np.concatenate([size[~touched], count[some]]),
    )


def _halved(
    owner: Long, pieces: Array, size: Long, planes: Array
) -> tuple[Long, Array, Long, Array]:
    """The same with pieces that all the cuts together leave within `CORNERS` corners."""
    most = CORNERS - planes.shape[1]
    large = size > most
    if not large.any():
        return owner, pieces, size, planes
    number = np.concatenate([np.arange(len(size)), np.flatnonzero(large)])
    first = np.where((np.arange(8) < most)[:, None], pieces, pieces[:, most - 1 : most])
    # padded by its last corner, which is the last of the whole
    second = np.concatenate(
        [pieces[:, :1], pieces[:, most - 1 :], np.repeat(pieces[:, -1:], most - 2, axis=1)],
        axis=1,
    )
    shapes = np.concatenate([np.where(large[:, None, None], first, pieces), second[large]])
    counts = np.concatenate([np.minimum(size, most), size[large] - most + 2])
    return _halved(owner[number], shapes, counts, pick(planes, number))
