"""Tiles of a picture in a lamp's shadow: in full, or in half with the faces in the way."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from gpusim.optics.caster_sets import CasterSet, CasterSets
from gpusim.optics.casters import Casters
from gpusim.optics.corners import parts
from gpusim.optics.lamp_apart import apart
from gpusim.optics.lamp_edges import EVERY_EDGE
from gpusim.optics.lamp_grid import LampGrid
from gpusim.optics.lamp_merging import FEWEST, joined_grids
from gpusim.optics.patches import Small
from gpusim.optics.ragged import expand
from gpusim.optics.receiver_planes import lies_low, meets_middle, sides_of_planes
from gpusim.optics.receivers import Receivers
from gpusim.optics.tile_pairs import LEVELS, NONE, TILE, Pairs, counted, meets, spread_over

__all__ = ["HalfShadow", "half_shadow"]

Array = npt.NDArray[np.float64]
Numbers = npt.NDArray[np.int64]
Bits = npt.NDArray[np.uint8]
Flags = npt.NDArray[np.bool_]
States = npt.NDArray[np.int8]
Level = tuple[Casters, list[LampGrid]]
LIT, DARK, HALF = 0, 1, 2
BESIDE = 16.0
"""Times a receiver's own, difference in s to faces of its surface that may lie beside it."""

RISES = 0.15, 0.6
"""Of the median difference in s between receivers and the highest casters: for those less far below
joined ones, these aren't exact enough."""


@dataclass(frozen=True, eq=False)
class HalfShadow:
    """``dark``: tiles (linear) that the lamp doesn't light.

    ``tile``, ``face`` (n,): pairs of those that it half lights and of ``corners`` (F, 4, 3) world,
    ``both_sides`` (F,); ``edges`` (n,) those of the face that count there: see `ShadowTiles`.
    """

    dark: Numbers
    tile: Numbers
    face: Numbers
    edges: Bits
    corners: Array
    both_sides: npt.NDArray[np.bool_]

    @staticmethod
    def joined(parts: Sequence[HalfShadow]) -> HalfShadow:
        """Those of different tiles in one, in order."""
        before = np.cumsum([0, *(len(part.corners) for part in parts)])
        face = [part.face + first for part, first in zip(parts, before[:-1], strict=True)]
        return HalfShadow(
            np.concatenate([part.dark for part in parts]),
            np.concatenate([part.tile for part in parts]), np.concatenate(face),
            np.concatenate([part.edges for part in parts]),
            np.concatenate([part.corners for part in parts]),
            np.concatenate([part.both_sides for part in parts]),
        )  # fmt: skip

    def without(self, tiles: Flags) -> HalfShadow:
        """What there is before other tiles than some (linear)."""
        kept = np.flatnonzero(~tiles[self.tile])
        if len(kept) == len(self.tile):
            return self
        return replace(self, tile=self.tile[kept], face=self.face[kept], edges=self.edges[kept])

    @staticmethod
    def none() -> HalfShadow:
        """No shadow at all."""
        number = np.zeros(0, np.int64)
        return HalfShadow(
            number, number, number, np.zeros(0, np.uint8), np.zeros((0, 4, 3)), np.zeros(0, bool)
        )


