"""Tiles of the image in which a lamp is half hidden, each with the faces that may hide it.

Visibility changes only across the outline of what a lamp lights. A tile whose receivers have no
face at such an outline between them and the lamp is lit or dark as a whole, which one ray tells;
only the rest is resolved pixel by pixel. Tiles are divided from 128 px down to 8.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from gpusim.errors import InputError
from gpusim.optics.binning import expand
from gpusim.optics.casters import Casters
from gpusim.optics.distortion_map import distortion_map
from gpusim.optics.emitters import Lamp
from gpusim.optics.lamp_grid import LampGrid, LampView
from gpusim.optics.occlusion import TOLERANCE, visible_share
from gpusim.optics.view import NORMAL, View

__all__ = ["MOST_LAMPS", "TILE", "TURNS", "ShadowTiles", "flatness"]

Array = npt.NDArray[np.float64]
Numbers = npt.NDArray[np.int64]
LEVELS = (128, 32, 8)
TILE = LEVELS[-1]
MOST_LAMPS = 16
TURNS = 6
"""Turns of the shaders' loops that one face may take."""

MARGIN = 1.0
"""px around a tile that count as its own: edge pixels look at points of their neighbourhood."""

LARGE = 3.0 * TILE
"""px; triangles up to this size are one receiver, larger ones are divided into tiles."""

ALL = (1 << MOST_LAMPS) - 1


FLATNESS = 1e-3
"""px of the picture by which joining casters' faces may move a shadow."""


def flatness(view: View, lamps: list[Lamp]) -> Callable[[Array], Array]:
    """How far joined faces may pass from casters' points (N, 3), as `Casters.of` asks.

    A caster's error is seen at the nearest receiver, as much larger as that is farther from the
    lamp. It stays below what the exact test of a face's plane lets through (`TOLERANCE`).
    """
    T = view.camera.camera_from_world
    receivers = ((view.corners[:, :, :3] - T[:3, 3]) @ T[:3, :3]).reshape(-1, 3)
    depth = 1.0 / max(float(view.inverse_depth().max(initial=0.0)), 1e-300)
    share = min(FLATNESS / float(np.abs(np.diag(view.camera.K)[:2]).max()), 0.1 * TOLERANCE)

    def allowed(points: Array) -> Array:
        result = np.full(len(points), share * depth)
        for lamp in lamps:
            if not lamp.far and len(receivers):
                farthest = float(np.linalg.norm(receivers - lamp.centre, axis=1).max())
                near = np.linalg.norm(points - lamp.centre, axis=1)
                result = np.minimum(result, share * depth * near / farthest)
        return result

    return allowed


