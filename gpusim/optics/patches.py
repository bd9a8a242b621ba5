"""Small triangles as receivers of light: together where many of a closed body share a tile.

Whether anything may be between a lamp and a tile is one question, however many triangles are seen
there: where they are finer than tiles, asking it for each of them would make the time grow with
their number. A box around those of one body that look about the same way holds all of them. What
may hide the lamp is looked for by single triangles where something is: their planes and outlines
tell what lies beside them. Open sheets keep their triangles: their own faces are before them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from gpusim.optics.corners import products
from gpusim.optics.ragged import expand
from gpusim.optics.receiver_planes import Planes
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


@dataclass(frozen=True, eq=False)
class Small:
    """Small triangles of a view that may be seen, alone or in patches.

    ``points`` (k, 3, m) around each receiver; ``triangle`` (m,): one of each. ``pairs``: the tiles
    that receivers lie in, with one of the triangles; ``which`` (n,): the receiver of each.
    ``spots``: all triangles with these tiles, pair by pair from ``begin`` (n,) on. ``planes``: of
    patches, which are the last receivers.
    """

    points: Array
    triangle: Numbers
    pairs: Pairs
    which: Numbers
    spots: Pairs
    begin: Numbers
    planes: Planes

    @property
    def alone(self) -> int:
        """How many receivers are single triangles."""
        return len(self.triangle) - len(self.planes.low)

    @property
    def single(self) -> bool:
        """Whether none are in patches."""
        return len(self.spots.triangle) == len(self.pairs.triangle)

    def some(self, flags: Flags) -> Flags:
        """(m,) receivers of which some triangle has a flag of all triangles (T,)."""
        if self.single:
            return flags[self.triangle]
        own = np.logical_or.reduceat(flags[self.spots.triangle], self.begin)
        result = np.zeros(len(self.triangle), bool)
        result[self.which] = own
        return result

    def every(self, flags: Flags) -> Flags:
        """(m,) receivers of which all triangles have a flag of all triangles (T,)."""
        return ~self.some(~flags)

    def parts(self, rows: Numbers) -> Pairs:
        """All triangles, with their tiles, of some pairs of these and receivers."""
        count = np.diff(self.begin, append=len(self.spots.triangle))[rows]
        own, offset = expand(count)
        return self.spots[self.begin[rows][own] + offset]

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
        points = single.points[[*range(len(single.points)), *[-1] * (len(found.points) - 4)]]
        return Small(
            np.concatenate([points, found.points], axis=2),
            np.concatenate([single.triangle, found.triangle]),
            single.pairs.joined(found.pairs),
            np.concatenate([single.which, len(single.triangle) + found.which]),
            single.spots.joined(found.spots),
            np.concatenate([single.begin, len(single.spots.triangle) + found.begin]),
            found.planes,
        )  # fmt: skip


def _single(receivers: Receivers, spots: Pairs) -> Small:
    """Triangles one by one: each is the same receiver in all of its tiles."""
    used = np.zeros(receivers.view.count, bool)
    used[spots.triangle] = True
    triangle = np.flatnonzero(used)
    which = (np.cumsum(used) - 1)[spots.triangle]
    points = np.take(receivers.columns, triangle, axis=2)[[0, 1, 2, 2]]
    none = Planes.of(np.zeros((3, 3, 0)))
    return Small(points, triangle, spots, which, spots, np.arange(len(which)), none)


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
    spots = spots[order]
    pairs, triangle = spots[begin], spots.triangle
    owner = np.repeat(np.arange(len(begin)), np.diff(begin, append=len(triangle)))
    plane = _unit(np.stack([np.add.reduceat(n[triangle], begin) for n in normal]))
    unit = _unit(normal)
    # axis by axis while they are in the cache
    away, square = [np.zeros(len(triangle)) for _ in range(3)], np.zeros(len(triangle))
    for own, columns, every in zip(plane, receivers.columns.swapaxes(0, 1), unit, strict=True):
        own = own[owner]
        square += (every[triangle] - own) ** 2
        for distance, column in zip(away, columns, strict=True):
            distance += own * column[triangle]
    low = np.minimum.reduceat(np.minimum(np.minimum(away[0], away[1]), away[2]), begin)
    high = np.maximum.reduceat(np.maximum(np.maximum(away[0], away[1]), away[2]), begin)
    nearest = np.minimum.reduceat(receivers.nearest[triangle], begin)
    farthest = np.maximum.reduceat(receivers.farthest[triangle], begin)
    points = _around(receivers, pairs, (plane, low, high), (nearest, farthest))
    spread = np.sqrt(np.maximum.reduceat(square, begin))
    return Small(
        points, pairs.triangle, pairs, np.arange(len(begin)), spots, begin,
        Planes(plane, low, high, spread),
    )  # fmt: skip


def _around(
    receivers: Receivers,
    pairs: Pairs,
    slab: tuple[Array, Array, Array],
    depths: tuple[Array, Array],
) -> Array:
    """(8, 3, n) points around what lies in tiles, each between two planes: of a ``slab``, unit
    normals (3, n) and offsets (n,), or of two ``depths`` (n,) where these hold less."""
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
    thin = sound & (np.abs(size) <= 4.0 * (farthest - nearest + 2.0 * slack))
    ends = (nearest - slack, farthest + slack)
    return np.stack([
        eye + np.where(thin, far, end) * way
        for own, end in zip(cut, ends, strict=True) for far, way in zip(own, ways, strict=True)
    ])  # fmt: skip


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
