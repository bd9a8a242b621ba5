"""Small triangles of closed bodies that lie together, as one receiver of light each tile.

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

__all__ = ["Patches", "patches"]

Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]

FEWEST, WORTH = 5000, 4.0
"""Small triangles, and how many of them a patch has to have in the mean."""

SLACK = 1e-9
"""Of its size, by which a patch is larger."""


@dataclass(frozen=True, eq=False)
class Patches:
    """``taken`` (n,): which pairs of triangles and tiles went into patches; ``boxes``: eight points
    around each of these; ``pairs``: the tile of each, and one of its triangles."""

    taken: Flags
    boxes: Boxes
    pairs: Pairs


def patches(receivers: Receivers, spots: Pairs, alike: npt.NDArray[np.int64]) -> Patches | None:
    """Patches of small triangles, from pairs of these and tiles; None where there are few.

    ``alike`` (T,): numbers of what may go together, -1 for what may not.
    """
    rows = np.flatnonzero(alike[spots.triangle] >= 0)
    if len(rows) < FEWEST:
        return None
    triangle, tile = spots.triangle[rows], spots.tile[rows]
    corners = np.take(receivers.columns, triangle, axis=2)
    first, second = corners[1] - corners[0], corners[2] - corners[0]
    normal = np.stack([
        first[1] * second[2] - first[2] * second[1],
        first[2] * second[0] - first[0] * second[2],
        first[0] * second[1] - first[1] * second[0],
    ])  # fmt: skip
    axis = np.abs(normal).argmax(axis=0)
    way = 2 * axis + (np.take_along_axis(normal, axis[None], axis=0)[0] > 0.0)
    key = tile[:, 1]
    for more, limit in ((tile[:, 0], None), (alike[triangle], None), (way, 6)):
        key = key * (limit or int(more.max()) + 1) + more
    order = np.argsort(key, kind="stable")
    begin = np.flatnonzero(np.diff(key[order], prepend=-1))
    if len(rows) < WORTH * len(begin):
        return None
    corners = np.take(corners, order, axis=2)
    total = np.add.reduceat(np.take(normal, order, axis=1), begin, axis=1)
    frame = _frames(total)
    owner = np.repeat(np.arange(len(begin)), np.diff(begin, append=len(rows)))
    low, high = np.empty((2, 3, len(begin)))
    for k, side in enumerate(frame):
        own = np.take(side, owner, axis=1)
        places = [products(own, corner) for corner in corners]
        np.minimum.reduceat(np.minimum.reduce(places), begin, out=low[k])
        np.maximum.reduceat(np.maximum.reduce(places), begin, out=high[k])
    slack = SLACK * (high - low).sum(axis=0)
    low -= slack
    high += slack
    one = spots[rows[order[begin]]]
    taken = np.zeros(len(spots.triangle), bool)
    taken[rows] = True
    points = _around(receivers, one, frame, low, high)
    ways = np.take(normal, order, axis=1)
    ways /= np.maximum(np.sqrt(products(ways, ways)), 1e-300)
    ways -= np.take(frame[0], owner, axis=1)
    lean = np.sqrt(np.maximum.reduceat(products(ways, ways), begin))
    return Patches(taken, Boxes(points, receivers.view.body[one.triangle], lean), one)


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
