"""Tiles of a picture in a lamp's shadow: in full, or in half with the faces in the way."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from gpusim.optics.caster_sets import CasterSets
from gpusim.optics.faces_before import DARK, HALF, LIT, Beside, Level, any_before, found_by
from gpusim.optics.lamp_edges import EVERY_EDGE
from gpusim.optics.patches import Small
from gpusim.optics.ragged import expand
from gpusim.optics.receivers import Receivers
from gpusim.optics.tile_contours import (
    FEWEST,
    MANY,
    Boxes,
    Listed,
    contours,
    one_way_round,
    sides_of,
)
from gpusim.optics.tile_edges import TileEdges
from gpusim.optics.tile_pairs import LEVELS, NONE, TILE, Pairs, counted, meets, spread_over

__all__ = ["HalfShadow", "half_shadow"]

SAMPLE = 1000
"""Receivers, about, that tell whether it is worth while to ask all."""

Array = npt.NDArray[np.float64]
Numbers = npt.NDArray[np.int64]
Bits = npt.NDArray[np.uint8]
Flags = npt.NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class HalfShadow:
    """``dark``: tiles (linear) that the lamp doesn't light.

    ``tile``, ``face`` (n,): pairs of those that it half lights and of ``corners`` (F, 4, 3) world,
    ``both_sides`` (F,); ``edges`` (n,) those of the face that count there: see `ShadowTiles`.
    ``contours``: edges in place of other faces.
    """

    dark: Numbers
    tile: Numbers
    face: Numbers
    edges: Bits
    corners: Array
    both_sides: Flags
    contours: TileEdges

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
            TileEdges.joined([part.contours for part in parts]),
        )  # fmt: skip

    def without(self, tiles: Flags) -> HalfShadow:
        """What there is before other tiles than some (linear)."""
        kept = np.flatnonzero(~tiles[self.tile])
        contours = self.contours[np.flatnonzero(~tiles[self.contours.tile])]
        return replace(
            self, tile=self.tile[kept], face=self.face[kept], edges=self.edges[kept],
            contours=contours,
        )  # fmt: skip

    @staticmethod
    def none() -> HalfShadow:
        """No shadow at all."""
        number = np.zeros(0, np.int64)
        return HalfShadow(
            number, number, number, np.zeros(0, np.uint8), np.zeros((0, 4, 3)), np.zeros(0, bool),
            TileEdges.none(),
        )  # fmt: skip


def half_shadow(
    receivers: Receivers, small: Small, sets: CasterSets, within: Flags, among: Flags | None = None
) -> HalfShadow:
    """What casters hide of a lamp in the tiles of a picture that are ``within`` (rows, columns);
    ``small``: of the receivers. Where ``among`` (T,) is given only these are looked at, and others
    taken to be lit."""
    shape, everywhere = within.shape, bool(within.all())
    if sets.empty:
        return HalfShadow.none()
    casters, apart = sets.casters, sets.apart
    facing = ~receivers.turned_away(sets.lamp)
    if among is not None:
        facing &= among
    own_tiles = np.zeros(shape, bool)
    own_tiles[tuple(receivers.spots.tile[apart[receivers.spots.triangle]].T[::-1])] = True
    kept = small.some(facing)[small.which]
    if not everywhere:
        kept &= meets(small.pairs, within)
    spots, whole, under = _before(receivers, small, sets, facing, np.flatnonzero(kept))
    # joined casters may be too near to these
    own_tiles |= spread_over(under, shape)
    whole = whole.joined(under)
    # a small triangle is the same receiver in each of its tiles
    some = np.zeros(len(facing), bool)
    some[spots.triangle] = True
    owner = (np.cumsum(some) - 1)[spots.triangle]
    triangle = np.flatnonzero(some)
    points = np.take(receivers.columns, triangle, axis=2)[[0, 1, 2, 2]]
    maybe = _may_hide(sets, points, sets.number(triangle))
    whole = whole.joined(spots[~maybe[owner]])
    spots, owner = spots[maybe[owner]], (np.cumsum(maybe) - 1)[owner[maybe[owner]]]
    boxes, triangle = [np.compress(maybe, points, axis=2)], triangle[maybe]
    pairs = receivers.pairs(np.flatnonzero(facing & receivers.large), LEVELS[0])
    own_tiles |= spread_over(pairs[apart[pairs.triangle]], shape)
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
    beside = Beside(len(triangle), tile, which, own_tiles.reshape(-1))
    state, owner, face, edges, levels = found_by(
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
    rows = np.flatnonzero(state != LIT)
    sides = bits.astype(np.uint8)
    stays, told = _contours(
        receivers, sets, levels, (corners, both_sides), (place, face, sides), everything,
        (tile[rows], which[rows]), shape,
    )  # fmt: skip
    place, face = place[stays], face[stays]
    shown = np.zeros(count, bool)
    shown[face] = True
    return HalfShadow(
        np.flatnonzero(dark), place, (np.cumsum(shown) - 1)[face], sides[stays], corners[shown],
        both_sides[shown], told,
    )  # fmt: skip


def _contours(
    receivers: Receivers,
    sets: CasterSets,
    levels: list[Level],
    shapes: tuple[Array, Flags],
    pairs: tuple[Numbers, Numbers, Bits],
    boxes: Array,
    hidden: tuple[Numbers, Numbers],
    shape: tuple[int, int],
) -> tuple[Flags, TileEdges]:
    """Which ``pairs`` of tiles, faces of ``levels`` and edges of these stay as they are, and the
    edges of contours in place of the others. ``shapes``: the faces' corners (F, 4, 3), and whether
    both their sides hide (F,). ``hidden``: tiles and the receivers there, as numbers
    of ``boxes`` (4, 3, n), that something may be before."""
    (tile, face, edges), tiles = pairs, shape[0] * shape[1]
    stays = np.ones(len(tile), bool)
    many = np.bincount(tile, minlength=tiles) >= FEWEST
    some = np.flatnonzero(many[tile])
    count = np.bitwise_count(edges[some]).astype(np.int64)
    # lamps without a size have few faces before a tile, and two views
    if not sets.lamp.extended or not count.sum() >= max(MANY, 1):
        return stays, TileEdges.none()
    view = levels[0][1][0].view
    number = [len(own.faces) for own, _ in levels]
    side, lowest = np.zeros(sum(number), np.int64), np.full(sum(number), -np.inf)
    used = np.zeros(sum(number), bool)
    used[face[some]] = True
    for begin, (_, (grid,)) in zip(np.cumsum([0, *number]), levels, strict=False):
        own = np.flatnonzero(used[begin + grid.face])
        name, reach = begin + grid.face[own], grid.reach[own]
        # none of a face that reaches behind the lamp is told by its edges
        told = np.isfinite(reach.p).all(axis=0) & np.isfinite(reach.q).all(axis=0)
        p, q, s = (np.take(v, own, axis=0) for v in grid.places)
        told &= one_way_round((p, q, s), view.half)
        side[name], lowest[name] = grid.side[own], np.where(told, reach.s[0], -np.inf)
    casters, (corners, both_sides) = [own for own, _ in levels], shapes
    listed = Listed(
        tile[some], face[some], count, casters[0].points,
        sides_of(casters, face[some]), corners.min(axis=1).T, corners.max(axis=1).T,
        np.concatenate([own.body for own in casters]), both_sides, side, lowest,
    )  # fmt: skip
    highest = np.full(tiles, -np.inf)
    np.maximum.at(highest, hidden[0], view.reach(boxes).s[1][hidden[1]])
    seen = receivers.in_tiles(many.reshape(shape), ~receivers.turned_away(sets.lamp))
    points = receivers.points(seen)
    low, high = receivers.low[seen.triangle].T, receivers.high[seen.triangle].T
    around = Boxes(
        seen.tile[:, 1] * shape[1] + seen.tile[:, 0], receivers.view.body[seen.triangle],
        np.stack([low, high]), points, view.reach(points),
    )  # fmt: skip
    stays[some], result = contours(view, listed, around, highest)
    return stays, result


def _before(
    receivers: Receivers, small: Small, sets: CasterSets, facing: Flags, rows: Numbers
) -> tuple[Pairs, Pairs, Pairs]:
    """Single triangles that are ``facing`` (T,) the lamp, of ``rows`` (n,) of small receivers in
    tiles, before which something may be; and of patches, one each: those that nothing is over as
    the lamp sees it, and those that it is over but hides nothing of the lamp from."""
    if small.single:
        pairs = small.pairs[rows]
        return pairs[facing[pairs.triangle]], pairs[:0], pairs[:0]
    used = np.zeros(len(small.triangle), bool)
    used[small.which[rows]] = True
    asked = np.flatnonzero(used)
    number = sets.number(small.triangle, small.every(sets.apart))
    over = np.zeros(len(used), bool)
    over[asked] = sets.may_hide(np.take(small.points, asked, axis=2), number[asked])
    before = over.copy()
    patch = np.flatnonzero(over[small.alone :])
    asked = small.alone + patch
    before[asked] = any_before(
        sets, number[asked], np.take(small.points, asked, axis=2), small.planes[patch],
        receivers.view.body[small.triangle[asked]].astype(np.int64), receivers.view.camera.eye,
    )  # fmt: skip
    over, before = over[small.which[rows]], before[small.which[rows]]
    pairs = small.parts(rows[before])
    clear, under = small.pairs[rows[~over]], small.pairs[rows[over & ~before]]
    return pairs[facing[pairs.triangle]], clear, under


def _may_hide(sets: CasterSets, points: Array, number: Numbers) -> Flags:
    """`CasterSets.may_hide` of many receivers, not looked for where it would tell nothing: on open
    sheets something lies beside each."""
    step = max(points.shape[2] // SAMPLE, 1)
    if step > 1 and sets.may_hide(points[:, :, ::step], number[::step]).all():
        return np.ones(points.shape[2], bool)
    return sets.may_hide(points, number)


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
