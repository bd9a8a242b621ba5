"""Tiles of a picture that an outline (`gpusim.optics.lamp_outline`) hides a lamp from.

What is told by an outline holds for receivers beyond all of what they may see before the lamp. In a
tile with others of these they are told apart by a plane across the lamp's axis; where there is none
between them, faces have to be looked at.

Edges in a tile's window of the lamp's view are listed as they are, and those to the right of it
closed by others (`gpusim.optics.tile_edges`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from gpusim.optics.lamp_chain import Chain
from gpusim.optics.lamp_outline import BEFORE, BEYOND, CLEAR, UNSURE, Outline
from gpusim.optics.lamp_view import Reach
from gpusim.optics.patches import Small
from gpusim.optics.receivers import Receivers
from gpusim.optics.tile_edges import MOST_TURNS, Closing, TileEdges, most_turns
from gpusim.optics.tile_pairs import TILE, Pairs

__all__ = ["OutlineShadow", "outline_shadow"]

Array = npt.NDArray[np.float64]
Numbers = npt.NDArray[np.int64]
Flags = npt.NDArray[np.bool_]

BESIDE = 0.15
"""Of what a box is wide, that may be seen beside it, about a pixel of a tile's; and of a window,
by which edges are closed beside it."""

SHARP, SOFT = 1e-3, 1.0 / 1024.0
"""px, and share of the lamp's lesser side, by which edges may pass from the outline."""

MOST_LISTED = 1_000_000
"""Edges of an outline in all tiles; faces tell where there are more."""

STEP = 4.0
"""From what an outline is made coarser by to the next."""


@dataclass(frozen=True, eq=False)
class OutlineShadow:
    """``dark``, ``unsure``: tiles (linear) that it hides all of the lamp from, and those where
    faces have to tell. ``edges`` hide some of it."""

    dark: Numbers
    unsure: Numbers
    edges: TileEdges

    @staticmethod
    def none() -> OutlineShadow:
        """No shadow at all."""
        number = np.zeros(0, np.int64)
        return OutlineShadow(number, number, TileEdges.none())


def outline_shadow(
    receivers: Receivers, small: Small, outline: Outline, facing: Flags, shape: tuple[int, int]
) -> OutlineShadow:
    """What an ``outline`` hides of its lamp from receivers that are ``facing`` (T,) it, in a
    picture of ``shape`` (rows, columns) tiles; ``small``: of the receivers."""
    mask = _met(receivers, small, outline, facing, shape)
    if not mask.any():
        return OutlineShadow.none()
    pairs = receivers.in_tiles(mask.reshape(shape), facing)
    reach = outline.view.reach(receivers.points(pairs))
    number = pairs.tile[:, 1] * shape[1] + pairs.tile[:, 0]
    state = np.full(len(number), BEFORE, np.int8)
    others = np.flatnonzero(receivers.view.body[pairs.triangle] != outline.surface)
    state[others] = outline.states(reach[others])
    behind = reach.s[1] == -np.inf
    tile, row = np.unique(number, return_inverse=True)

    def most(own: Flags, values: Array) -> Array:
        result = np.full(len(tile), -np.inf)
        np.maximum.at(result, row[own], values[own])
        return result

    # what is clear there is taken along: it sees past the outline
    under = ((state == BEYOND) | (state == CLEAR)) & ~behind
    hidden = np.bincount(row[state == BEYOND], minlength=len(tile)) > 0
    unsure = np.bincount(row[state == UNSURE], minlength=len(tile)) > 0
    cut, above = most(under, reach.s[1]), -most(state == BEFORE, -reach.s[0])
    unsure |= hidden & ~(above > cut + outline.margin)
    other = np.bincount(row[(state == BEFORE) | behind], minlength=len(tile)) > 0
    p, q = (_wider(-most(under, -low), most(under, high)) for low, high in (reach.p, reach.q))
    box = Reach(p, q, np.stack([-most(under, -reach.s[0]), cut]))
    some = np.flatnonzero(hidden & ~unsure)
    sure = outline.states(box[some]) == BEYOND
    unsure[some[~sure]] = True
    some = some[sure]
    found = _edges_of(outline, box[some])
    unsure[some[found.broken]] = True
    whole = found.whole & ~found.broken
    kept = ~found.broken[found.box]
    dark = whole & ~other[some]
    kept &= ~dark[found.box]
    # between what is hidden and what isn't, or what hides it
    limit = np.minimum(above[some], found.lowest)
    limit = 0.5 * (cut[some] + np.where(np.isfinite(limit), limit, outline.top))
    edges = TileEdges(
        tile[some[found.box[kept]]], found.ends[kept],
        outline.view.planes(limit)[found.box[kept]], found.last[kept],
    )  # fmt: skip
    return OutlineShadow(tile[some[dark]], tile[unsure], edges)


def _wider(low: Array, high: Array) -> Array:
    """(2, n): boxes from ``low`` to ``high``, and what pixels see beside small triangles."""
    more = BESIDE * (high - low)
    return np.stack([low - more, high + more])


