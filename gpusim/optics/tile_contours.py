"""Contours of the faces before tiles of a picture, in place of the faces.

Where all that a tile's receivers see of a lamp lies beyond some faces, and these turn the same side
to all of the lamp, a ray from a receiver meets them as often as their border winds round it. Edges
between two of them cancel, and of the rest those count that may lie before the lamp: however fine
the mesh, a tile sees a few.

Faces that reach down to what is lit, or that some of the lamp sees from the other side, stay as
they are. Faces that hang together without a crease have a border of their own, so that layers over
each other are counted one by one, as far as a sheet doesn't wind over itself: up to 7 layers of one
are told from none (`occlusion`), and what covers more than the rectangle round it, of the faces
before a tile, stays, too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import connected_components

from gpusim.optics.casters import Casters
from gpusim.optics.corners import products
from gpusim.optics.lamp_view import LampView, Reach
from gpusim.optics.ragged import expand
from gpusim.optics.tile_edges import Closing, TileEdges

__all__ = ["FEWEST", "MANY", "Boxes", "Listed", "contours", "one_way_round", "sides_of"]

Array = npt.NDArray[np.float64]
Numbers = npt.NDArray[np.int64]
Flags = npt.NDArray[np.bool_]

FEWEST, MANY = 8, 100_000
"""Faces before a tile, and edges of such faces before all tiles, that are worth a look at their
contours."""

WORTH = 3.0
"""Edges of faces that cost as much as one of a contour."""

BESIDE = 0.15
"""Of what a tile's receivers span, that pixels may see beside them; about a pixel, unless they are
thinner than `THIN`."""

THIN = 2.0
"""px across which surfaces in a tile extend at least, for contours to be told from their boxes."""

MARGIN = 1e-5
"""Of the highest s, by which faces must be nearer to the lamp than receivers."""

SMOOTH = 0.7
"""Cosine between the normals of faces that hang together."""

OVER = 1.05
"""Of the rectangle round a piece, that its faces may cover in all."""

CELLS = 1 << 21
"""Of a table of tiles and faces that is looked up at once."""


@dataclass(frozen=True, eq=False)
class Sides:
    """Sides of faces, each beside one other face or none: of the face's ``begin`` (F + 1,) to the
    next one's are its own. ``face`` (n,): whose; ``first`` and ``second`` (n,): vertices, in the
    face's direction; ``beside`` (n,): the face that it goes on into without a crease, or -1."""

    begin: Numbers
    face: Numbers
    first: Numbers
    second: Numbers
    beside: Numbers


