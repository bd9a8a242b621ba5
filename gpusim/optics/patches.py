"""Small triangles as receivers of light: together where many of a closed body share a tile.

What hides a lamp from a tile is one list, however many triangles are seen in it: where they are
finer than tiles, asking for each of them what may hide the lamp would make the time grow with their
number. A box around those of one body that look about the same way holds all of them. Open sheets
keep their triangles: those beside a receiver are told from casters by its own plane.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from gpusim.optics.boxes import Boxes
from gpusim.optics.corners import products
from gpusim.optics.receivers import Receivers
from gpusim.optics.tile_pairs import Pairs

__all__ = ["Small"]

Array = npt.NDArray[np.float64]
Numbers = npt.NDArray[np.int64]
Flags = npt.NDArray[np.bool_]

FEWEST, WORTH = 5000, 4.0
"""Small triangles, and how many of them a patch has to have in the mean."""

SLACK = 1e-9
"""Of its distances, by which a patch is larger."""

ANY = 2.0
"""How far unit vectors lean from each other at most."""


@dataclass(frozen=True, eq=False)
class Small:
    """Small triangles of a view that may be seen, alone or in patches.

    ``boxes``: points around each of m receivers; ``triangle`` (m,): one of each; ``members`` (k,):
    all of them, receiver by receiver from ``begin`` (m,) on. ``pairs``: the tiles that receivers
    lie in, with one of the triangles; ``which`` (n,): the receiver of each.
    """

    boxes: Boxes
    triangle: Numbers
    members: Numbers
    begin: Numbers
    pairs: Pairs
    which: Numbers

    def some(self, flags: Flags) -> Flags:
        """(m,) receivers of which some triangle has a flag of all triangles (T,)."""
        own = flags[self.members]
        return np.logical_or.reduceat(own, self.begin) if len(self.begin) else own

    def every(self, flags: Flags) -> Flags:
        """(m,) receivers of which all triangles have a flag of all triangles (T,)."""
        return ~self.some(~flags)

    @staticmethod
    def among(receivers: Receivers, flags: Flags) -> Small:
        """Those of a view that have a flag of all triangles (T,), one by one."""
        spots = receivers.spots[flags[receivers.spots.triangle]]
        return _single(receivers, spots[receivers.seen(spots)])

    @staticmethod
    def of(receivers: Receivers, closed: Flags) -> Small:
        """Those of a view; ``closed``: which of its surfaces, by number, are closed."""
        spots = receivers.spots
        spots = spots[receivers.seen(spots)]
        together = np.flatnonzero(closed[receivers.view.body[spots.triangle]])
        found = _patches(receivers, spots[together]) if len(together) >= FEWEST else None
        if found is None:
            return _single(receivers, spots)
        alone = np.ones(len(spots.triangle), bool)
        alone[together] = False
        single = _single(receivers, spots[alone])
        return Small(
            single.boxes.joined(found.boxes), np.concatenate([single.triangle, found.triangle]),
            np.concatenate([single.members, found.members]),
            np.concatenate([single.begin, len(single.members) + found.begin]),
            single.pairs.joined(found.pairs),
            np.concatenate([single.which, len(single.triangle) + found.which]),
        )  # fmt: skip


def _single(receivers: Receivers, spots: Pairs) -> Small:
    """Triangles one by one: each is the same receiver in all of its tiles."""
    used = np.zeros(receivers.view.count, bool)
    used[spots.triangle] = True
    triangle = np.flatnonzero(used)
    which = (np.cumsum(used) - 1)[spots.triangle]
    points = np.take(receivers.columns, triangle, axis=2)[[0, 1, 2, 2]]
    boxes = Boxes.of(points, receivers.view.body[triangle])
    return Small(boxes, triangle, triangle, np.arange(len(triangle)), spots, which)


def _patches(receivers: Receivers, spots: Pairs) -> Small | None:
    """Patches of small triangles, from pairs of these and tiles; None where each has too few."""
    normal = _normals(receivers.columns)
    axis = np.abs(normal).argmax(axis=0)
    way = 2 * axis + (np.take_along_axis(normal, axis[None], axis=0)[0] > 0.0)
    triangle, key = spots.triangle, spots.tile[:, 1]
    body = receivers.view.body
    for more, limit in (
        (spots.tile[:, 0], None), (body[triangle], int(body[-1]) + 1), (way[triangle], 6)
    ):  # fmt: skip
        key = key * (limit or int(more.max()) + 1) + more
    order = np.argsort(key, kind="stable")
    begin = np.flatnonzero(np.diff(key[order], prepend=-1))
    if len(triangle) < WORTH * len(begin):
        return None
    pairs, triangle = spots[order[begin]], triangle[order]
    owner = np.repeat(np.arange(len(begin)), np.diff(begin, append=len(triangle)))
    total = np.stack([np.add.reduceat(n[triangle], begin) for n in normal])
    plane = _unit(total)
    # axis by axis while they are in the cache
    away = [np.zeros(len(triangle)) for _ in range(3)]
    along = np.zeros(len(triangle))
    for own, columns, n in zip(plane, receivers.columns.swapaxes(0, 1), _unit(normal), strict=True):
        own = own[owner]
        for distance, column in zip(away, columns, strict=True):
            distance += own * column[triangle]
        along += own * n[triangle]
    low = np.minimum.reduceat(np.minimum(np.minimum(away[0], away[1]), away[2]), begin)
    high = np.maximum.reduceat(np.maximum(np.maximum(away[0], away[1]), away[2]), begin)
    nearest = np.minimum.reduceat(receivers.nearest[triangle], begin)
    farthest = np.maximum.reduceat(receivers.farthest[triangle], begin)
    points, slab = _around(receivers, pairs, (plane, low, high), (nearest, farthest))
    # how far apart the ends of unit vectors are
    lean = np.sqrt(np.maximum(2.0 - 2.0 * np.minimum.reduceat(along, begin), 0.0))
    lean[~slab] = ANY
    boxes = Boxes(points, receivers.view.body[pairs.triangle], lean)
    return Small(boxes, pairs.triangle, triangle, begin, pairs, np.arange(len(begin)))


def _around(
    receivers: Receivers,
    pairs: Pairs,
    slab: tuple[Array, Array, Array],
    depths: tuple[Array, Array],
) -> tuple[Array, Flags]:
    """(8, 3, n) points around what lies in tiles, each between two planes: of a ``slab``, unit
    normals (3, n) and offsets (n,), or of two ``depths`` (n,) where these hold less; and which of
    both (n,). Four lie in the first plane, then four in the second one."""
    eye = receivers.view.camera.eye[:, None]
    normal, *offsets = slab
    nearest, farthest = depths
    slack = SLACK * np.abs(np.stack([*offsets, *depths])).max(axis=0)
    ways = [receivers.directions(u, v) for u, v in receivers.corners(pairs)]
    fall = [products(normal, way) for way in ways]
    above = products(normal, eye)
    sound, size = np.ones(len(nearest), bool), np.zeros(len(nearest))
    cut = np.empty((2, 4, len(nearest)))
    for end, offset, own in zip((-1.0, 1.0), offsets, cut, strict=True):
        for k, toward in enumerate(fall):
            with np.errstate(divide="ignore", invalid="ignore"):
                own[k] = (offset + end * slack - above) / toward
            # planes seen edge-on run away
            sound &= (own[k] > 0.2 * nearest) & (own[k] < 5.0 * farthest)
            size += end * own[k]
    # the nearer one first, of depths
    thin = sound & (np.abs(size) <= 4.0 * (farthest - nearest + 2.0 * slack))
    ends = (nearest - slack, farthest + slack)
    points = np.stack([
        eye + np.where(thin, far, end) * way
        for own, end in zip(cut, ends, strict=True) for far, way in zip(own, ways, strict=True)
    ])  # fmt: skip
    return points, thin


def _normals(columns: Array) -> Array:
    """(3, T): normals of triangles with corners (3, 3, T): corner, axis; as long as twice their
    area."""
    first, second = columns[1] - columns[0], columns[2] - columns[0]
    return np.stack([
        first[1] * second[2] - first[2] * second[1],
        first[2] * second[0] - first[0] * second[2],
        first[0] * second[1] - first[1] * second[0],
    ])  # fmt: skip


def _unit(vectors: Array) -> Array:
    """Unit vectors (3, n) along those of any length; along x where that is 0."""
    length = np.sqrt(products(vectors, vectors))
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(length > 0.0, vectors / length, [[1.0], [0.0], [0.0]])
