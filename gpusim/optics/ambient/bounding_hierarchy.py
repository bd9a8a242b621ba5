"""Things in clusters of clusters, and which of them groups of points need to look at.

Things that lie together and look the same way follow each other; every four make a cluster, every
four of these one of the next level. A cluster that a test refuses for a group of points is left
out with all that is in it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from gpusim.arrays.ragged import expand

__all__ = ["MEMBERS", "BoundingSpheres", "NormalCones", "facing", "in_order", "levels", "traverse"]

Array = npt.NDArray[np.float64]
Numbers = npt.NDArray[np.int64]
Bools = npt.NDArray[np.bool_]

MEMBERS = 4
"""Of a cluster."""

GROUPS = 256
"""Groups of points at a time."""

CLOSED, OPEN, NONE, MIXED = 0, 1, 2, 3
"""Planes of faces that hide by their outside, by both sides, of none, and of several of these."""


@dataclass(frozen=True, eq=False)
class BoundingSpheres:
    """What encloses things or clusters: ``middle`` (N, 3) and ``radius`` (N,)."""

    middle: Array
    radius: Array

    @staticmethod
    def of(points: Array, size: int) -> BoundingSpheres:
        """Around every ``size`` things with points (N, K, 3)."""
        first = np.arange(0, len(points), size)
        low = np.minimum.reduceat(points.min(axis=1), first)
        middle = 0.5 * (low + np.maximum.reduceat(points.max(axis=1), first))
        to = points - np.repeat(middle, size, axis=0)[: len(points), None]
        reach = np.sqrt(np.einsum("nka,nka->nk", to, to)).max(axis=1)
        return BoundingSpheres(middle, np.maximum.reduceat(reach, first))

    @staticmethod
    def around(balls: Array, size: int) -> BoundingSpheres:
        """Around every ``size`` balls (N, 4)."""
        first = np.arange(0, len(balls), size)
        middle, radius = balls[:, :3], balls[:, 3]
        low = np.minimum.reduceat(middle - radius[:, None], first)
        centre = 0.5 * (low + np.maximum.reduceat(middle + radius[:, None], first))
        to = middle - np.repeat(centre, size, axis=0)[: len(balls)]
        return BoundingSpheres(
            centre, np.maximum.reduceat(np.linalg.norm(to, axis=1) + radius, first)
        )


@dataclass(frozen=True, eq=False)
class NormalCones:
    """What planes have in common.

    Their unit normals pass from ``axis`` (N, 3) by ``spread`` (N,) at most, and they have points
    within the things' balls whose products with it are from ``low`` to ``high`` (N,). ``kind``
    (N,): `CLOSED`, `OPEN`, `NONE` or `MIXED`.
    """

    axis: Array
    spread: Array
    low: Array
    high: Array
    kind: Numbers

    @staticmethod
    def of(normal: Array, point: Array, kind: Numbers, size: int) -> NormalCones:
        """Of every ``size`` planes with unit normals and points (N, 3)."""
        first = np.arange(0, len(normal), size)
        axis = np.add.reduceat(normal, first)
        axis /= np.maximum(np.linalg.norm(axis, axis=1), 1e-300)[:, None]
        own = np.repeat(axis, size, axis=0)[: len(normal)]
        product = np.einsum("na,na->n", own, point)
        low, high = np.minimum.reduceat(kind, first), np.maximum.reduceat(kind, first)
        return NormalCones(
            axis, np.maximum.reduceat(np.linalg.norm(normal - own, axis=1), first),
            np.minimum.reduceat(product, first), np.maximum.reduceat(product, first),
            np.where(low == high, low, MIXED),
        )  # fmt: skip


def levels(count: int) -> list[int]:
    """How many of ``count`` things clusters have, level by level, from the largest to the things
    themselves."""
    sizes = [1] if count else []
    while count and count > MEMBERS * sizes[-1]:
        sizes.append(MEMBERS * sizes[-1])
    return sizes[::-1]


def traverse(
    counts: Sequence[int], groups: int, keep: Callable[[int, Numbers, Numbers], Bools]
) -> tuple[Numbers, Numbers]:
    """Which things each group needs: where their lists begin (G + 1,), and the lists.

    ``counts``: clusters of each level, as `levels` has them. ``keep``: of a level's number, groups
    and clusters (P,), whether a group may need something in a cluster.
    """
    if not counts:
        return np.zeros(groups + 1, np.int64), np.zeros(0, np.int64)
    starts, lists = [np.zeros(1, np.int64)], [np.zeros(0, np.int64)]
    for begin in range(0, groups, GROUPS):
        many = min(GROUPS, groups - begin)
        group = np.repeat(np.arange(begin, begin + many), counts[0])
        cluster = np.tile(np.arange(counts[0]), many)
        for level, count in enumerate(counts):
            if level:
                owner, place = expand(np.minimum(count - MEMBERS * cluster, MEMBERS))
                group, cluster = group[owner], MEMBERS * cluster[owner] + place
            kept = np.flatnonzero(keep(level, group, cluster))
            group, cluster = group[kept], cluster[kept]
        starts.append(np.bincount(group - begin, minlength=many))
        lists.append(cluster)
    return np.cumsum(np.concatenate(starts)), np.concatenate(lists)


def in_order(at: Array, *keys: Numbers) -> Numbers:
    """The order (N,) by ``keys`` (N,), the first one above the others, then by where (N, 3) is."""
    low = at.min(axis=0, initial=np.inf) if len(at) else np.zeros(3)
    size = max(float(np.ptp(at, axis=0).max()) if len(at) else 0.0, 1e-300)
    cell = np.minimum((at - low) / size * 1024.0, 1023.0).astype(np.int64)
    key = np.zeros(len(at), np.int64)
    for more in keys:
        key = key * (int(more.max(initial=0)) + 1) + more
    for bit in range(9, -1, -1):
        for axis in range(3):
            key = 2 * key + ((cell[:, axis] >> bit) & 1)
    return np.argsort(key, kind="stable")


def facing(normal: Array) -> Numbers:
    """Which of 27 ways vectors (N, 3) of length 1 or 0 look."""
    whole = np.rint(normal).astype(np.int64) + 1
    return np.asarray((whole[:, 0] * 3 + whole[:, 1]) * 3 + whole[:, 2])