def sides_of(levels: Sequence[Casters], faces: Numbers) -> Sides:
    """The sides of some ``faces`` (n,), numbered from level to level.

    Faces that were joined needn't meet corner by corner: a side ends where another face begins on
    it.
    """
    number = [len(casters.faces) for casters in levels]
    count, parts = sum(number), []
    used = np.zeros(count + 1, bool)
    used[faces] = True
    for begin, casters in zip(np.cumsum([0, *number]), levels, strict=False):
        rows = np.flatnonzero(used[begin + casters.edge[:, 0]] & (casters.beside != -2))
        other = casters.beside[rows]
        other = np.where(other < 0, -1, begin + other)
        other[~used[other]] = -1
        place = 4 * (begin + casters.edge[rows, 0]) + casters.edge[rows, 1]
        parts.append((place, other, *casters.ends[rows].T))
    own, other, first, second = (np.concatenate(v) for v in zip(*parts, strict=True))
    order = np.lexsort((other, own))
    own, other, first, second = own[order], other[order], first[order], second[order]
    # edges on one side beside the same face, or none, are one, if they hang together
    run = np.cumsum((np.diff(own, prepend=-1) != 0) | (np.diff(other, prepend=-2) != 0)) - 1
    many = np.flatnonzero(np.bincount(run, minlength=1)[run] > 1)
    size = int(max(first.max(initial=0), second.max(initial=0))) + 1
    key, place = np.unique(
        np.concatenate([run[many] * size + first[many], run[many] * size + second[many]]),
        return_inverse=True,
    )
    net = np.bincount(place, np.repeat([1.0, -1.0], len(many)), minlength=len(key))
    starts, stops = key[net > 0.0], key[net < 0.0]
    runs = int(run[-1]) + 1 if len(run) else 0
    whole = np.bincount(starts // size, minlength=runs) == 1
    whole &= np.bincount(stops // size, minlength=runs) == 1
    head = np.flatnonzero(np.diff(run, prepend=-1))
    for ends, found in ((first, starts), (second, stops)):
        good = found[whole[found // size]]
        ends[head[good // size]] = good % size
    kept = np.ones(len(run), bool)
    kept[many[whole[run[many]]]] = False
    kept[head[whole]] = True
    own, other, first, second = own[kept] // 4, other[kept], first[kept], second[kept]
    normal = np.concatenate([casters.normal for casters in levels]).T
    one, across = normal[:, own], normal[:, other]
    turn = products(one, across)
    turn /= np.maximum(np.sqrt(products(one, one) * products(across, across)), 1e-300)
    other[turn < SMOOTH] = -1
    return Sides(np.searchsorted(own, np.arange(count + 1)), own, first, second, other)


@dataclass(frozen=True, eq=False)
class Listed:
    """Pairs of tiles and faces before them: ``tile`` (n,), ascending, ``face`` (n,) and how many
    ``edges`` (n,) of it count there. Of faces: ``sides``, between ``points`` (P, 3), ``low`` and
    ``high`` (3, F) ends, ``body`` (F,) and whether ``both_sides`` (F,) of it hide, ``side`` (F,) as
    in `LampFaces`, ``lowest`` (F,) s."""

    tile: Numbers
    face: Numbers
    edges: Numbers
    points: Array
    sides: Sides
    low: Array
    high: Array
    body: Numbers
    both_sides: Flags
    side: Numbers
    lowest: Array


@dataclass(frozen=True, eq=False)
class Boxes:
    """Receivers in tiles: ``tile`` (m,), ``body`` (m,) and ``pixels`` (2, 2, m), first and last x
    and y, of each, ``points`` (k, 3, m) around it, and their ``reach`` in the lamp's view."""

    tile: Numbers
    body: npt.NDArray[np.int32]
    pixels: Array
    points: Array
    reach: Reach


def one_way_round(places: tuple[Array, Array, Array], half: tuple[float, float]) -> Flags:
    """(n,) whether a lamp with ``half`` its size sees outlines of faces, p, q and s (n, 4), turn
    the same way at every corner. Bent faces, seen edge-on, turn over in part."""
    p, q, s = (np.ascontiguousarray(v.T) for v in places)
    left, right = np.ones((2, p.shape[1]), bool)
    # the area between two edges is linear in the lamp's point
    for a in (-half[0], half[0]):
        for b in (-half[1], half[1]):
            x, y = (np.roll(v, -1, axis=0) - v for v in (p - a * s, q - b * s))
            turn = x * np.roll(y, -1, axis=0) - y * np.roll(x, -1, axis=0)
            left &= (turn >= 0.0).all(axis=0)
            right &= (turn <= 0.0).all(axis=0)
    return np.asarray(left | right)


def contours(
    view: LampView, listed: Listed, boxes: Boxes, highest: Array
) -> tuple[Flags, TileEdges]:
    """Which of what is ``listed`` stays, (n,), and the edges in place of the others.

    ``boxes``: all receivers in the tiles. ``highest`` (tiles,): s of the receivers there that
    something may be before.
    """
    stays = np.ones(len(listed.tile), bool)
    tile, row = np.unique(listed.tile, return_inverse=True)
    around = _Around.of(tile, boxes, highest[tile])
    # nearer to the lamp than all that it may be hidden from, all of which is on one side
    above = listed.lowest[listed.face] > around.cut[row]
    above &= (listed.side[listed.face] != 0) & ~_thin(tile, boxes)[row]
    rows = np.flatnonzero(above)
    rows = rows[~_goes_on(listed, rows, boxes)]
    count = np.bincount(row[rows], minlength=len(tile))
    rows = rows[count[row[rows]] >= FEWEST]
    if not len(rows):
        return stays, TileEdges.none()
    piece, border = _borders(listed, row[rows], listed.face[rows], len(tile))
    flat = _side_by_side(view, listed, listed.face[rows], piece, border)
    rows, border = rows[flat[piece]], border[np.flatnonzero(flat[border.piece])]
    edges = _needed(view, listed.points, border, around)
    before = np.bincount(row[rows], listed.edges[rows], minlength=len(tile))
    better = WORTH * np.bincount(edges.tile, minlength=len(tile)) < before
    stays[rows[better[row[rows]]]] = False
    edges = edges[np.flatnonzero(better[edges.tile])]
    return stays, replace(edges, tile=tile[edges.tile])


@dataclass(frozen=True, eq=False)
class _Around:
    """Of receivers in tiles that may be beyond a plane of s = ``cut`` (n,), infinite where nothing
    is sure: their ``window`` (2, 2, n), first and last p, and q, and their ``lowest`` s (n,)."""

    cut: Array
    window: Array
    lowest: Array

    @staticmethod
    def of(tile: Numbers, boxes: Boxes, most: Array) -> _Around:
        """``tile`` (n,) ascending; ``most`` (n,): the highest s of what the lamp may be hidden
        from."""
        # what is behind the lamp isn't lit
        own = np.flatnonzero(boxes.reach.s[1] != -np.inf)
        row = np.searchsorted(tile, boxes.tile[own])
        reach = boxes.reach[own]

        def least(values: Array) -> Array:
            result = np.full(len(tile), np.inf)
            np.minimum.at(result, row, values)
            return result

        lowest = least(reach.s[0])
        with np.errstate(invalid="ignore"):
            cut = most + BESIDE * (most - lowest) + MARGIN * np.abs(most)
            beyond = reach.s[0] <= cut[row]
        window = np.empty((2, 2, len(tile)))
        for axis, (start, stop) in enumerate((reach.p, reach.q)):
            first = least(np.where(beyond, start, np.inf))
            last = -least(np.where(beyond, -stop, np.inf))
            with np.errstate(invalid="ignore"):
                more = BESIDE * (last - first)
            window[axis] = first - more, last + more
        sound = np.isfinite(cut) & np.isfinite(window).all(axis=(0, 1))
        return _Around(np.where(sound, cut, np.inf), window, lowest)


def _span(place: Numbers, count: int, low: Array, high: Array) -> tuple[Array, Array]:
    """Least ``low`` and greatest ``high`` (n,) of each ``place`` (n,) of ``count``."""
    least, most = np.full(count, np.inf), np.full(count, -np.inf)
    np.minimum.at(least, place, low)
    np.maximum.at(most, place, high)
    return least, most


def _thin(tile: Numbers, boxes: Boxes) -> Flags:
    """(n,) in which tiles, ascending, the box round what is seen of some surface is thin: pixels
    there look from beside it."""
    bodies = 1 + int(boxes.body.max(initial=0))
    key, place = np.unique(boxes.tile * bodies + boxes.body, return_inverse=True)
    thin = np.zeros(len(key), bool)
    for axis in range(2):
        low, high = _span(place, len(key), *boxes.pixels[:, axis])
        thin |= ~(high - low >= THIN)
    return np.isin(tile, key[thin] // bodies)


def _goes_on(listed: Listed, rows: Numbers, boxes: Boxes) -> Flags:
    """Which ``rows`` (n,) of pairs are of faces beside what a tile shows of the same open surface,
    which may go on into them: there pixels look from their middles alone (`occlusion`)."""
    result = np.zeros(len(rows), bool)
    asked = np.flatnonzero(listed.both_sides[listed.face[rows]])
    if not len(asked):
        return result
    face = listed.face[rows[asked]]
    bodies = 1 + max(int(listed.body.max()), int(boxes.body.max(initial=0)))
    key, place = np.unique(boxes.tile * bodies + boxes.body, return_inverse=True)
    ends = zip(boxes.points.min(axis=0), boxes.points.max(axis=0), strict=True)
    low, high = np.stack([_span(place, len(key), *own) for own in ends], axis=1)
    more = BESIDE * (high - low).max(axis=0)
    own = listed.tile[rows[asked]] * bodies + listed.body[face]
    found = np.minimum(np.searchsorted(key, own), max(len(key) - 1, 0))
    beside = key[found] == own
    for axis in range(3):
        beside &= listed.low[axis][face] <= (high[axis] + more)[found]
        beside &= listed.high[axis][face] >= (low[axis] - more)[found]
    result[asked] = beside
    return result


@dataclass(frozen=True, eq=False)
class _Border:
    """Edges of borders: ``row`` (m,) of the tile, the vertices at their ``first`` and ``second``
    ends, and the ``piece`` that hangs together which each goes round."""

    row: Numbers
    first: Numbers
    second: Numbers
    piece: Numbers

    def __getitem__(self, index: Numbers) -> _Border:
        return _Border(self.row[index], self.first[index], self.second[index], self.piece[index])


def _borders(listed: Listed, row: Numbers, face: Numbers, tiles: int) -> tuple[Numbers, _Border]:
    """The pieces that faces (n,) in tiles ``row`` (n,), ascending, are part of, and their
    borders."""
    sides = listed.sides
    used = np.unique(face)
    number = np.full(len(sides.begin), -1)
    number[used] = np.arange(len(used))
    pair, step = expand(np.diff(sides.begin)[face])
    edge = sides.begin[face[pair]] + step
    # what turns the other side to the lamp is no part of a piece
    alike = (sides.beside >= 0) & (listed.side[sides.beside] == listed.side[sides.face])
    beside = np.where(alike, number[sides.beside], -1).astype(np.int32)[edge]
    across = np.full(len(pair), -1, np.int32)
    # some tiles at a time, in a table of what is before each
    begin = np.searchsorted(row, np.arange(tiles + 1))
    stop = np.searchsorted(pair, begin)
    most = max(CELLS // len(used), 1)
    table = np.empty((most, len(used) + 1), np.int32)
    for first in range(0, tiles, most):
        last = min(first + most, tiles)
        part, edges = slice(begin[first], begin[last]), slice(stop[first], stop[last])
        # nothing is before them in the last column
        table[:] = -1
        table[row[part] - first, number[face[part]]] = np.arange(part.start, part.stop)
        across[edges] = table[row[pair[edges]] - first, beside[edges]]
    inner = np.flatnonzero(across >= 0)
    links = csr_matrix(
        (np.ones(len(inner), bool), across[inner],
         np.searchsorted(pair[inner], np.arange(len(face) + 1))), shape=(len(face), len(face)),
    )  # fmt: skip
    piece = connected_components(links, directed=False)[1].astype(np.int64)
    outer = np.flatnonzero(across < 0)
    pair, edge = pair[outer], edge[outer]
    return piece, _Border(row[pair], sides.first[edge], sides.second[edge], piece[pair])


def _side_by_side(
    view: LampView, listed: Listed, face: Numbers, piece: Numbers, border: _Border
) -> Flags:
    """(pieces,) whether the faces (n,) of a ``piece`` (n,) each cover no more than the rectangle
    round its ``border``, as the lamp's middle sees them."""
    sides, (p, q, _) = listed.sides, view.place(*np.ascontiguousarray(listed.points.T))
    a, b = sides.first, sides.second
    area = np.bincount(sides.face, p[a] * q[b] - p[b] * q[a], minlength=len(sides.begin) - 1)
    count = int(piece.max()) + 1
    covered = np.abs(np.bincount(piece, 0.5 * area[face], minlength=count))
    size = np.ones(count)
    for place in (p, q):
        low, high = _span(border.piece, count, place[border.first], place[border.first])
        size *= np.where(np.isfinite(low), high - low, np.inf)
    # without a border there is nothing to tell it by
    return np.asarray((covered <= OVER * size) & np.isfinite(size))


def _needed(view: LampView, points: Array, border: _Border, around: _Around) -> TileEdges:
    """Edges of a ``border`` of ``points`` (P, 3) as far as they count in the windows that receivers
    look through, tile by tile, piece by piece; `TileEdges.tile` are rows."""
    used, number = np.unique(np.stack([border.first, border.second]), return_inverse=True)
    points = points[used]
    first, second = number.reshape(2, -1)
    border = _Border(border.row, first, second, border.piece)
    p, q, s = view.place(*np.ascontiguousarray(points.T))
    top = np.full(len(around.cut), -np.inf)
    np.maximum.at(top, border.row, np.maximum(s[border.first], s[border.second]))
    # wider towards the lamp
    size, window = around.window[:, 1] - around.window[:, 0], around.window.copy()
    with np.errstate(invalid="ignore"):
        for axis in range(2):
            reach = view.half[axis] * np.maximum(top - around.lowest, 0.0)
            window[axis, 0] -= reach
            window[axis, 1] += reach
            size[axis] += 2.0 * reach
    (left, right), (below, above) = window
    one, other, row = border.first, border.second, border.row
    keep = np.minimum(q[one], q[other]) <= above[row]
    keep &= np.maximum(q[one], q[other]) >= below[row]
    keep &= np.maximum(p[one], p[other]) >= left[row]
    border = border[np.flatnonzero(keep)]
    one, other, row = border.first, border.second, border.row
    beside = np.minimum(p[one], p[other]) > right[row]
    near, far = border[np.flatnonzero(~beside)], border[np.flatnonzero(beside)]
    ends = np.stack([points[near.first], points[near.second]], axis=1)
    closing = Closing.of(
        far.piece, far.first, far.second, q, (below[far.row], above[far.row])
    )  # fmt: skip
    row_of = np.zeros(int(far.piece.max(initial=0)) + 1, np.int64)
    row_of[far.piece] = far.row
    row = row_of[closing.border]
    away = BESIDE * size[:, row]
    side = right[row] + away[0]
    low, high = (
        view.world(side, place, top[row]).T
        for place in (below[row] - away[1], above[row] + away[1])
    )
    more = closing.ends(points, high, low)
    row, piece = (np.concatenate(v) for v in ((near.row, row), (near.piece, closing.border)))
    order = np.lexsort((piece, row))
    ends, row, piece = np.concatenate([ends, more])[order], row[order], piece[order]
    last = np.diff(piece, append=-1) != 0
    return TileEdges(row, ends, view.planes(around.cut[row]), last)
