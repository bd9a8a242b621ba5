"""Which of two triangles is in front where things touch within a pixel (float64, vectorised).

One depth per triangle and pixel orders what lies apart. Where a thing stands on another, the depths
of both run through each other within the pixel, and only a place that both cover tells.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from gpusim.arrays.unique import distinct
from gpusim.optics.edge_pixels.visible_polygons import depth_planes
from gpusim.optics.geometry.polygon_clipping import (
    MIN_AREA,
    beyond,
    clip_square,
    half_planes,
    moments,
    pick,
)

__all__ = ["order_overlapping"]

Array = npt.NDArray[np.float64]
Long = npt.NDArray[np.int64]

MAX_THINGS = 32
"""Triangles over a pixel; more of them keep the order of their depths."""

EQUAL = 1e-9
"""Relative 1 / z within which neither is in front."""


def order_overlapping(
    order: Long, entry: Long, paint: npt.NDArray[np.integer], corners: Array, inverse: Array
) -> Long:
    """``order`` with the triangles of touching things put right, pixel by pixel.

    Rows (n,) are triangles over pixels ``entry``: ``paint``, ``corners`` (n, 3, 2) relative to the
    pixel's centre, and ``inverse`` (n, 3) 1 / z there.
    ``order`` sorts rows by entry, then the nearest first.
    """
    across, down, height = depth_planes(corners, inverse).T
    reach = 0.5 * (np.abs(across) + np.abs(down))
    own = entry[order]
    count = np.bincount(own)
    # rows of the same pixel that come after each one
    after = (np.cumsum(count) - 1)[own] - np.arange(len(order))
    after[(count > MAX_THINGS)[own]] = 0
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
    there = np.isin(entry[a], wrong)
    rest = there.copy()
    rest[maybe] = False
    both[rest], _ = _common(pick(corners, a[rest]), pick(corners, b[rest]))
    told = np.flatnonzero(both & there)
    front: set[tuple[int, int]] = set()
    for k in told:
        pair = int(a[k]), int(b[k])
        front.add(pair[::-1] if behind[k] else pair)
    for k in wrong:
        left = order[start[k] : start[k] + count[k]].tolist()
        sorted_rows: list[int] = []
        while left:
            free = (row for row in left if not any((one, row) in front for one in left))
            sorted_rows.append(next(free, left[0]))
            left.remove(sorted_rows[-1])
        result[start[k] : start[k] + count[k]] = sorted_rows
    return result


def _common(one: Array, two: Array) -> tuple[npt.NDArray[np.bool_], Array]:
    """Whether triangles (n, 3, 2) have a part of the pixel in common, and its middle (n, 2)."""
    own, other = half_planes(one), half_planes(two)
    # neighbours share a side: most pairs are told apart by one line
    meet = np.flatnonzero(~beyond(own, two, MIN_AREA))
    meet = meet[~beyond(pick(other, meet), pick(one, meet), MIN_AREA)]
    polygon, size = clip_square(np.concatenate([pick(own, meet), pick(other, meet)], axis=1))
    area, centre = moments(polygon)
    both, middle = np.zeros(len(one), bool), np.zeros((len(one), 2))
    both[meet], middle[meet] = (size > 2) & (area > MIN_AREA), centre
    return both, middle
