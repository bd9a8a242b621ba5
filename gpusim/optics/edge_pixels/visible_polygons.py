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

from gpusim.arrays.array_types import Bool, Float, Long
from gpusim.arrays.ragged import batches, expand
from gpusim.arrays.unique import distinct
from gpusim.optics.geometry.polygon_clipping import (
    MIN_AREA,
    beyond,
    clip,
    clip_square,
    half_planes,
    moments,
    pick,
)
from gpusim.optics.visibility_buffer import depth_planes

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

    pierced: Bool
    last: Long
    depth: Float


def visible_polygons(
    polygon: Float,
    count: Long,
    planes: Float,
    corners: Float,
    first: Long,
    cutting: Cutting | None = None,
) -> tuple[Long, Float]:
    """Visible parts of triangles: the row (M,) that each belongs to, and the part (M, 8, 2).

    Parameters
    ----------
    polygon, count : (n, 8, 2) and (n,), each triangle inside its pixel.
    planes, corners : (n, 3, 3) half planes and (n, 3, 2) corners, relative to the pixel's centre.
    first : (n,) row of the first triangle over the same pixel; those up to the row itself are in
        front of it.
    cutting : where bodies cut each other, triangles hide each other only where they are nearer.
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
    before = np.where(vertex_buffers, fronts, 0)
    hidden, by = _occlusions(polygon, planes, corners, first, before)
    many = np.bincount(hidden, minlength=len(row))
    begin = np.cumsum(many) - many
    owner = np.flatnonzero(vertex_buffers)
    pieces, size = pick(polygon, owner), count[owner]
    finished: list[tuple[Long, Float]] = []
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


def _occlusions(
    polygon: Float, planes: Float, corners: Float, first: Long, fronts: Long
) -> tuple[Long, Long]:
    """Pairs of rows of which the second hides a part of the first, by rows: as many as ``fronts``
    (n,) tells from row ``first`` (n,) on are before each."""
    behind, before = [np.zeros(0, np.int64)], [np.zeros(0, np.int64)]
    for part in batches(fronts, PAIRS):
        back_row, step = expand(fronts[part])
        back_row += part.start
        front_row = first[back_row] + step
        meets = _overlap(polygon, planes, corners, back_row, front_row)
        behind.append(back_row[meets])
        before.append(front_row[meets])
    return np.concatenate(behind), np.concatenate(before)


def _overlap(polygon: Float, planes: Float, corners: Float, back: Long, front: Long) -> Bool:
    """Whether no side of either triangle separates those of rows ``back`` from ``front`` (n,)."""
    near = np.ones(len(back), bool)
    for axis in np.asfortranarray(polygon).T:
        low, high = axis.min(axis=0), axis.max(axis=0)
        near &= (low[back] < high[front]) & (low[front] < high[back])
    pairs = np.flatnonzero(near)
    for shapes, sides, a, b in ((polygon, planes, back, front), (corners, planes, front, back)):
        pairs = pairs[~beyond(pick(sides, b[pairs]), pick(shapes, a[pairs]), TOUCH)]
    result = np.zeros(len(back), bool)
    result[pairs[back[pairs] != front[pairs]]] = True
    return result


def _subtracted(owner: Long, pieces: Float, size: Long, planes: Float) -> tuple[Long, Float, Long]:
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
    shape, count = np.concatenate(shapes), np.concatenate(counts)
    whose = np.tile(owner, len(shapes))
    solid = np.tile(touched, len(shapes)) & (moments(shape)[0] > SLIVER)
    return (
        np.concatenate([owner[~touched], whose[solid]]),
        np.concatenate([pick(pieces, ~touched), pick(shape, solid)]),
        np.concatenate([size[~touched], count[solid]]),
    )


def _halved(
    owner: Long, pieces: Float, size: Long, planes: Float
) -> tuple[Long, Float, Long, Float]:
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


MAX_THINGS = 32
"""Triangles over a pixel; more of them keep the order of their depths."""

EQUAL = 1e-9
"""Relative 1 / z within which neither is in front."""


def order_overlapping(
    order: Long, entry: Long, paint: npt.NDArray[np.integer], corners: Float, inverse: Float
) -> Long:
    """``order`` with the triangles of touching things put right, pixel by pixel.

    Rows (n,) are triangles over pixels ``entry``: ``paint``, ``corners`` (n, 3, 2) relative to the
    pixel's centre, and ``inverse`` (n, 3) 1 / z there.
    ``order`` sorts rows by entry, then the nearest first.
    """
    across, down, height = depth_planes(corners, inverse).T
    reach = 0.5 * (np.abs(across) + np.abs(down))
    pixel = entry[order]
    count = np.bincount(pixel)
    # rows of the same pixel that come after each one
    after = (np.cumsum(count) - 1)[pixel] - np.arange(len(order))
    after[(count > MAX_THINGS)[pixel]] = 0
    kind = paint[order]
    firsts, seconds = [np.zeros(0, np.int64)], [np.zeros(0, np.int64)]
    first = np.arange(len(order))
    for gap in range(1, MAX_THINGS):
        first = first[after[first] >= gap]
        if not len(first):
            break
        other = first[kind[first] != kind[first + gap]]
        firsts.append(order[other])
        seconds.append(order[other + gap])
    a, b = np.concatenate(firsts), np.concatenate(seconds)
    # the one behind is in front somewhere in the pixel, on the two planes
    steeper = 0.5 * (np.abs(across[b] - across[a]) + np.abs(down[b] - down[a]))
    nearer = height[b] - height[a] + steeper
    maybe = np.flatnonzero(nearer > 0.5 * EQUAL * np.maximum(height[a] - reach[a], 0.0))
    both, behind = np.ones(len(a), bool), np.zeros(len(a), bool)
    both[maybe], middle = _common(pick(corners, a[maybe]), pick(corners, b[maybe]))
    x, y = middle.T
    over = [across[k] * x + down[k] * y + height[k] for k in (a[maybe], b[maybe])]
    behind[maybe] = both[maybe] & (over[1] > over[0] * (1.0 + EQUAL))
    if not behind.any():
        return order
    result = order.copy()
    start = np.cumsum(count) - count
    wrong = distinct(entry[a[behind]])
    disordered = np.isin(entry[a], wrong)
    rest = disordered.copy()
    rest[maybe] = False
    both[rest], _ = _common(pick(corners, a[rest]), pick(corners, b[rest]))
    overlapping = np.flatnonzero(both & disordered)
    front: set[tuple[int, int]] = set()
    for k in overlapping:
        pair = int(a[k]), int(b[k])
        front.add(pair[::-1] if behind[k] else pair)
    for k in wrong:
        waiting = order[start[k] : start[k] + count[k]].tolist()
        sorted_rows: list[int] = []
        while waiting:
            free = (row for row in waiting if not any((one, row) in front for one in waiting))
            sorted_rows.append(next(free, waiting[0]))
            waiting.remove(sorted_rows[-1])
        result[start[k] : start[k] + count[k]] = sorted_rows
    return result


def _common(one: Float, two: Float) -> tuple[Bool, Float]:
    """Whether triangles (n, 3, 2) have a part of the pixel in common, and its middle (n, 2)."""
    planes_one, planes_two = half_planes(one), half_planes(two)
    # neighbours share a side: most pairs are told apart by one line
    meet = np.flatnonzero(~beyond(planes_one, two, MIN_AREA))
    meet = meet[~beyond(pick(planes_two, meet), pick(one, meet), MIN_AREA)]
    polygon, size = clip_square(
        np.concatenate([pick(planes_one, meet), pick(planes_two, meet)], axis=1)
    )
    area, centre = moments(polygon)
    both, middle = np.zeros(len(one), bool), np.zeros((len(one), 2))
    both[meet], middle[meet] = (size > 2) & (area > MIN_AREA), centre
    return both, middle
