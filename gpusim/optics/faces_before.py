"""Faces before receivers of light, pair by pair, and what these see of a lamp: all, none or half.

Receivers are boxes around single triangles, around what is seen of a large one in a tile, or
around patches, of which only is asked whether anything is before them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from gpusim.optics.caster_sets import CasterSet, CasterSets
from gpusim.optics.casters import Casters
from gpusim.optics.corners import parts
from gpusim.optics.lamp_apart import apart
from gpusim.optics.lamp_grid import LampGrid
from gpusim.optics.lamp_merging import FEWEST, joined_grids
from gpusim.optics.lamp_view import Reach
from gpusim.optics.receiver_planes import Planes, lies_low, meets_middle, sides_of_planes

__all__ = ["DARK", "HALF", "LIT", "Beside", "Level", "any_before", "found_by"]

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
"""Of the difference in s between receivers and the highest casters, the median of where these look:
for those less far below joined ones, these aren't exact enough."""

WORTH, EACH = 30, 100
"""Entries of cells that receivers look at, for each caster and for each of them, which are worth
joined ones."""


def _levels(used: CasterSet, casters: Casters, points: Array) -> list[Level]:
    """The casters as they are, and joined as far as most receivers' boxes (4, 3, n) allow."""
    faces, grids = used
    result: list[Level] = [(casters, grids)]
    if grids[0].view.lamp.extended and len(faces.face) >= FEWEST and points.shape[2]:
        (grid,) = grids
        reach = grid.view.reach(points)
        top = grid.top(reach)
        if grid.asked(reach, top) < max(WORTH * len(faces.face), EACH * points.shape[2]):
            return result
        known = np.flatnonzero(np.isfinite(top) & np.isfinite(reach.s[1]))
        if not len(known):
            return result
        above = np.maximum(top[known] - reach.s[1][known], 0.0)
        # what lies on a body itself is near to all of it, and looks at few faces each
        order = np.argsort(above)
        looked = np.cumsum(above[order] ** 2)
        middle = float(above[order[np.searchsorted(looked, 0.5 * looked[-1])]])
        rises = [share * middle for share in RISES]
        result += [(own, [one]) for own, one in joined_grids(grid, casters, faces, rises)]
    return result


@dataclass(frozen=True, eq=False)
class Beside:
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


def found_by(
    sets: CasterSets,
    casters: Casters,
    points: Array,
    triangle: Numbers,
    body: Numbers,
    beside: Beside,
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
    levels: list[Level], points: Array, body: Numbers, beside: Beside, rows: Numbers, eye: Array
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
) -> tuple[States, Numbers, Numbers, Bits, Flags]:
    """As `_found`, of one level; and whether a box is too near to a joined face, which has no
    pairs then."""
    count = points.shape[2]
    state = np.full(count, LIT, np.int8)
    near = np.zeros(count, bool)
    pairs, faces = [np.zeros(0, np.int64)], [np.zeros(0, np.int64)]
    edges = [np.zeros(0, np.uint8)]
    planes = Planes.of(points)
    for grid in grids:
        reach = grid.view.reach(points)
        box, caster = _seen_before(grid, reach)
        close = grid.near(reach, box, caster)
        if len(close):
            near[close] = True
            kept = np.flatnonzero(~near[box])
            box, caster = box[kept], caster[kept]
        box, caster, against = _past_planes(grid, casters, box, caster, points, planes, body, eye)
        inside, past = _meets(grid, reach, box, caster)
        beside = inside & (body[box] == casters.body[grid.face[caster]])
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
        box, caster, against, past = box[kept], caster[kept], against[kept], past[kept]
        face = grid.face[caster]
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


def any_before(
    sets: CasterSets, number: Numbers, points: Array, planes: Planes, body: Numbers, eye: Array
) -> Flags:
    """(n,) whether some face of such a set (n,) may be before what lies in boxes of points
    (k, 3, n), with ``planes``, of closed surfaces ``body`` (n,): what `found_by` isn't sure to call
    lit."""
    result = np.zeros(points.shape[2], bool)
    for rows, (_, grids) in sets.each(number):
        if rows is None:
            rows = np.arange(len(result))
        own = np.take(points, rows, axis=2)
        for grid in grids:
            reach = grid.view.reach(own)
            box, caster = _seen_before(grid, reach)
            box, caster, _ = _past_planes(
                grid, sets.casters, box, caster, own, planes[rows], body[rows], eye
            )
            result[rows[box[_meets(grid, reach, box, caster)[0]]]] = True
    return result


def _seen_before(grid: LampGrid, reach: Reach) -> tuple[Numbers, Numbers]:
    """Pairs of boxes and casters that may be before them, as the lamp sees the boxes around
    both."""
    usable = np.flatnonzero(np.isfinite(reach.s[0]))
    if len(usable) == reach.s.shape[1]:
        return grid.candidates(reach)
    box, caster = grid.candidates(reach[usable])
    return usable[box], caster


def _past_planes(
    grid: LampGrid, casters: Casters, box: Numbers, caster: Numbers, points: Array, planes: Planes,
    body: Numbers, eye: Array,
) -> tuple[Numbers, Numbers, Flags]:  # fmt: skip
    """Those of pairs that the planes of faces and receivers leave; and whether a receiver lies in
    the plane of a face that is turned away, so against it."""
    face, side = grid.face[caster], grid.side[caster]
    behind, ahead = sides_of_planes(casters, face, points, box)
    # one side of a plane sees nothing of it hidden; closed bodies hide outwards only
    closed = ~casters.both_sides[face]
    # what is turned to the lamp in the plane of a face that is turned away lies against it
    against = ahead & behind & closed & (side == -1)
    drop = (ahead & (side == 1)) | (behind & ~against & ((side == -1) | closed))
    kept = np.flatnonzero(~drop)
    box, face, caster, against = box[kept], face[kept], caster[kept], against[kept]
    low = lies_low(grid.view.lamp, casters, face, points, planes, box, body, eye)
    kept = np.flatnonzero(against | ~low)
    return box[kept], caster[kept], against[kept]


def _meets(grid: LampGrid, reach: Reach, box: Numbers, caster: Numbers) -> tuple[Flags, Flags]:
    """`LampGrid.meets`, pair by pair."""
    inside, past = np.empty(len(box), bool), np.empty(len(box), bool)
    for part in parts(len(box)):
        inside[part], past[part] = grid.meets(reach[box[part]], caster[part])
    return inside, past
