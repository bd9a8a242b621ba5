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

from gpusim.distinct import distinct
from gpusim.errors import InputError
from gpusim.optics.aside import Aside
from gpusim.optics.casters import Casters
from gpusim.optics.emitters import Lamp
from gpusim.optics.lamp_grid import LampGrid
from gpusim.optics.lamp_view import LampView
from gpusim.optics.occlusion import TOLERANCE, visible_share
from gpusim.optics.ragged import expand
from gpusim.optics.receivers import TILE, Pairs, Receivers
from gpusim.optics.view import View

__all__ = ["MOST_LAMPS", "TILE", "TURNS", "ShadowTiles", "flatness"]

Array = npt.NDArray[np.float64]
Numbers = npt.NDArray[np.int64]
LEVELS = (128, 32, TILE)
MOST_LAMPS = 16
TURNS = 6
"""Turns of the shaders' loops that one face may take."""

ALL = (1 << MOST_LAMPS) - 1


FLATNESS = 1e-3
"""px of the picture by which joining casters' faces may move a shadow."""


COARSER = 10.0
"""Times `FLATNESS`: what is joined where a lamp's penumbra is wide, as far as `SHARE` allows."""

SHARE = 5e-4
"""Of a lamp, by which what is seen of it may change; the lattice's step is four times that."""