@dataclass(frozen=True, eq=False)
class ShadowTiles:
    """What the tiles of a view see of each lamp.

    ``lamps``: their centres are relative to the eye.
    ``lit`` (rows, columns): bit l is set where lamp l lights the tile (fully, or in part).
    ``entry`` (rows, columns): number of the tile among those in half shadow + 1, or 0.
    ``place`` (E, 2): row and column of these; ``start`` (E, L) and ``count`` (E, L): where the
    faces of lamp l lie in ``face`` (indices into ``corners``); a count of 0 where `lit` holds.
    ``corners`` (F, 4, 3) relative to the eye, ``both_sides`` (F,): see `Casters`.
    """

    lamps: tuple[Lamp, ...]
    lit: npt.NDArray[np.uint32]
    entry: npt.NDArray[np.uint32]
    place: Numbers
    start: Numbers
    count: Numbers
    face: Numbers
    corners: Array
    both_sides: npt.NDArray[np.bool_]

    @staticmethod
    def build(view: View, lamps: list[Lamp], casters: Casters) -> ShadowTiles:
        """Classify every tile of ``view`` for every lamp that casts shadows."""
        if len(lamps) > MOST_LAMPS:
            raise InputError(
                f"render lights; got {len(lamps)} lamps; expected at most {MOST_LAMPS}"
            )
        shape = (-(-view.camera.height // TILE), -(-view.camera.width // TILE))
        lit = np.full(shape, ALL, np.uint32)
        receivers = _Receivers(view)
        tiles, lamp_of, faces = [], [], []
        for number, lamp in enumerate(lamps):
            if not lamp.light.shadows or not view.count or not len(casters.corners):
                continue
            dark, tile, face = _half_shadow(receivers, lamp, casters, shape)
            lit.reshape(-1)[dark] &= np.uint32(ALL ^ (1 << number))
            tiles.append(tile)
            faces.append(face)
            lamp_of.append(np.full(len(tile), number))
        tile = np.concatenate([np.zeros(0, np.int64), *tiles])
        lamp_number = np.concatenate([np.zeros(0, np.int64), *lamp_of])
        face = np.concatenate([np.zeros(0, np.int64), *faces])
        entries = np.unique(tile)
        row = np.searchsorted(entries, tile) * max(len(lamps), 1) + lamp_number
        order = np.argsort(row, kind="stable")
        count = np.bincount(row, minlength=len(entries) * max(len(lamps), 1))
        used, face = np.unique(face[order], return_inverse=True)
        entry = np.zeros(shape, np.uint32)
        entry.reshape(-1)[entries] = np.arange(1, len(entries) + 1)
        return ShadowTiles(
            tuple(_relative_to(lamp, view.camera.eye) for lamp in lamps), lit, entry,
            np.stack([entries // shape[1], entries % shape[1]], axis=1),
            (np.cumsum(count) - count).reshape(len(entries), len(lamps)),
            count.reshape(len(entries), len(lamps)),
            face.reshape(-1).astype(np.int64),
            casters.corners[used] - view.camera.eye,
            casters.both_sides[used],
        )  # fmt: skip

    def shares(self, x: Array, y: Array, at: Array, across: Array, down: Array) -> Array:
        """What receivers see of each lamp, (n, L), 0 to 1.

        ``x``, ``y`` (n,) px; ``at`` (n, 3) their places relative to the eye; ``across``, ``down``
        (n, 3) how these change per column and row.
        """
        limit = np.array(self.lit.shape) - 1
        row = np.clip(np.floor((y + 0.5) / TILE).astype(np.int64), 0, limit[0])
        column = np.clip(np.floor((x + 0.5) / TILE).astype(np.int64), 0, limit[1])
        bits, entry = self.lit[row, column], self.entry[row, column].astype(np.int64) - 1
        tolerance = TOLERANCE * np.linalg.norm(at, axis=1)
        result = np.zeros((len(x), len(self.lamps)))
        for number, lamp in enumerate(self.lamps):
            result[:, number] = (bits >> np.uint32(number)) & np.uint32(1)
            half = np.flatnonzero(entry >= 0)
            half = half[self.count[entry[half], number] > 0]
            own = entry[half]
            count = self.count[own, number]
            receiver = np.repeat(np.arange(len(half)), count)
            offset = np.arange(len(receiver)) - np.repeat(np.cumsum(count) - count, count)
            face = self.face[self.start[own, number][receiver] + offset]
            result[half, number] = visible_share(
                lamp, at[half], across[half], down[half], receiver, self.corners[face],
                self.both_sides[face], tolerance[half],
            )  # fmt: skip
        return result

    @property
    def any(self) -> bool:
        """Whether there is any shadow in the picture."""
        return bool(len(self.place) or (self.lit != ALL).any())


@dataclass(frozen=True, eq=False)
class _Pairs:
    """Triangles and tiles (column, row) of one size that they lie in."""

    triangle: Numbers
    tile: Numbers
    size: int

    def __getitem__(self, index: Numbers | npt.NDArray[np.bool_]) -> _Pairs:
        return _Pairs(self.triangle[index], self.tile[index], self.size)

    def split(self, size: int, low: Array, high: Array) -> _Pairs:
        """The smaller tiles under the boxes ``low`` … ``high`` (T, 2) px of the triangles."""
        parts = self.size // size
        step = np.stack(np.meshgrid(np.arange(parts), np.arange(parts)), axis=-1).reshape(-1, 2)
        triangle = np.repeat(self.triangle, parts * parts)
        tile = (self.tile[:, None] * parts + step).reshape(-1, 2)
        first, last = tile * size - 0.5, (tile + 1) * size - 0.5
        keep = ((low[triangle] < last) & (high[triangle] > first)).all(axis=1)
        return _Pairs(triangle[keep], tile[keep], size)


class _Receivers:
    """The triangles of a view as receivers of light, tile by tile."""

    def __init__(self, view: View) -> None:
        self.view, camera = view, view.camera
        T = camera.camera_from_world
        self.corners = (view.corners[:, :, :3] - T[:3, 3]) @ T[:3, :3]
        limit = np.array([camera.width, camera.height]) - 0.5
        self.low = np.maximum(view.screen.min(axis=1), -0.5)
        self.high = np.minimum(view.screen.max(axis=1), limit)
        self.extent = (self.high - self.low).max(axis=1)
        self.large = self.extent > LARGE
        self.planes = view.planes.sum(axis=1)
        self.rays = T[:3, :3].T @ camera.ray_matrix()

    def pairs(self) -> _Pairs:
        """Every triangle with the largest tiles that its box touches."""
        size = LEVELS[0]
        first = np.floor((self.low + 0.5) / size).astype(np.int64)
        last = np.floor((self.high + 0.5) / size).astype(np.int64)
        # what ends on the picture's border may end on that of a tile too, and begin none
        camera = self.view.camera
        last = np.minimum(last, np.array([-(-camera.width // size), -(-camera.height // size)]) - 1)
        wide, tall = np.maximum(last - first + 1, 0).T
        triangle = np.repeat(np.arange(self.view.count), wide * tall)
        per = wide * tall
        offset = np.arange(len(triangle)) - np.repeat(np.cumsum(per) - per, per)
        step = np.stack([offset % wide[triangle], offset // wide[triangle]], axis=1)
        return _Pairs(triangle, first[triangle] + step, size)

    def points(self, pairs: _Pairs) -> Array:
        """(n, 4, 3) world points around what lies in each tile: of the tile or the triangle.

        Where a triangle is larger than the tile, its plane in the tile's corners: the box around
        them holds what is seen there, as long as the plane is ahead in all of them.
        """
        own = pairs.triangle
        result = self.corners[own][:, [0, 1, 2, 2]]
        large = np.flatnonzero(self.large[own] & (self.extent[own] > 0.7 * pairs.size))
        corner = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
        at = (pairs.tile[large][:, None] + corner) * pairs.size - 0.5
        at += MARGIN * (2.0 * corner - 1.0)
        bends = distortion_map(self.view.camera)
        if bends is not None:
            at = bends.ideal(at.reshape(-1, 2))[0].reshape(at.shape)
        pixel = np.concatenate([at, np.ones((*at.shape[:2], 1))], axis=2)
        inverse = np.einsum("nka,na->nk", pixel, self.planes[own[large]])
        depths = self.view.inverse_depth()[own[large]]
        # the tile's corners may lie beyond the triangle, where its plane runs away
        sound = (inverse > 0.2 * depths.min(axis=1)[:, None]).all(axis=1)
        large, inverse, pixel = large[sound], inverse[sound], pixel[sound]
        camera = self.view.camera
        result[large] = (pixel @ self.rays.T) / inverse[..., None] + camera.eye
        return result

    def turned_away(self, lamp: Lamp) -> npt.NDArray[np.bool_]:
        """(T,) whether no corner of a triangle faces any part of the lamp."""
        away = np.ones(self.view.count, bool)
        normal = self.view.corners[:, :, NORMAL]
        near = 0.0 if lamp.far else 1.0
        for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1)):
            to = lamp.centre + a * lamp.u + b * lamp.v - near * self.corners
            away &= (np.sum(normal * to, axis=2) <= 0.0).all(axis=1)
        if np.any(lamp.axis) and not lamp.far:
            away |= (((self.corners - lamp.centre) @ lamp.axis) <= 0.0).all(axis=1)
        return away


def _half_shadow(
    receivers: _Receivers, lamp: Lamp, casters: Casters, shape: tuple[int, int]
) -> tuple[Numbers, Numbers, Numbers]:
    """Tiles (linear) that a lamp doesn't light; pairs (tile, face) of those that it half lights."""
    everything = receivers.corners.reshape(-1, 3)
    faces = casters.seen_by(lamp, everything)
    grids = []
    for lamp_view in LampView.of(lamp):
        s = lamp_view.place(everything)[2]
        s = s[np.isfinite(s)]
        grids.append(LampGrid(lamp_view, casters, faces, float(s.min(initial=np.inf))))
    pairs = receivers.pairs()
    pairs = pairs[~receivers.turned_away(lamp)[pairs.triangle]]
    lit = np.zeros(shape, bool)
    for size in LEVELS:
        if size != pairs.size:
            pairs = pairs.split(size, receivers.low, receivers.high)
        points = receivers.points(pairs)
        maybe = np.zeros(len(pairs.triangle), bool)
        for grid in grids:
            maybe |= grid.may_hide(grid.view.reach(points))
        _mark(lit, pairs[~maybe])
        pairs, points = pairs[maybe], points[maybe]
    # a small triangle is the same receiver in each of its tiles
    key = np.where(receivers.large[pairs.triangle], -1 - np.arange(len(points)), pairs.triangle)
    box, first, which = np.unique(key, return_index=True, return_inverse=True)
    state, owner, face = _candidates(grids, casters, points[first])
    state = state[which]
    order = np.argsort(owner, kind="stable")
    start = np.searchsorted(owner[order], np.arange(len(box) + 1))
    pair, offset = expand(np.diff(start)[which])
    face = face[order][start[which[pair]] + offset]
    tile = pairs.tile[:, 1] * shape[1] + pairs.tile[:, 0]
    _mark(lit, pairs[state == LIT])
    half = np.zeros(shape, bool).reshape(-1)
    half[tile[state == HALF]] = True
    dark = np.zeros(shape, bool).reshape(-1)
    dark[tile[state == DARK]] = True
    half |= dark & lit.reshape(-1)
    dark &= ~half
    mixed = half[tile[pair]]
    keys = np.unique(tile[pair[mixed]] * np.int64(len(casters.corners)) + face[mixed])
    return np.flatnonzero(dark), keys // len(casters.corners), keys % len(casters.corners)


LIT, DARK, HALF = 0, 1, 2


def _candidates(
    grids: list[LampGrid], casters: Casters, points: Array
) -> tuple[npt.NDArray[np.int8], Numbers, Numbers]:
    """State of each receiver box, and pairs (box, face) of those not lit."""
    state = np.full(len(points), LIT, np.int8)
    pairs, faces = [np.zeros(0, np.int64)], [np.zeros(0, np.int64)]
    for grid in grids:
        reach = grid.view.reach(points)
        usable = np.flatnonzero(np.isfinite(reach.s[:, 0]))
        box, caster = grid.candidates(reach[usable])
        box = usable[box]
        face, side = grid.face[caster], grid.side[caster]
        offset = np.sum(casters.corners[face, 0] * casters.normal[face], axis=1)
        slack = 1e-7 * np.linalg.norm(casters.normal[face], axis=1)
        slack *= np.abs(points).max(initial=0.0)
        ahead, behind = np.ones(len(box), bool), np.ones(len(box), bool)
        for k in range(points.shape[1]):
            height = np.sum(points[box, k] * casters.normal[face], axis=1) - offset
            ahead &= height >= -slack
            behind &= height <= slack
        # one side of a plane sees nothing of it hidden; closed bodies hide outwards only
        drop = (ahead & (side == 1)) | (behind & ((side == -1) | ~casters.both_sides[face]))
        box, face, caster = box[~drop], face[~drop], caster[~drop]
        inside, past = grid.meets(reach[box], caster)
        box, face, caster, past = box[inside], face[inside], caster[inside], past[inside]
        sure = (grid.reach.s[caster, 0] > reach.s[box, 1]) & ~past
        half = np.zeros(len(points), bool)
        half[box[~sure]] = True
        hit = np.zeros(len(points), bool)
        ask = np.flatnonzero(~half[box])
        middle = points[box[ask]].mean(axis=1)
        hit[box[ask[_meets(grid.view.lamp, middle, casters.corners[face[ask]])]]] = True
        state = np.maximum(state, np.where(half, HALF, np.where(hit, DARK, LIT)).astype(np.int8))
        pairs.append(box)
        faces.append(face)
    return state, np.concatenate(pairs), np.concatenate(faces)


def _meets(lamp: Lamp, at: Array, corners: Array) -> npt.NDArray[np.bool_]:
    """Whether the way from points (n, 3) to the lamp's centre goes through faces (n, 4, 3)."""
    to = lamp.centre - (0.0 if lamp.far else 1.0) * at
    D = corners - at[:, None]
    planes = np.cross(D, np.roll(D, -1, axis=1))
    sign = np.sign(np.sum(planes.sum(axis=1) * D.mean(axis=1), axis=1))[:, None]
    inside = (sign * np.einsum("nka,na->nk", planes, to) >= 0.0).all(axis=1)
    return np.asarray(inside & (sign[:, 0] != 0.0))


def _mark(grid: npt.NDArray[np.bool_], pairs: _Pairs) -> None:
    """Set the small tiles under tiles of any size."""
    parts = pairs.size // TILE
    small = np.zeros((-(-grid.shape[0] // parts), -(-grid.shape[1] // parts)), bool)
    small[pairs.tile[:, 1], pairs.tile[:, 0]] = True
    grid |= np.kron(small, np.ones((parts, parts), bool))[: grid.shape[0], : grid.shape[1]]


def _relative_to(lamp: Lamp, eye: Array) -> Lamp:
    """The lamp in a frame whose origin is the eye."""
    return lamp if lamp.far else replace(lamp, centre=lamp.centre - eye)