def half_shadow(
    receivers: Receivers, small: Small, sets: CasterSets, within: Flags, among: Flags | None = None
) -> HalfShadow:
    """What casters hide of a lamp in the tiles of a picture that are ``within`` (rows, columns);
    ``small``: of the receivers. Where ``among`` (T,) is given only these are looked at, and others
    taken to be lit."""
    shape, everywhere = within.shape, bool(within.all())
    if sets.empty:
        return HalfShadow.none()
    casters, free = sets.casters, sets.free
    facing = ~receivers.turned_away(sets.lamp)
    if among is not None:
        facing &= among
    own_tiles = np.zeros(shape, bool)
    own_tiles[tuple(receivers.spots.tile[free[receivers.spots.triangle]].T[::-1])] = True
    kept = small.some(facing)[small.which]
    if not everywhere:
        kept &= meets(small.pairs, within)
    spots, whole = _before(receivers, small, sets, facing, np.flatnonzero(kept))
    # a small triangle is the same receiver in each of its tiles
    some = np.zeros(len(facing), bool)
    some[spots.triangle] = True
    owner = (np.cumsum(some) - 1)[spots.triangle]
    triangle = np.flatnonzero(some)
    points = np.take(receivers.columns, triangle, axis=2)[[0, 1, 2, 2]]
    maybe = sets.may_hide(points, sets.number(triangle))
    whole = whole.joined(spots[~maybe[owner]])
    spots, owner = spots[maybe[owner]], (np.cumsum(maybe) - 1)[owner[maybe[owner]]]
    boxes, triangle = [np.compress(maybe, points, axis=2)], triangle[maybe]
    pairs = receivers.pairs(np.flatnonzero(facing & receivers.large), LEVELS[0])
    own_tiles |= spread_over(pairs[free[pairs.triangle]], shape)
    cleared: list[Pairs] = []  # receivers that nothing is before
    for size in LEVELS:
        if size != pairs.size:
            pairs = receivers.touched(pairs.split(size))
        if not everywhere:
            pairs = pairs[meets(pairs, within)]
        points = receivers.points(pairs)
        if size == TILE:
            seen = receivers.seen(pairs, points)
            pairs, points = pairs[seen], np.compress(seen, points, axis=2)
        maybe = sets.may_hide(points, sets.number(pairs.triangle))
        cleared.append(pairs[~maybe])
        pairs, points = pairs[maybe], np.compress(maybe, points, axis=2)
    which = np.concatenate([owner, boxes[0].shape[2] + np.arange(points.shape[2])])
    boxes.append(points)
    # only small triangles are told from the faces beside them: there are few beside large ones
    body = np.full(len(triangle) + len(pairs.triangle), -1)
    body[: len(triangle)] = receivers.view.body[triangle]
    triangle = np.concatenate([triangle, pairs.triangle])
    pairs = spots.joined(pairs)
    everything = np.concatenate(boxes, axis=2)
    tile = pairs.tile[:, 1] * shape[1] + pairs.tile[:, 0]
    asked = np.zeros(shape, bool)
    asked.reshape(-1)[tile] = True
    clear = counted(whole, shape, _clear(receivers, cleared, asked))
    hidden, free = sets.plain(everything, triangle)
    clear = counted(pairs[free[which]], shape, clear)
    deep = np.zeros(shape[0] * shape[1], bool)
    if among is None:
        # tiles with nothing but receivers that see nothing of the lamp needn't be told more about
        deep[tile] = True
        deep &= clear.reshape(-1) == 0
        deep[tile[~hidden[which]]] = False
    left = np.flatnonzero(~(deep[tile] | free[which]))
    pairs, tile, which = pairs[left], tile[left], which[left]
    some = np.zeros(len(triangle), bool)
    some[which] = True
    which = (np.cumsum(some) - 1)[which]
    everything = np.compress(some, everything, axis=2)
    triangle, body = triangle[some], body[some]
    beside = _Beside(len(triangle), tile, which, own_tiles.reshape(-1))
    state, owner, face, edges, levels = _found_by(
        sets, casters, everything, triangle, body, beside, receivers.view.camera.eye
    )
    order = np.argsort(owner, kind="stable")
    start = np.searchsorted(owner[order], np.arange(len(state) + 1))
    state = state[which]
    pair, offset = expand(np.diff(start)[which])
    listed = order[start[which[pair]] + offset]
    lit = counted(pairs[state == LIT], shape, clear).reshape(-1) > 0
    half = np.zeros(shape, bool).reshape(-1)
    half[tile[state == HALF]] = True
    dark = np.zeros(shape, bool).reshape(-1)
    dark[tile[state == DARK]] = True
    dark |= deep
    half |= dark & (lit | (among is not None))
    dark &= ~half
    mixed = half[tile[pair]]
    pair, listed = pair[mixed], listed[mixed]
    corners = np.concatenate([used.corners for used, _ in levels])
    both_sides = np.concatenate([used.both_sides for used, _ in levels])
    count = len(corners)
    # receivers of one tile share its list: 4 bits of each key tell the edges
    keys = np.sort((tile[pair] * count + face[listed]) << 4 | edges[listed])
    first = np.flatnonzero(np.diff(keys >> 4, prepend=-1))
    place, face = np.divmod(keys[first] >> 4, count)
    bits = np.bitwise_or.reduceat(keys, first) & EVERY_EDGE if len(first) else keys
    # other receivers of the tile may look past any edge
    every = counted(pairs, shape, clear).reshape(-1)
    fewer = np.diff(first, append=len(keys)) < every[place]
    bits[fewer | (among is not None)] = EVERY_EDGE
    shown = np.zeros(count, bool)
    shown[face] = True
    return HalfShadow(
        np.flatnonzero(dark), place, (np.cumsum(shown) - 1)[face], bits.astype(np.uint8),
        corners[shown], both_sides[shown],
    )  # fmt: skip


