"""Caps: what points of a lamp's face see of a closed body that bulges.

A round body has another outline from every point of an extended lamp. Seen from one of its points,
what turns to it is one layer, whose border is the outline; from others that border lies inside of
theirs, by what turns about between the two points (R d^2 / 2 for a radius R and d radian between
them). Caps of several points that the lamp's face is divided between hide what the body does, but
for that, where each is told by the winding of its border (`gpusim.optics.lamp_outline`): none hides
what the body doesn't.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from gpusim.optics.lamp_turn import Turned, areas
from gpusim.optics.lamp_view import LampView, seen_from
from gpusim.optics.layer import sides_from
from gpusim.optics.loops import Cap, Loops, corners_of, distance
from gpusim.surface.topology import Topology

__all__ = ["caps_of"]

Array = npt.NDArray[np.float64]
Numbers = npt.NDArray[np.int64]

MOST_CELLS = 4
"""Along either side of a lamp's face."""

MOST_SHARED = 0.3
"""Of the triangles."""

SHARE = 1.0 / 256.0
"""Of the lamp's lesser side, seen from half the body's depth below it, by which caps may fall short
before more are taken."""

WORTH = 0.7
"""Of how far few caps fall short, below which more are worth their edges."""

TOO_MUCH = 10.0
"""Times `SHARE`: nothing is told by caps that fall that short."""

NEAREST = 3
"""Places of a border next to a point that tell how far it is."""


def caps_of(
    view: LampView, places: Array, topology: Topology, turned: Turned
) -> tuple[tuple[Cap, ...], float, Numbers] | None:
    """Caps of a closed body, and how far they fall short of its outlines in p and q from
    any point of the lamp; None where it may hide parts of itself, but for triangles (n,) that turn
    their front to some points only. ``places`` (3, P): p, q, s."""
    shares = _Shares.of(view, places, topology, turned)
    if len(shares.number) > MOST_SHARED * len(turned.front):
        return None
    found = _caps(view, places, topology, shares, (1, 1))
    if found is None:
        return None
    if not view.lamp.extended:
        return *found, shares.number
    shown = places[2, topology.triangles[turned.front | shares.own]]
    enough = SHARE * min(view.half) * 0.5 * float(np.ptp(shown)) if shown.size else 0.0
    cells = int(np.ceil(np.sqrt(found[1] / max(enough, 1e-300)).clip(max=MOST_CELLS)))
    # long bodies have their outline across one side of the lamp
    for some in ((cells, 1), (1, cells), (cells, cells)):
        if found[1] > enough:
            other = _caps(view, places, topology, shares, some)
            if other is not None and other[1] < WORTH * found[1]:
                found = other
    if found[1] > TOO_MUCH * enough:
        return None
    return *found, shares.number


@dataclass(frozen=True, eq=False)
class _Shares:
    """Triangles that turn their front to some points of a lamp, or are part of a face that may:
    ``number`` (n,), sorted, and ``own`` (T,) which these are; ``front`` (T,): those of the others
    that do to all. ``edges``: those that borders may go along. ``areas`` (3, n): of each, see
    `gpusim.optics.lamp_turn.areas`; ``face`` (n,): of each, numbered; ``least`` as there."""

    number: Numbers
    own: npt.NDArray[np.bool_]
    front: npt.NDArray[np.bool_]
    edges: Numbers
    areas: Array
    face: Numbers
    least: float

    @staticmethod
    def of(view: LampView, places: Array, topology: Topology, turned: Turned) -> _Shares:
        """Those of a surface that is ``turned``."""
        own, front, source = np.zeros(len(turned.front), bool), turned.front, topology.source
        own[turned.edge_on] = True
        # triangles of one face go together: a fold along its diagonal would be one of every face
        apart = (source[1:] == source[:-1]) & ((front[1:] != front[:-1]) | own[1:] | own[:-1])
        own[1:] |= apart
        own[:-1] |= apart
        first, second = topology.first, topology.second
        edges = np.flatnonzero((front[first] != front[second]) | own[first] | own[second])
        number = np.flatnonzero(own)
        found = areas(view, places, topology.triangles[number])
        found += [np.zeros(len(number))] * (3 - len(found))
        face = np.unique(source[number], return_inverse=True)[1]
        return _Shares(number, own, front, edges, np.stack(found), face, turned.least)

    def lit(self, area: Array) -> npt.NDArray[np.bool_]:
        """(T,) which turn their front to a point of the lamp from which their ``area`` (n,) is."""
        result = self.front.copy()
        result[self.number] = np.bincount(self.face, area)[self.face] > self.least
        return result


def _caps(
    view: LampView, places: Array, topology: Topology, shares: _Shares, cells: tuple[int, int]
) -> tuple[tuple[Cap, ...], float] | None:
    """Caps, and how far they fall short, with so many ``cells`` along the lamp's sides."""
    size = 1.0 / cells[0], 1.0 / cells[1]
    half = view.half[0] * size[0], view.half[1] * size[1]
    result, most = [], 0.0
    for a in (2.0 * np.arange(cells[0]) + 1.0) * size[0] - 1.0:
        for b in (2.0 * np.arange(cells[1]) + 1.0) * size[1] - 1.0:
            area = shares.areas[0] + a * shares.areas[1] + b * shares.areas[2]
            lit, edges = shares.lit(area), shares.edges
            border = edges[lit[topology.first[edges]] != lit[topology.second[edges]]]
            inside = np.where(
                lit[topology.first[border]], topology.first[border], topology.second[border]
            )
            loops = Loops.of(*sides_from(topology, border, inside))
            if loops is None:
                return None
            turns = size[0] * np.abs(shares.areas[1]) + size[1] * np.abs(shares.areas[2])
            turns += shares.least
            some = (np.abs(area) <= turns) | ((area > 0.0) != lit[shares.number])
            triangles = topology.triangles[shares.number[some]]
            cap = Cap(loops, (a * view.half[0], b * view.half[1]), half)
            lobes = loops.lobes(seen_from(places, *cap.middle), half)
            if lobes is None:
                return None
            most = max(most, lobes, _short(cap, places, triangles))
            result.append(cap)
    return tuple(result), most


def _short(cap: Cap, places: Array, triangles: Numbers) -> float:
    """How far triangles (n, 3) reach beyond the border of a cap, in p and q, from any point of its
    cell. Corners tell, as what changes with the lamp's point changes linearly."""
    loops, vertex, result = cap.loops, np.unique(triangles), 0.0
    border = loops.vertex
    if not len(vertex):
        return 0.0
    before = np.argsort(loops.after)
    for a, b in corners_of(cap.half):
        at = seen_from(places, cap.middle[0] + a, cap.middle[1] + b)[:2]
        tree = cKDTree(at[:, border].T)
        near = np.asarray(tree.query(at[:, vertex].T, k=min(NEAREST, len(border)))[1], np.int64)
        away = np.full(len(vertex), np.inf)
        for row in near.T:
            for other in (loops.after[row], before[row]):
                away = np.minimum(away, distance(at, vertex, border[row], border[other]))
        result = max(result, float(away.max()))
    return result
