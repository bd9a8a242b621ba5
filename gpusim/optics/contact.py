"""Which of two triangles is in front where things touch within a pixel (float64, vectorised).

One depth per triangle and pixel orders what lies apart. Where a thing stands on another, the depths
of both run through each other within the pixel, and only a place that both cover tells.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from gpusim.optics.hidden import depth_planes
from gpusim.optics.polygon import SMALLEST, beyond, clip_square, half_planes, moments

__all__ = ["settle"]

Array = npt.NDArray[np.float64]
Long = npt.NDArray[np.int64]

MOST_THINGS = 12
"""Triangles over a pixel; more of them keep the order of their depths."""

EQUAL = 1e-9
"""Relative 1 / z within which neither is in front."""


def settle(
    order: Long, entry: Long, paint: npt.NDArray[np.integer], corners: Array, inverse: Array
) -> Long:
    """``order`` with the triangles of touching things put right, pixel by pixel.

    Rows (n,) are triangles over pixels ``entry``: ``paint``, ``corners`` (n, 3, 2) relative to the
    pixel's centre, and ``inverse`` (n, 3) 1 / z there.
    ``order`` sorts rows by entry, then the nearest first.
    """
    planes = depth_planes(corners, inverse)
    slope, height = planes[:, :2], planes[:, 2]
    reach = 0.5 * np.abs(slope).sum(axis=1)
    own = entry[order]
    count = np.bincount(own)
    place = np.arange(len(order)) - (np.cumsum(count) - count)[own]
    pairs = [np.zeros((0, 2), np.int64)]
    for gap in range(1, min(MOST_THINGS, int(count.max(initial=0)))):
        first = np.flatnonzero((place + gap < count[own]) & (count[own] <= MOST_THINGS))
        a, b = order[first], order[first + gap]
        other = paint[a] != paint[b]
        pairs.append(np.stack([a, b], axis=1)[other])
    a, b = np.concatenate(pairs).T
    # the one behind is in front somewhere in the pixel, on the two planes
    steeper = 0.5 * np.abs(slope[b] - slope[a]).sum(axis=1)
    nearer = height[b] - height[a] + steeper
    maybe = np.flatnonzero(nearer > 0.5 * EQUAL * np.maximum(height[a] - reach[a], 0.0))
    both, behind = np.ones(len(a), bool), np.zeros(len(a), bool)
    both[maybe], middle = _common(corners[a[maybe]], corners[b[maybe]])
    over = [np.sum(slope[k[maybe]] * middle, axis=1) + height[k[maybe]] for k in (a, b)]
    behind[maybe] = both[maybe] & (over[1] > over[0] * (1.0 + EQUAL))
    if not behind.any():
        return order
    result = order.copy()
    start = np.cumsum(count) - count
    wrong = np.unique(entry[a[behind]])
    there = np.isin(entry[a], wrong)
    rest = there.copy()
    rest[maybe] = False
    both[rest], _ = _common(corners[a[rest]], corners[b[rest]])
    told = np.flatnonzero(both & there)
    front: set[tuple[int, int]] = set()
    for k in told:
        pair = int(a[k]), int(b[k])
        front.add(pair[::-1] if behind[k] else pair)
    for k in wrong:
        rows = order[start[k] : start[k] + count[k]].tolist()
        sorted_rows: list[int] = []
        while rows:
            free = (row for row in rows if not any((one, row) in front for one in rows))
            sorted_rows.append(next(free, rows[0]))
            rows.remove(sorted_rows[-1])
        result[start[k] : start[k] + count[k]] = sorted_rows
    return result


def _common(one: Array, two: Array) -> tuple[npt.NDArray[np.bool_], Array]:
    """Whether triangles (n, 3, 2) have a part of the pixel in common, and its middle (n, 2)."""
    own, other = half_planes(one), half_planes(two)
    # neighbours share a side: most pairs are told apart by one line
    meet = np.flatnonzero(~beyond(own, two, SMALLEST) & ~beyond(other, one, SMALLEST))
    polygon, size = clip_square(np.concatenate([own[meet], other[meet]], axis=1))
    area, centre = moments(polygon)
    both, middle = np.zeros(len(one), bool), np.zeros((len(one), 2))
    both[meet], middle[meet] = (size > 2) & (area > SMALLEST), centre
    return both, middle