def _before(
    receivers: Receivers, small: Small, sets: CasterSets, facing: Flags, rows: Numbers
) -> tuple[Pairs, Pairs]:
    """Single triangles that are ``facing`` (T,) the lamp, of ``rows`` (n,) of small receivers in
    tiles, before which something may be; and of patches before which nothing is, one each."""
    if small.single:
        pairs = small.pairs[rows]
        return pairs[facing[pairs.triangle]], pairs[:0]
    used = np.zeros(len(small.triangle), bool)
    used[small.which[rows]] = True
    asked = np.flatnonzero(used)
    number = sets.number(small.triangle, small.every(sets.free))
    maybe = np.zeros(len(used), bool)
    maybe[asked] = sets.may_hide(np.take(small.points, asked, axis=2), number[asked])
    left = maybe[small.which[rows]]
    pairs = small.parts(rows[left])
    return pairs[facing[pairs.triangle]], small.pairs[rows[~left]]


def _clear(receivers: Receivers, cleared: list[Pairs], asked: Flags) -> Numbers:
    """How many of the large receivers ``cleared``, one list for each size of tiles, are seen in
    each of the tiles ``asked`` (rows, columns)."""
    pairs = cleared[0][np.zeros(0, np.int64)]
    for more in cleared:
        if more.size != pairs.size:
            pairs = receivers.touched(pairs.split(more.size))
        pairs = pairs.joined(more)
        pairs = pairs[meets(pairs, asked)]
    return counted(pairs[receivers.seen(pairs, receivers.points(pairs))], asked.shape, NONE)


def _levels(used: CasterSet, casters: Casters, points: Array) -> list[Level]:
    """The casters as they are, and joined as far as most receivers' boxes (4, 3, n) allow."""
    faces, grids = used
    result: list[Level] = [(casters, grids)]
    if grids[0].view.lamp.extended and len(faces.face) >= FEWEST and points.shape[2]:
        (grid,) = grids
        reach = grid.view.reach(points)
        top = grid.top(reach)
        known = np.flatnonzero(np.isfinite(top) & np.isfinite(reach.s[1]))
        if not len(known):
            return result
        above = top[known] - reach.s[1][known]
        rises = [share * float(np.median(above)) for share in RISES]
        result += [(own, [one]) for own, one in joined_grids(grid, casters, faces, rises)]
    return result


@dataclass(frozen=True, eq=False)
class _Beside:
    """Which of ``count`` receivers share tiles: ``tile`` and ``which`` (n,): pairs of tiles and
    receivers; ``own`` (tiles,): those with receivers besides that nothing of their surface is
    before."""

    count: int
    tile: Numbers
    which: Numbers
    own: Flags

    def too_near(self, rows: Numbers, near: Flags) -> Flags:
        """Which receivers ``rows`` (n,) have one beside them in some tile that faces are too
        ``near`` to (n,), or that has been left out: one tile has one list of faces."""
        flags = np.zeros(self.count, bool)
        flags[rows[near]] = True
        tiles = self.own.copy()
        tiles[self.tile[flags[self.which]]] = True
        flags[self.which[tiles[self.tile]]] = True
        return flags[rows]


def _found_by(
    sets: CasterSets,
    casters: Casters,
    points: Array,
    triangle: Numbers,
    body: Numbers,
    beside: _Beside,
    eye: Array,
) -> tuple[States, Numbers, Numbers, Bits, list[Level]]:
    """As `_found`, of receivers on triangles (n,), each by what may hide the lamp there; and the
    levels, as faces are numbered in them."""
    state = np.full(len(triangle), LIT, np.int8)
    levels: list[Level] = []
    found: list[tuple[Numbers, Numbers, Bits]] = []
    for rows, own in sets.each(sets.number(triangle)):
        some, bodies, own_rows = points, body, np.arange(len(triangle))
        if rows is not None:
            some, bodies, own_rows = np.take(points, rows, axis=2), body[rows], rows
        before = sum(len(used.corners) for used, _ in levels)
        own_levels = _levels(own, casters, some)
        own_state, box, face, edges = _found(own_levels, some, bodies, beside, own_rows, eye)
        state[slice(None) if rows is None else rows] = own_state
        found.append((box if rows is None else rows[box], before + face, edges))
        levels += reversed(own_levels)
    owner, face, edges = (np.concatenate([each[k] for each in found]) for k in range(3))
    return state, owner, face, edges, levels


