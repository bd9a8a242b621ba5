"""The triangles of a view as receivers of light, and the tiles of the picture that they lie in."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from gpusim.optics.corners import CHUNK, NORMAL, corner_range, products
from gpusim.optics.distortion_map import distortion_map
from gpusim.optics.emitters import Lamp
from gpusim.optics.ragged import expand
from gpusim.optics.view import View

__all__ = ["LEVELS", "TILE", "Pairs", "Receivers", "meets", "spread_over"]

Array = npt.NDArray[np.float64]
Numbers = npt.NDArray[np.int64]
TILE = 8
"""px, side of the smallest tiles."""

MARGIN = 1.0
"""px around a tile that count as its own: edge pixels look at points of their neighbourhood."""

STEP = 4.0
"""px between places along edges whose tiles are looked up; with the margin, less than a tile."""

LEVELS = (128, 32, TILE)
"""px, side of the tiles that large triangles are looked up by, one after the other."""

LARGE = 3.0 * TILE
"""px; triangles up to this size are one receiver, larger ones are divided into tiles."""


@dataclass(frozen=True, eq=False)
class Pairs:
    """Triangles and tiles (column, row) of one size that they lie in."""

    triangle: Numbers
    tile: Numbers
    size: int

    def __getitem__(self, index: Numbers | npt.NDArray[np.bool_]) -> Pairs:
        return Pairs(self.triangle[index], self.tile[index], self.size)

    def split(self, size: int) -> Pairs:
        """The smaller tiles under all of them."""
        parts = self.size // size
        step = np.stack(np.meshgrid(np.arange(parts), np.arange(parts)), axis=-1).reshape(-1, 2)
        triangle = np.repeat(self.triangle, parts * parts)
        return Pairs(triangle, (self.tile[:, None] * parts + step).reshape(-1, 2), size)


class Receivers:
    """The triangles of a view as receivers of light, tile by tile."""

    def __init__(self, view: View) -> None:
        self.view, camera = view, view.camera
        T = camera.camera_from_world
        position = view.table.position
        from_eye = [position[:, j] - T[j, 3] for j in range(3)]
        # (3, V): vertices in the world
        self.world = np.zeros((3, len(position)))
        # (3, 3, T): corner, axis
        self.columns = np.empty((3, 3, view.count))
        for axis, world in enumerate(self.world):
            for j in range(3):
                world += T[j, axis] * from_eye[j]
            for k in range(3):
                np.take(world, view.corner[:, k], out=self.columns[k, axis], mode="clip")
        limit = np.array([camera.width, camera.height]) - 0.5
        self.low, self.high = np.empty((2, view.count)).T, np.empty((2, view.count)).T
        # block by block while they are in the cache
        for start in range(0, view.count, CHUNK):
            part = slice(start, start + CHUNK)
            low, high = corner_range(view.screen_of(part))
            np.maximum(low, -0.5, out=self.low[part])
            np.minimum(high, limit, out=self.high[part])
        extent = self.high - self.low
        self.extent = np.maximum(extent[:, 0], extent[:, 1])
        self.large = self.extent > LARGE
        self.rays = T[:3, :3].T @ camera.ray_matrix()
        depth = np.ascontiguousarray(position[:, 2])
        z = [np.take(depth, view.corner[:, k], mode="clip") for k in range(3)]
        self.nearest = np.minimum(np.minimum(z[0], z[1]), z[2])
        self.farthest = np.maximum(np.maximum(z[0], z[1]), z[2])
        self.spots = self.pairs(np.flatnonzero(~self.large), TILE)
        self.behind = self._behind()
        self._away: dict[Lamp, npt.NDArray[np.bool_]] = {}

    @cached_property
    def _number(self) -> Numbers:
        """(T,): of large triangles, which of them each is."""
        return np.cumsum(self.large) - 1

    @cached_property
    def _sides(self) -> list[tuple[Array, Array, Array, Array]]:
        """`_sides` of large triangles."""
        return _sides(self.view.screen_of(np.flatnonzero(self.large)))

    @cached_property
    def _planes(self) -> Array:
        """(3, n): 1 / depth on the planes of large triangles, per column, row and at the origin."""
        planes = self.view.planes_of(np.flatnonzero(self.large))
        return np.ascontiguousarray((planes[:, 0] + planes[:, 1] + planes[:, 2]).T)

    def _behind(self) -> Array:
        """(rows, columns) of tiles: the depth beyond which nothing is seen there, or infinity.

        Where no edge of a surface passes, the one that a tile's middle shows fills the tile: the
        farthest corner of all small triangles there lies no nearer than any of it, as long as it
        has no large ones there.
        """
        camera, spots = self.view.camera, self.spots
        shape = (-(-camera.height // TILE), -(-camera.width // TILE))
        own, place = spots.triangle, spots.tile[:, 1] * shape[1] + spots.tile[:, 0]
        middle = [TILE * (spots.tile[:, axis] + 0.5) - 0.5 for axis in range(2)]
        about = np.ones(len(own), bool)
        for axis, at in enumerate(middle):
            about &= self.low[:, axis][own] <= at
            about &= self.high[:, axis][own] >= at
        rows = np.flatnonzero(about)
        x, y = (at[rows] for at in middle)
        inside = np.ones(len(rows), bool)
        for nx, ny, offset, _ in _sides(self.view.screen_of(own[rows])):
            inside &= nx * x + ny * y + offset >= 0.0
        filled = np.zeros(shape[0] * shape[1], bool)
        filled[self._without_large(rows[inside], place)] = True
        if filled.any():
            filled[_crossed(self.view.edges, shape)] = False
        depth = np.zeros(len(filled))
        np.maximum.at(depth, place, self.farthest[own])
        return np.where(filled, depth, np.inf).reshape(shape)

    def _without_large(self, middle: Numbers, place: Numbers) -> Numbers:
        """The tiles that have a small triangle in their middle, and no large one of its surface.

        ``middle`` (n,): which of ``spots`` these are; ``place``: the numbers of all spots' tiles.
        """
        body, wide = self.view.body, -(-self.view.camera.width // TILE)
        filler = body[self.spots.triangle[middle]]
        some = np.flatnonzero(self.large & np.isin(body, filler))
        large = self.narrowed(some, lambda pairs: np.ones(len(pairs.triangle), bool))
        bodies = int(body[-1]) + 1 if len(body) else 1
        taken = (large.tile[:, 1] * wide + large.tile[:, 0]) * bodies + body[large.triangle]
        own = place[middle]
        return own[~np.isin(own * bodies + filler, taken)]

    def seen(self, pairs: Pairs, points: Array | None = None) -> npt.NDArray[np.bool_]:
        """(n,) whether anything of the triangles may be seen in their tiles, which are small.

        ``points`` (4, 3, n) around what lies there, in place of all of the triangle.
        """
        behind = self.behind[pairs.tile[:, 1], pairs.tile[:, 0]]
        nearest = self.nearest[pairs.triangle]
        if points is not None:
            rows = np.flatnonzero(np.isfinite(behind))
            x, y, z = np.moveaxis(np.take(points, rows, axis=2), 1, 0)
            depth = self.view.camera.camera_from_world[2]
            nearest[rows] = (depth[0] * x + depth[1] * y + depth[2] * z).min(axis=0) + depth[3]
        return np.asarray(nearest <= behind)

    def pairs(self, triangles: Numbers, size: int) -> Pairs:
        """Triangles with the tiles of one size that they may touch."""
        camera, begin, size_in_tiles = self.view.camera, [], []
        # column by column in memory
        for axis, length in enumerate((camera.width, camera.height)):
            first, last = (
                np.floor((np.take(v[:, axis], triangles) + 0.5) / size).astype(np.int64)
                for v in (self.low, self.high)
            )
            # what ends on the picture's border may end on that of a tile too, and begin none
            np.minimum(last, -(-length // size) - 1, out=last)
            begin.append(first)
            size_in_tiles.append(np.maximum(last - first + 1, 0))
        wide, tall = size_in_tiles
        own, offset = expand(wide * tall)
        tile = np.stack([np.take(column, own) for column in begin]).T
        own_wide = np.take(wide, own)
        several = np.flatnonzero(own_wide * np.take(tall, own) > 1)
        down, across = np.divmod(offset[several], own_wide[several])
        tile[several, 0] += across
        tile[several, 1] += down
        pairs = Pairs(triangles[own], tile, size)
        # those in a single tile touch that
        keep = np.ones(len(own), bool)
        keep[several] = self._touch(pairs[several])
        return pairs if keep.all() else pairs[np.flatnonzero(keep)]

    def touched(self, pairs: Pairs) -> Pairs:
        """Those whose tile the triangle may touch."""
        return pairs[np.flatnonzero(self._touch(pairs))]

    def _touch(self, pairs: Pairs) -> npt.NDArray[np.bool_]:
        """(n,): see `touched`."""
        own, size = pairs.triangle, pairs.size
        keep = np.ones(len(own), bool)
        middle = []
        for axis in range(2):
            first = pairs.tile[:, axis] * float(size) - 0.5
            keep &= self.low[:, axis][own] < first + size
            keep &= self.high[:, axis][own] > first
            middle.append(first + 0.5 * size)
        rows = np.flatnonzero(keep & self.large[own])
        own, inside = own[rows], np.ones(len(rows), bool)
        x, y = middle[0][rows], middle[1][rows]
        number = self._number[own]
        for nx, ny, offset, width in self._sides:
            away = nx[number] * x + ny[number] * y + offset[number]
            inside &= away >= -0.5 * size * width[number] - MARGIN
        keep[rows] = inside
        return keep

    def narrowed(self, triangles: Numbers, keep: Callable[[Pairs], npt.NDArray[np.bool_]]) -> Pairs:
        """Large triangles with the smallest tiles that they may touch, within tiles of all sizes
        that are to ``keep``."""
        pairs = self.pairs(triangles, LEVELS[0])
        for size in LEVELS:
            if size != pairs.size:
                pairs = self.touched(pairs.split(size))
            pairs = pairs[keep(pairs)]
        return pairs

    def in_tiles(self, mask: npt.NDArray[np.bool_], own: npt.NDArray[np.bool_]) -> Pairs:
        """Those of the triangles ``own`` (T,) in the smallest tiles of a ``mask`` (rows, columns)
        where something of them may be seen."""
        spots = self.spots[own[self.spots.triangle]]
        spots = spots[meets(spots, mask)]
        pairs = self.narrowed(np.flatnonzero(own & self.large), lambda pairs: meets(pairs, mask))
        both = Pairs(
            np.concatenate([spots.triangle, pairs.triangle]),
            np.concatenate([spots.tile, pairs.tile]), TILE,
        )  # fmt: skip
        return both[self.seen(both)]

    def points(self, pairs: Pairs) -> Array:
        """(4, 3, n) world points around what lies in each tile: of the tile or the triangle.

        Where a triangle is larger than the tile, its plane in the tile's corners: the box around
        them holds what is seen there, as long as the plane is ahead in all of them.
        """
        own, camera = pairs.triangle, self.view.camera
        result = np.take(self.columns, own, axis=2)[[0, 1, 2, 2]]
        large = np.flatnonzero(self.large[own] & (self.extent[own] > 0.7 * pairs.size))
        own = own[large]
        x, y = (pairs.tile[large, axis] * float(pairs.size) - 0.5 for axis in range(2))
        far = pairs.size + MARGIN
        corner = ((-MARGIN, -MARGIN), (far, -MARGIN), (far, far), (-MARGIN, far))
        at = [(x + dx, y + dy) for dx, dy in corner]
        bends = distortion_map(camera)
        if bends is not None:
            at = [tuple(bends.ideal(np.stack(place, axis=1))[0].T) for place in at]
        px, py, p1 = np.take(self._planes, self._number[own], axis=1)
        inverse = [px * u + py * v + p1 for u, v in at]
        least = 0.2 / self.farthest[own]
        # the tile's corners may lie beyond the triangle, where its plane runs away
        sound = (inverse[0] > least) & (inverse[1] > least)
        sound &= (inverse[2] > least) & (inverse[3] > least)
        rows = slice(None) if sound.all() else np.flatnonzero(sound)
        large, eye = large[rows], camera.eye
        for k, (u, v) in enumerate(at):
            depth = 1.0 / inverse[k][rows]
            u, v = u[rows], v[rows]
            for axis, (a, b, c) in enumerate(self.rays):
                result[k, axis][large] = (a * u + b * v + c) * depth + eye[axis]
        return result

    def turned_away(self, lamp: Lamp) -> npt.NDArray[np.bool_]:
        """(T,) whether no corner of a triangle faces any part of the lamp; found once."""
        if lamp not in self._away:
            self._away[lamp] = self._turned_away(lamp)
        return self._away[lamp]

    def _turned_away(self, lamp: Lamp) -> npt.NDArray[np.bool_]:
        normal = np.ascontiguousarray(self.view.vertices[:, NORMAL].T)
        near = 0.0 if lamp.far else 1.0
        reach = np.zeros(normal.shape[1])
        for side in (lamp.u, lamp.v):
            reach += np.abs(products(normal, side))
        # a lamp's farthest corner along the normal
        away = products(normal, lamp.centre) + reach - near * products(normal, self.world) <= 0.0
        result = self._all_corners(away)
        if np.any(lamp.axis) and not lamp.far:
            behind = products(self.world, lamp.axis) - float(lamp.axis @ lamp.centre) <= 0.0
            result |= self._all_corners(behind)
        return result

    def _all_corners(self, flags: npt.NDArray[np.bool_]) -> npt.NDArray[np.bool_]:
        """(T,) whether all corners of a triangle have a flag of vertices (V,)."""
        result = np.ones(self.view.count, bool)
        for k in range(3):
            result &= np.take(flags, self.view.corner[:, k], mode="clip")
        return result

    @cached_property
    def shown(self) -> Array:
        """(3, n): those of the vertices in the world that triangles have."""
        used = np.zeros(self.world.shape[1], bool)
        for k in range(3):
            used[self.view.corner[:, k]] = True
        return np.take(self.world, np.flatnonzero(used), axis=1)


def meets(pairs: Pairs, mask: npt.NDArray[np.bool_]) -> npt.NDArray[np.bool_]:
    """(n,) which of the tiles of pairs hold one of the smallest tiles of a ``mask`` (rows,
    columns)."""
    parts = pairs.size // TILE
    tall, wide = (-(-n // parts) for n in mask.shape)
    room = np.zeros((tall * parts, wide * parts), bool)
    room[: mask.shape[0], : mask.shape[1]] = mask
    held: npt.NDArray[np.bool_] = np.any(room.reshape(tall, parts, wide, parts), axis=(1, 3))
    # tiles beside the picture hold none
    row, column = pairs.tile[:, 1], pairs.tile[:, 0]
    inside = (row < tall) & (column < wide)
    result = np.zeros(len(row), bool)
    result[inside] = held[row[inside], column[inside]]
    return result


def spread_over(pairs: Pairs, shape: tuple[int, int]) -> npt.NDArray[np.bool_]:
    """(rows, columns) which of the smallest tiles lie in tiles of pairs."""
    parts = pairs.size // TILE
    held = np.zeros((-(-shape[0] // parts), -(-shape[1] // parts)), bool)
    held[pairs.tile[:, 1], pairs.tile[:, 0]] = True
    return np.repeat(np.repeat(held, parts, axis=0), parts, axis=1)[: shape[0], : shape[1]]


def _crossed(edges: Array, shape: tuple[int, int]) -> Numbers:
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


def _sides(screen: Array) -> list[tuple[Array, Array, Array, Array]]:
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
