"""What fills the tiles of a picture: beyond it nothing is seen there, nor lit.

Where no edge of a surface passes a tile, what is seen there goes on from what its middle shows
without a jump: from each triangle to others that have points of its depth.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from gpusim.optics.ragged import expand
from gpusim.optics.tile_pairs import TILE, Pairs
from gpusim.optics.view import View

__all__ = ["MARGIN", "Sides", "fronts", "sides_of"]

Array = npt.NDArray[np.float64]
Numbers = npt.NDArray[np.int64]
Shape = tuple[int, int]
Sides = list[tuple[Array, Array, Array, Array]]

MARGIN = 1.0
"""px around a tile that count as its own: edge pixels look at points of their neighbourhood."""

STEP = 4.0
"""px between places along edges whose tiles are looked up; with the margin, less than a tile."""

ROUNDING = 1e-9
"""Of depths."""

ROUNDS = 12
"""From triangles to others, at most."""


def fronts(
    view: View, pairs: Pairs, around: Numbers, nearest: Array, farthest: Array, shape: Shape
) -> Array:
    """(rows, columns) of the smallest tiles: the depth beyond which nothing is seen there, or
    infinity.

    ``pairs``: all triangles in the tiles that are looked at, of depths from ``nearest`` to
    ``farthest`` (n,) there; ``around``: rows of those that may have the tile's middle in them.
    """
    place = pairs.tile[:, 1] * shape[1] + pairs.tile[:, 0]
    x, y = (TILE * (pairs.tile[around, axis] + 0.5) - 0.5 for axis in range(2))
    inside = np.ones(len(around), bool)
    for nx, ny, offset, _ in sides_of(view.screen_of(pairs.triangle[around])):
        inside &= nx * x + ny * y + offset >= 0.0
    rows = around[inside]
    # what the middle shows isn't beyond any of these; all that goes on from there is as deep
    depth = np.full(shape[0] * shape[1], np.inf)
    np.minimum.at(depth, place[rows], farthest[rows])
    depth[_crossed(view.edges, shape)] = np.inf
    # a plane that faces the camera is as near as it is far, but for rounding
    nearest, farthest = nearest * (1.0 - ROUNDING), farthest * (1.0 + ROUNDING)
    depth *= 1.0 + ROUNDING
    for _ in range(ROUNDS):
        part = np.flatnonzero((nearest <= depth[place]) & (farthest > depth[place]))
        if not len(part):
            return depth.reshape(shape)
        np.maximum.at(depth, place[part], farthest[part])
    # the last of these may go on still
    depth[place[(nearest <= depth[place]) & (farthest > depth[place])]] = np.inf
    return depth.reshape(shape)


def _crossed(edges: Array, shape: Shape) -> Numbers:
    """Numbers of tiles that segments (E, 2, 2) px pass, or may pass within `MARGIN`."""
    way = edges[:, 1] - edges[:, 0]
    count = np.ceil(np.abs(way).max(axis=1, initial=0.0) / STEP).astype(np.int64) + 1
    own, step = expand(count)
    at = edges[own, 0] + way[own] * (step / np.maximum(count - 1, 1)[own])[:, None]
    reach = 0.5 * STEP + MARGIN
    found = []
    for dx, dy in ((-reach, -reach), (reach, -reach), (-reach, reach), (reach, reach)):
        column = np.floor((at[:, 0] + (dx + 0.5)) / TILE)
        row = np.floor((at[:, 1] + (dy + 0.5)) / TILE)
        inside = (column >= 0) & (row >= 0) & (column < shape[1]) & (row < shape[0])
        found.append((row[inside] * shape[1] + column[inside]).astype(np.int64))
    return np.concatenate(found)


def sides_of(screen: Array) -> Sides:
    """Per side of triangles (T, 3, 2): x, y, offset of the distance inwards; |x| + |y|."""
    x, y = ([np.ascontiguousarray(screen[:, k, axis]) for k in range(3)] for axis in range(2))
    area = (x[1] - x[0]) * (y[2] - y[0]) - (y[1] - y[0]) * (x[2] - x[0])
    turn = np.where(area < 0.0, -1.0, 1.0)
    result = []
    for k in range(3):
        dx, dy = x[(k + 1) % 3] - x[k], y[(k + 1) % 3] - y[k]
        length = np.hypot(dx, dy)
        scale = turn / np.where(length > 0.0, length, 1.0)
        nx, ny = -dy * scale, dx * scale
        result.append((nx, ny, -(nx * x[k] + ny * y[k]), np.abs(nx) + np.abs(ny)))
    return result