def _found(
    levels: list[Level], points: Array, body: Numbers, beside: _Beside, rows: Numbers, eye: Array
) -> tuple[States, Numbers, Numbers, Bits]:
    """State of each receiver box (4, 3, n) of surfaces ``body`` (n,), -1 for large ones, that are
    ``rows`` (n,) of those ``beside`` each other; pairs (box, face) of those not lit with the edges
    that count; each by the most joined casters that none of is too near to it, or to one beside it,
    numbered from the last level to the first."""
    state = np.full(points.shape[2], LIT, np.int8)
    boxes, faces = [np.zeros(0, np.int64)], [np.zeros(0, np.int64)]
    edges = [np.zeros(0, np.uint8)]
    left, before = np.arange(len(state)), 0
    for casters, grids in reversed(levels):
        own = points if len(left) == len(state) else np.take(points, left, axis=2)
        state[left], box, face, bits, near = _candidates(grids, casters, own, body[left], eye)
        if casters is not levels[0][0]:
            near = beside.too_near(rows[left], near)
            kept = np.flatnonzero(~near[box])
            box, face, bits = box[kept], face[kept], bits[kept]
        boxes.append(left[box])
        faces.append(before + face)
        edges.append(bits)
        before += len(casters.corners)
        left = left[near]
        if not len(left):
            break
    return state, np.concatenate(boxes), np.concatenate(faces), np.concatenate(edges)


def _candidates(
    grids: list[LampGrid], casters: Casters, points: Array, body: Numbers, eye: Array
) -> tuple[States, Numbers, Numbers, Bits, npt.NDArray[np.bool_]]:
    """As `_found`, of one level; and whether a box is too near to a joined face, which has no
    pairs then."""
    count = points.shape[2]
    state = np.full(count, LIT, np.int8)
    near = np.zeros(count, bool)
    pairs, faces = [np.zeros(0, np.int64)], [np.zeros(0, np.int64)]
    edges = [np.zeros(0, np.uint8)]
    for grid in grids:
        reach = grid.view.reach(points)
        usable = np.flatnonzero(np.isfinite(reach.s[0]))
        if len(usable) == count:
            box, caster = grid.candidates(reach)
        else:
            box, caster = grid.candidates(reach[usable])
            box = usable[box]
        close = grid.near(reach, box, caster)
        if len(close):
            near[close] = True
            kept = np.flatnonzero(~near[box])
            box, caster = box[kept], caster[kept]
        face, side = grid.face[caster], grid.side[caster]
        behind, ahead = sides_of_planes(casters, face, points, box)
        # one side of a plane sees nothing of it hidden; closed bodies hide outwards only
        closed = ~casters.both_sides[face]
        # what is turned to the lamp in the plane of a face that is turned away lies against it
        against = ahead & behind & closed & (side == -1)
        drop = (ahead & (side == 1)) | (behind & ~against & ((side == -1) | closed))
        kept = np.flatnonzero(~drop)
        box, face, caster, against = box[kept], face[kept], caster[kept], against[kept]
        low = lies_low(grid.view.lamp, casters, face, points, box, body, eye)
        kept = np.flatnonzero(against | ~low)
        box, face, caster, against = box[kept], face[kept], caster[kept], against[kept]
        inside, past = np.empty(len(box), bool), np.empty(len(box), bool)
        for part in parts(len(box)):
            inside[part], past[part] = grid.meets(reach[box[part]], caster[part])
        beside = inside & (body[box] == casters.body[face])
        if grid.view.lamp.extended:
            # far above, hardly any lies beside the receiver as all of the lamp sees it
            rise = grid.reach.s[0][caster] - reach.s[1][box]
            with np.errstate(invalid="ignore"):  # all of a receiver behind the lamp
                beside &= rise <= BESIDE * (reach.s[1] - reach.s[0])[box]
        same = np.flatnonzero(beside)
        if len(same):
            places = grid.view.place(*np.moveaxis(points, 1, 0))
            inside[same[apart(grid.view.half, places, box[same], grid.places, caster[same])]] = (
                False
            )
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
        hit[box[ask[meets_middle(grid.view.lamp, middle, corners, against[ask])]]] = True
        # inside of an outline, yet no face in the way: a ray between faces that were joined, which
        # needn't meet corner by corner; pixel by pixel it is one sample
        half[box[~hit[box]]] = True
        state = np.maximum(state, np.where(half, HALF, np.where(hit, DARK, LIT)).astype(np.int8))
        pairs.append(box)
        faces.append(face)
        edges.append(grid.edges.needed(reach, box, caster))
    return state, np.concatenate(pairs), np.concatenate(faces), np.concatenate(edges), near
