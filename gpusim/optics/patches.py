"""Small triangles as receivers of light: together where many of a closed body share a tile.

What hides a lamp from a tile is one list, however many triangles are seen in it: where they are
finer than tiles, asking for each of them what may hide the lamp would make the time grow with their
number. A box around those of one body that look about the same way holds all of them. Open sheets
keep their triangles: those beside a receiver are told from casters by its own plane.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np
import numpy.typing as npt

from gpusim.optics.boxes import Boxes
from gpusim.optics.corners import products
from gpusim.optics.receivers import Receivers, box_size
from gpusim.optics.tile_pairs import Pairs

__all__ = ["Small"]

Array = npt.NDArray[np.float64]
Numbers = npt.NDArray[np.int64]
Flags = npt.NDArray[np.bool_]

FEWEST, WORTH = 5000, 4.0
"""Small triangles, and how many of them a patch has to have in the mean."""

SLACK = 1e-9
"""Of its size, by which a patch is larger."""


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
    triangle, tile = spots.triangle, spots.tile
    corners = np.take(receivers.columns, triangle, axis=2)
    first, second = corners[1] - corners[0], corners[2] - corners[0]
    normal = np.stack([
        first[1] * second[2] - first[2] * second[1],
        first[2] * second[0] - first[0] * second[2],
        first[0] * second[1] - first[1] * second[0],
    ])  # fmt: skip
    axis = np.abs(normal).argmax(axis=0)
    way = 2 * axis + (np.take_along_axis(normal, axis[None], axis=0)[0] > 0.0)
    body = receivers.view.body[triangle]
    key = tile[:, 1]
    for more, limit in ((tile[:, 0], None), (body, None), (way, 6)):
        key = key * (limit or int(more.max()) + 1) + more
    order = np.argsort(key, kind="stable")
    begin = np.flatnonzero(np.diff(key[order], prepend=-1))
    if len(triangle) < WORTH * len(begin):
        return None
    corners, normal = np.take(corners, order, axis=2), np.take(normal, order, axis=1)
    frame = _frames(np.add.reduceat(normal, begin, axis=1))
    owner = np.repeat(np.arange(len(begin)), np.diff(begin, append=len(triangle)))
    low, high = np.empty((2, 3, len(begin)))
    for k, side in enumerate(frame):
        own = np.take(side, owner, axis=1)
        places = [products(own, corner) for corner in corners]
        np.minimum.reduceat(np.minimum.reduce(places), begin, out=low[k])
        np.maximum.reduceat(np.maximum.reduce(places), begin, out=high[k])
    slack = SLACK * (high - low).sum(axis=0)
    low -= slack
    high += slack
    pairs = spots[order[begin]]
    points = _around(receivers, pairs, frame, low, high)
    normal /= np.maximum(np.sqrt(products(normal, normal)), 1e-300)
    normal -= np.take(frame[0], owner, axis=1)
    lean = np.sqrt(np.maximum.reduceat(products(normal, normal), begin))
    boxes = Boxes(points, receivers.view.body[pairs.triangle], lean)
    return Small(
        boxes, pairs.triangle, triangle[order], begin, pairs, np.arange(len(pairs.triangle))
    )


def _around(
    receivers: Receivers, pairs: Pairs, frame: tuple[Array, Array, Array], low: Array, high: Array
) -> Array:
    """(8, 3, n) points around what lies in tiles between ``low`` and ``high`` (3, n) along the
    vectors of a ``frame``: of all of it, or of the slab between two planes in the tile. Four lie in
    the plane at the low end of the first vector, four in that at the high end."""
    boxes = np.stack([
        sum(end[k] * side for k, (end, side) in enumerate(zip(ends, frame, strict=True)))
        for ends in product((low, high), repeat=3)
    ])  # fmt: skip
    eye, normal = receivers.view.camera.eye[:, None], frame[0]
    nearest = products(normal, eye)
    parts, sound = [], np.ones(len(pairs.triangle), bool)
    depth = receivers.nearest[pairs.triangle]
    ways = [receivers.directions(u, v) for u, v in receivers.corners(pairs)]
    for end, way in product((low[0], high[0]), ways):
        with np.errstate(divide="ignore", invalid="ignore"):
            far = (end - nearest) / products(normal, way)
        # planes seen edge-on run away
        sound &= (far > 0.2 * depth) & (far < 5.0 * depth)
        parts.append(eye + np.where(sound, far, 0.0) * way)
    cut = np.stack(parts)
    own = np.flatnonzero(sound)
    own = own[box_size(np.take(cut, own, axis=2)) <= box_size(np.take(boxes, own, axis=2))]
    boxes[:, :, own] = np.take(cut, own, axis=2)
    return boxes


def _frames(normal: Array) -> tuple[Array, Array, Array]:
    """Unit vectors (3, n) along ``normal`` (3, n), and two across it and each other."""
    length = np.sqrt(products(normal, normal))
    unit = np.where(
        length > 0.0, normal / np.where(length > 0.0, length, 1.0), [[1.0], [0.0], [0.0]]
    )
    helper = np.zeros_like(unit)
    np.put_along_axis(helper, np.abs(unit).argmin(axis=0)[None], 1.0, axis=0)
    across = np.cross(unit, helper, axis=0)
    across /= np.sqrt(products(across, across))
    return unit, across, np.cross(unit, across, axis=0)