def _met(
    receivers: Receivers, small: Small, outline: Outline, facing: Flags, shape: tuple[int, int]
) -> Flags:
    """(tiles,) in which something may be hidden by the outline."""
    view, result = receivers.view, np.zeros(shape[0] * shape[1], bool)
    own = facing & (view.body != outline.surface)
    some = np.flatnonzero(small.some(own))
    hidden = np.zeros(len(small.triangle), bool)
    reach = outline.view.reach(np.take(small.points, some, axis=2))
    hidden[some] = outline.states(reach) >= BEYOND
    tile = small.pairs.tile[hidden[small.which]]
    result[tile[:, 1] * shape[1] + tile[:, 0]] = True

    def met(pairs: Pairs) -> Flags:
        points = receivers.points(pairs)
        found = outline.states(outline.view.reach(points)) >= BEYOND
        return found & receivers.seen(pairs, points) if pairs.size == TILE else found

    pairs = receivers.narrowed(np.flatnonzero(own & receivers.large), met)
    result[pairs.tile[:, 1] * shape[1] + pairs.tile[:, 0]] = True
    return result


@dataclass(eq=False)
class _Found:
    """Of boxes: ``broken`` and ``whole`` (n,), whether faces have to tell, and whether all is
    inside of the outline; ``lowest`` s of the edges listed; edges ``ends`` (m, 2, 3) world of
    ``box`` (m,)."""

    broken: Flags
    whole: Flags
    lowest: Array
    box: Numbers
    ends: Array

    @staticmethod
    def none(count: int) -> _Found:
        """Nothing of so many boxes."""
        no = np.zeros(count, bool)
        number = np.zeros(0, np.int64)
        return _Found(no, no.copy(), np.full(count, np.inf), number, np.zeros((0, 2, 3)))

    def take(self, rows: Numbers, found: _Found) -> None:
        """What was ``found`` of some of the boxes."""
        self.broken[rows], self.whole[rows] = found.broken, found.whole
        self.lowest[rows] = found.lowest
        self.box = np.concatenate([self.box, rows[found.box]])
        self.ends = np.concatenate([self.ends, found.ends])

    def sorted(self) -> _Found:
        """With edges box by box."""
        order = np.argsort(self.box, kind="stable")
        return replace(self, box=self.box[order], ends=self.ends[order])

    @property
    def last(self) -> Flags:
        """(m,) whether an edge is the last one in its box."""
        return np.asarray(np.diff(self.box, append=-1) != 0)


def _edges_of(outline: Outline, reach: Reach) -> _Found:
    """The edges that tell which of the lamp receivers in boxes see, all beyond the outline: of an
    outline as coarse as they don't tell from it."""
    size = np.minimum(*(high - low for low, high in (reach.p, reach.q)))
    rise = outline.depths(reach)[0] - reach.s[1]
    allowed = np.maximum(SHARP / TILE * size, SOFT * min(outline.view.half) * rise)
    result = _Found.none(len(allowed))
    level = np.zeros(len(allowed), np.int64)
    least = float(allowed.min(initial=np.inf))
    if least > 0.0:
        level = (np.log(allowed / least) / np.log(STEP)).astype(np.int64)
    for one in np.unique(level):
        own = np.flatnonzero(level == one)
        chain = outline.chain(least * STEP ** float(one))
        result.take(own, _edges(outline, chain, reach[own]))
    result = result.sorted()
    if not outline.once:
        turns = most_turns(outline.view, result.box, result.ends, len(allowed))
        result.broken |= turns > MOST_TURNS
    return result


def _edges(outline: Outline, chain: Chain, reach: Reach) -> _Found:
    """The same by the edges of one of its chains."""
    count, window = len(reach.s[0]), outline.window(reach)
    box, edge = chain.rightwards(window)
    apart = np.minimum(chain.start[0], chain.end[0])[edge] > window[0, 1, box]
    near, near_edge = box[~apart], edge[~apart]
    if len(near) > MOST_LISTED:
        # faces, joined for soft shadows, are fewer
        result = _Found.none(count)
        result.broken[:] = True
        return result
    box, edge = box[apart], edge[apart]
    first, second = chain.vertex[:, edge]
    rows = window[1, 0, box], window[1, 1, box]
    closing = Closing.of(box, first, second, outline.places[1], rows)
    box, code, above = closing.border, closing.vertex, len(outline.points)
    whole = np.zeros(count, bool)
    whole[box[code == above]] = True
    whole[near] = False
    # two points to the right, as far as the nearest to the lamp must be
    size = window[:, 1] - window[:, 0]
    side = window[0, 1] + BESIDE * size[0] + outline.across
    away, top = BESIDE * size[1] + outline.across, np.full(count, outline.top)
    low, high = (
        outline.view.world(side, q, top).T[box] for q in (window[1, 0] - away, window[1, 1] + away)
    )
    own = code < above
    ends = np.concatenate(
        [np.stack([outline.points[v[near_edge]] for v in chain.vertex], axis=1),
         closing.ends(outline.points, high, low)]
    )  # fmt: skip
    s = np.minimum(chain.start[2], chain.end[2])[near_edge]
    s = np.concatenate([s, np.where(own, outline.places[2, np.where(own, code, 0)], np.inf)])
    box = np.concatenate([near, box])
    lowest = np.full(count, np.inf)
    np.minimum.at(lowest, box, s)
    broken = ~(lowest > reach.s[1] + outline.margin)
    if not outline.once:
        broken[closing.many] = True
    return _Found(broken, whole, lowest, box, ends)