def flatness(view: View, lamps: list[Lamp], times: float = 1.0) -> Callable[[Array], Array]:
    """How far joined faces may pass from casters' points (N, 3), as `Casters.of` asks.

    A caster's error is seen at the nearest receiver, as much larger as that is farther from the
    lamp. It stays below what the exact test of a face's plane lets through (`TOLERANCE`), unless
    it is taken several ``times``.
    """
    T = view.camera.camera_from_world
    receivers = ((view.corners[:, :, :3] - T[:3, 3]) @ T[:3, :3]).reshape(-1, 3)
    depth = 1.0 / max(float(view.inverse_depth().max(initial=0.0)), 1e-300)
    share = min(FLATNESS / float(np.abs(np.diag(view.camera.K)[:2]).max()), 0.1 * TOLERANCE)
    share *= times

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
    def build(
        view: View, lamps: list[Lamp], casters: Casters, coarse: Casters | None = None
    ) -> ShadowTiles:
        """Classify every tile of ``view`` for every lamp that casts shadows.

        ``coarse``: the same casters with more of their faces joined, for wide penumbrae.
        """
        if len(lamps) > MOST_LAMPS:
            raise InputError(
                f"render lights; got {len(lamps)} lamps; expected at most {MOST_LAMPS}"
            )
        shape = (-(-view.camera.height // TILE), -(-view.camera.width // TILE))
        lit = np.full(shape, ALL, np.uint32)
        receivers = Receivers(view)
        used = [
            number
            for number, lamp in enumerate(lamps)
            if lamp.light.shadows and view.count and len(casters.corners)
        ]

        def found(number: int) -> tuple[Numbers, Numbers, Numbers]:
            return _half_shadow(receivers, lamps[number], casters, coarse, shape)

        tiles, lamp_of, faces = [], [], []
        with Aside(view.count, len(used)) as aside:
            for number, (dark, tile, face) in zip(used, aside.map(found, used), strict=True):
                lit.reshape(-1)[dark] &= np.uint32(ALL ^ (1 << number))
                tiles.append(tile)
                faces.append(face)
                lamp_of.append(np.full(len(tile), number))
        if coarse is not None:
            casters = casters.beside_others(coarse)
        tile = np.concatenate([np.zeros(0, np.int64), *tiles])
        lamp_number = np.concatenate([np.zeros(0, np.int64), *lamp_of])
        face = np.concatenate([np.zeros(0, np.int64), *faces])
        entries = distinct(tile)
        row = np.searchsorted(entries, tile) * max(len(lamps), 1) + lamp_number
        order = np.argsort(row, kind="stable")
        count = np.bincount(row, minlength=len(entries) * max(len(lamps), 1))
        seen = np.zeros(len(casters.corners), bool)
        seen[face] = True
        shown, face = np.flatnonzero(seen), (np.cumsum(seen) - 1)[face[order]]
        entry = np.zeros(shape, np.uint32)
        entry.reshape(-1)[entries] = np.arange(1, len(entries) + 1)
        return ShadowTiles(
            tuple(_relative_to(lamp, view.camera.eye) for lamp in lamps), lit, entry,
            np.stack([entries // shape[1], entries % shape[1]], axis=1),
            (np.cumsum(count) - count).reshape(len(entries), len(lamps)),
            count.reshape(len(entries), len(lamps)),
            face,
            casters.corners[shown] - view.camera.eye,
            casters.both_sides[shown],
        )  # fmt: skip

    def shares(
        self, x: Array, y: Array, at: Array, normal: Array, across: Array, down: Array
    ) -> Array:
        """What receivers see of each lamp, (n, L), 0 to 1.

        ``x``, ``y`` (n,) px; ``at`` (n, 3) their places relative to the eye, ``normal`` (n, 3)
        unit; ``across``, ``down`` (n, 3) how the places change per column and row.
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
                lamp, at[half], normal[half], across[half], down[half], receiver,
                self.corners[face], self.both_sides[face], tolerance[half],
            )  # fmt: skip
        return result

    @property
    def any(self) -> bool:
        """Whether there is any shadow in the picture."""
        return bool(len(self.place) or (self.lit != ALL).any())


def _half_shadow(
    receivers: Receivers,
    lamp: Lamp,
    casters: Casters,
    coarse: Casters | None,
    shape: tuple[int, int],
) -> tuple[Numbers, Numbers, Numbers]:
    """Tiles (linear) that a lamp doesn't light; pairs (tile, face) of those that it half lights.

    Faces of ``coarse`` are numbered behind those of ``casters``; they serve the receivers that no
    joined face is so near to that its error would be more than `SHARE` of the lamp.
    """
    wide = coarse if coarse is not None and lamp.extended else casters
    grids = _grids(receivers, lamp, wide)
    if not grids:
        none = np.zeros(0, np.int64)
        return none, none, none
    facing = ~receivers.turned_away(lamp)
    lit = np.zeros(shape, bool)
    # a small triangle is the same receiver in each of its tiles
    small = np.flatnonzero(facing & ~receivers.large)
    points = np.take(receivers.columns, small, axis=2)[[0, 1, 2, 2]]
    maybe = _may_hide(grids, points)
    spots = receivers.pairs(small, TILE)
    owner = np.searchsorted(small, spots.triangle)
    _mark(lit, spots[~maybe[owner]])
    spots, owner = spots[maybe[owner]], (np.cumsum(maybe) - 1)[owner[maybe[owner]]]
    boxes = [np.compress(maybe, points, axis=2)]
    pairs = receivers.pairs(np.flatnonzero(facing & receivers.large), LEVELS[0])
    for size in LEVELS:
        if size != pairs.size:
            pairs = receivers.touched(pairs.split(size))
        points = receivers.points(pairs)
        maybe = _may_hide(grids, points)
        _mark(lit, pairs[~maybe])
        pairs, points = pairs[maybe], np.compress(maybe, points, axis=2)
    which = np.concatenate([owner, boxes[0].shape[2] + np.arange(points.shape[2])])
    boxes.append(points)
    pairs = Pairs(
        np.concatenate([spots.triangle, pairs.triangle]),
        np.concatenate([spots.tile, pairs.tile]), TILE,
    )  # fmt: skip
    everything = np.concatenate(boxes, axis=2)
    state, owner, face, near = _candidates(grids, wide, everything)
    if wide is not casters:
        close = np.flatnonzero(near)
        exact = _candidates(
            _grids(receivers, lamp, casters), casters, np.take(everything, close, axis=2)
        )
        state[close] = exact[0]
        far = np.flatnonzero(~near[owner])
        owner = np.concatenate([close[exact[1]], owner[far]])
        face = np.concatenate([exact[2], face[far] + len(casters.corners)])
    order = np.argsort(owner, kind="stable")
    start = np.searchsorted(owner[order], np.arange(len(state) + 1))
    state = state[which]
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
    count = np.int64(len(casters.corners) + (0 if coarse is None else len(coarse.corners)))
    keys = distinct(tile[pair[mixed]] * count + face[mixed])
    return np.flatnonzero(dark), keys // count, keys % count


def _grids(receivers: Receivers, lamp: Lamp, casters: Casters) -> list[LampGrid]:
    """The casters as seen from a lamp, for each half space before it; none where nothing hides."""
    faces = casters.seen_by(lamp, receivers.corners.reshape(-1, 3))
    if not len(faces.face):
        return []
    grids = []
    for lamp_view in LampView.of(lamp):
        s = lamp_view.place(*np.moveaxis(receivers.columns, 1, 0))[2]
        s = s[np.isfinite(s)]
        grids.append(LampGrid(lamp_view, casters, faces, float(s.min(initial=np.inf))))
    return grids


LIT, DARK, HALF = 0, 1, 2


def _may_hide(grids: list[LampGrid], points: Array) -> npt.NDArray[np.bool_]:
    """(n,) whether something may lie between the lamp and points (4, 3, n)."""
    result = np.zeros(points.shape[2], bool)
    for grid in grids:
        result |= grid.may_hide(grid.view.reach(points))
    return result


def _candidates(
    grids: list[LampGrid], casters: Casters, points: Array
) -> tuple[npt.NDArray[np.int8], Numbers, Numbers, npt.NDArray[np.bool_]]:
    """State of each receiver box (4, 3, n), pairs (box, face) of those not lit, and whether it is
    too near to a joined face."""
    count = points.shape[2]
    state = np.full(count, LIT, np.int8)
    near = np.zeros(count, bool)
    pairs, faces = [np.zeros(0, np.int64)], [np.zeros(0, np.int64)]
    for grid in grids:
        reach = grid.view.reach(points)
        usable = np.flatnonzero(np.isfinite(reach.s[0]))
        if len(usable) == count:
            box, caster = grid.candidates(reach)
        else:
            box, caster = grid.candidates(reach[usable])
            box = usable[box]
        near[box[grid.moves(reach, box, caster, casters.sag) > SHARE]] = True
        face, side = grid.face[caster], grid.side[caster]
        behind, ahead = _sides_of(casters, face, points, box)
        # one side of a plane sees nothing of it hidden; closed bodies hide outwards only
        closed = ~casters.both_sides[face]
        # what is turned to the lamp in the plane of a face that is turned away lies against it
        against = ahead & behind & closed & (side == -1)
        drop = (ahead & (side == 1)) | (behind & ~against & ((side == -1) | closed))
        kept = np.flatnonzero(~drop)
        box, face, caster, against = box[kept], face[kept], caster[kept], against[kept]
        inside, past = grid.meets(reach[box], caster)
        kept = np.flatnonzero(inside)
        box, face, caster, past = box[kept], face[kept], caster[kept], past[kept]
        against = against[kept]
        sure = (against | (grid.reach.s[0][caster] > reach.s[1][box])) & ~past
        half = np.zeros(count, bool)
        half[box[~sure]] = True
        hit = np.zeros(count, bool)
        ask = np.flatnonzero(~half[box])
        middle = points[:, :, box[ask]].mean(axis=0).T
        corners = casters.corners[face[ask]]
        hit[box[ask[_meets(grid.view.lamp, middle, corners, against[ask])]]] = True
        # inside of an outline, yet no face in the way: a ray between faces that were joined, which
        # needn't meet corner by corner; pixel by pixel it is one sample
        half[box[~hit[box]]] = True
        state = np.maximum(state, np.where(half, HALF, np.where(hit, DARK, LIT)).astype(np.int8))
        pairs.append(box)
        faces.append(face)
    return state, np.concatenate(pairs), np.concatenate(faces), near


def _sides_of(
    casters: Casters, face: Numbers, points: Array, box: Numbers
) -> tuple[npt.NDArray[np.bool_], npt.NDArray[np.bool_]]:
    """Whether boxes of points lie behind the planes of faces, or before them, pair by pair."""
    normal = [np.ascontiguousarray(casters.normal[:, axis]) for axis in range(3)]
    offset = np.sum(casters.corners[:, 0] * casters.normal, axis=1)[face]
    slack = (1e-7 * np.abs(points).max(initial=0.0)) * np.linalg.norm(casters.normal, axis=1)[face]
    own = [n[face] for n in normal]
    low, high = np.full(len(face), np.inf), np.full(len(face), -np.inf)
    for corner in points:
        height = -offset
        for axis in range(3):
            height += own[axis] * corner[axis][box]
        np.minimum(low, height, out=low)
        np.maximum(high, height, out=high)
    return high <= slack, low >= -slack


def _meets(
    lamp: Lamp, at: Array, corners: Array, against: npt.NDArray[np.bool_]
) -> npt.NDArray[np.bool_]:
    """Whether the way from points (n, 3) to the lamp's centre goes through faces (n, 4, 3).

    ``against`` (n,): the point lies in the face's plane, and counts as before it.
    """
    to = lamp.centre - (0.0 if lamp.far else 1.0) * at
    D = corners - at[:, None]
    planes = np.cross(D, np.roll(D, -1, axis=1))
    sign = np.sign(np.sum(planes.sum(axis=1) * D.mean(axis=1), axis=1))[:, None]
    sign[against] = -1.0
    inside = (sign * np.einsum("nka,na->nk", planes, to) >= 0.0).all(axis=1)
    return np.asarray(inside & (sign[:, 0] != 0.0))


def _mark(grid: npt.NDArray[np.bool_], pairs: Pairs) -> None:
    """Set the small tiles under tiles of any size."""
    parts = pairs.size // TILE
    small = np.zeros((-(-grid.shape[0] // parts), -(-grid.shape[1] // parts)), bool)
    small[pairs.tile[:, 1], pairs.tile[:, 0]] = True
    grid |= np.kron(small, np.ones((parts, parts), bool))[: grid.shape[0], : grid.shape[1]]


def _relative_to(lamp: Lamp, eye: Array) -> Lamp:
    """The lamp in a frame whose origin is the eye."""
    return lamp if lamp.far else replace(lamp, centre=lamp.centre - eye)
