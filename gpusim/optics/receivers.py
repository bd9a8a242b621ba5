"""The triangles of a view as receivers of light, and the tiles of the picture that they lie in."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property, reduce

import numpy as np
import numpy.typing as npt

from gpusim.optics.corners import NORMAL, products
from gpusim.optics.distortion_map import distortion_map
from gpusim.optics.emitters import Lamp
from gpusim.optics.ragged import expand
from gpusim.optics.tile_fronts import MARGIN, Sides, fronts, sides_of
from gpusim.optics.tile_pairs import LEVELS, NONE, TILE, Pairs, counted, meets
from gpusim.optics.view import View

__all__ = ["Receivers"]

Array = npt.NDArray[np.float64]
Numbers = npt.NDArray[np.int64]
LARGE = 3.0 * TILE
"""px; triangles up to this size are one receiver, larger ones are divided into tiles."""


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
        low, high = view.box
        self.low, self.high = np.maximum(low, -0.5), np.minimum(high, limit)
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
    def _sides(self) -> Sides:
        """`sides_of` large triangles."""
        return sides_of(self.view.screen_of(np.flatnonzero(self.large)))

    @cached_property
    def _planes(self) -> Array:
        """(3, n): 1 / depth on the planes of large triangles, per column, row and at the origin."""
        planes = self.view.planes_of(np.flatnonzero(self.large))
        return np.ascontiguousarray((planes[:, 0] + planes[:, 1] + planes[:, 2]).T)

    def _behind(self) -> Array:
        """(rows, columns) of tiles: see `fronts`; looked for where something may hide another."""
        camera, spots = self.view.camera, self.spots
        shape = (-(-camera.height // TILE), -(-camera.width // TILE))
        if self.view.layer or not self.view.count:
            return np.full(shape, np.inf)

        def several(pairs: Pairs) -> npt.NDArray[np.bool_]:
            """Which large triangles lie in tiles with others."""
            count = counted(pairs, shape, counted(spots.within(pairs.size), shape, NONE))
            return np.asarray(count[pairs.tile[:, 1], pairs.tile[:, 0]] > 1)

        large = self.narrowed(np.flatnonzero(self.large), several)
        both = spots.joined(large)
        nearest, farthest = self.nearest[both.triangle], self.farthest[both.triangle]
        inverse = self._inverse(large)[1]
        least, most = reduce(np.minimum, inverse), reduce(np.maximum, inverse)
        ahead = np.flatnonzero(least > 0.0)
        rows = len(spots.triangle) + ahead
        nearest[rows] = np.maximum(nearest[rows], 1.0 / most[ahead])
        farthest[rows] = np.minimum(farthest[rows], 1.0 / least[ahead])
        # the middle of a tile lies beside most triangles
        middle = TILE * (both.tile + 0.5) - 0.5
        around = np.ones(len(middle), bool)
        for axis in range(2):
            around &= self.low[:, axis][both.triangle] <= middle[:, axis]
            around &= self.high[:, axis][both.triangle] >= middle[:, axis]
        return fronts(self.view, both, np.flatnonzero(around), nearest, farthest, shape)

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
        both = spots.joined(pairs)
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
        at, inverse = self._inverse(pairs[large])
        least = 0.2 / self.farthest[own]
        # the tile's corners may lie beyond the triangle, where its plane runs away
        sound = (inverse[0] > least) & (inverse[1] > least)
        sound &= (inverse[2] > least) & (inverse[3] > least)
        rows = slice(None) if sound.all() else np.flatnonzero(sound)
        large, eye = large[rows], camera.eye
        places = np.empty((4, 3, len(large)))
        for k, (u, v) in enumerate(at):
            depth = 1.0 / inverse[k][rows]
            u, v = u[rows], v[rows]
            for axis, (a, b, c) in enumerate(self.rays):
                places[k, axis] = (a * u + b * v + c) * depth + eye[axis]
        # a plane seen edge-on goes from far before a small triangle to far behind it
        smaller = _size(places) <= _size(np.take(result, large, axis=2))
        if not smaller.all():
            large, places = large[smaller], np.compress(smaller, places, axis=2)
        result[:, :, large] = places
        return result

    def _inverse(self, pairs: Pairs) -> tuple[list[tuple[Array, ...]], list[Array]]:
        """Corners of tiles, as `corners` has them, and 1 / depth (n,) on the planes of their large
        triangles there."""
        at = self.corners(pairs)
        px, py, p1 = np.take(self._planes, self._number[pairs.triangle], axis=1)
        return at, [px * u + py * v + p1 for u, v in at]

    def corners(self, pairs: Pairs) -> list[tuple[Array, ...]]:
        """The corners of tiles: x and y (n,) of each on the undistorted picture."""
        x, y = (pairs.tile[:, axis] * float(pairs.size) - 0.5 for axis in range(2))
        far = pairs.size + MARGIN
        corner = ((-MARGIN, -MARGIN), (far, -MARGIN), (far, far), (-MARGIN, far))
        at: list[tuple[Array, ...]] = [(np.add(x, dx), np.add(y, dy)) for dx, dy in corner]
        bends = distortion_map(self.view.camera)
        if bends is not None:
            at = [tuple(bends.ideal(np.stack(place, axis=1))[0].T) for place in at]
        return at

    def directions(self, u: Array, v: Array) -> Array:
        """(3, n) in the world, of depth 1: towards places on the undistorted picture."""
        return np.stack([a * u + b * v + c for a, b, c in self.rays])

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


def _size(points: Array) -> Array:
    """(n,): sum of the sides of boxes round points (k, 3, n)."""
    sides = reduce(np.maximum, points) - reduce(np.minimum, points)
    result: Array = sides[0] + sides[1] + sides[2]
    return result
