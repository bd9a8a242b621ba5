"""Caps: what points of a lamp's face see of a closed body that bulges.

A round body has another outline from every point of an extended lamp. Seen from one of its points,
what turns to it is one layer, whose border is the outline; from others that border lies inside of
theirs, by what turns about between the two points (R d^2 / 2 for a radius R and d radian between
them). Caps of several points that the lamp's face is divided between hide what the body does, but
for that, where each is told by the winding of its border (`gpusim.optics.lamp_outline`): none hides
what the body doesn't.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from gpusim.optics.lamp_turn import Turned
from gpusim.optics.lamp_view import LampView
from gpusim.optics.layer import sides_from
from gpusim.optics.loops import Loops
from gpusim.surface.topology import Topology

__all__ = ["caps_of"]

Array = npt.NDArray[np.float64]
Numbers = npt.NDArray[np.int64]

MOST_CELLS = 4
"""Along either side of a lamp's face."""

MOST_EDGE_ON = 0.3
"""Of the triangles."""

SHARE = 1.0 / 512.0
"""Of the lamp's lesser side, seen from half the body's depth below it, by which caps may fall short
before more are taken."""

TOO_MUCH = 16.0
"""Times that: nothing is told by such caps."""

NEAREST = 3
"""Places of a border next to a point that tell how far it is."""

DEEP = 3.0
"""Depths of what turns about, within which parts of a border belong together."""


def caps_of(
    view: LampView, places: Array, topology: Topology, turned: Turned
) -> tuple[tuple[Loops, ...], float] | None:
    """Borders of caps of a closed body, and how far they fall short of its outlines in p and q from
    any point of the lamp; None where it may hide parts of itself. ``places`` (3, P): p, q, s."""
    if len(turned.edge_on) > MOST_EDGE_ON * len(turned.front):
        return None
    parts = np.zeros(len(turned.front), bool)
    parts[turned.edge_on] = True
    first, second = topology.first, topology.second
    edges = np.flatnonzero(
        (turned.front[first] != turned.front[second]) | parts[first] | parts[second]
    )
    shown = places[2, topology.triangles[turned.front | parts]]
    enough = SHARE * min(view.half) * 0.5 * float(np.ptp(shown)) if shown.size else 0.0
    found = _caps(view, places, topology, turned, edges, 1)
    if found is None or found[1] <= enough:
        return found
    cells = int(np.ceil(np.sqrt(found[1] / max(enough, 1e-300)).clip(max=2.0 * MOST_CELLS)))
    if cells > 1:
        found = _caps(view, places, topology, turned, edges, min(cells, MOST_CELLS))
    return None if found is None or found[1] > TOO_MUCH * enough else found


def _caps(
    view: LampView, places: Array, topology: Topology, turned: Turned, edges: Numbers, cells: int
) -> tuple[tuple[Loops, ...], float] | None:
    """The same with so many ``cells`` along either side; ``edges`` that borders may go along."""
    middle = (np.arange(cells) + 0.5) * (2.0 / cells) - 1.0
    half = view.half[0] / cells, view.half[1] / cells
    result, most = [], 0.0
    for a in middle:
        for b in middle:
            area = turned.area[0] + a * turned.area[1] + b * turned.area[2]
            lit = turned.front.copy()
            lit[turned.edge_on] = area > turned.least
            border = edges[lit[topology.first[edges]] != lit[topology.second[edges]]]
            inside = np.where(
                lit[topology.first[border]], topology.first[border], topology.second[border]
            )
            loops = Loops.of(*sides_from(topology, border, inside))
            at = _from(view, places, a, b)
            if loops is None or not loops.wind_once(at, (0.0, 0.0)):
                return None
            turns = np.abs(turned.area[1:]).sum(axis=0) / cells + turned.least
            own = turned.edge_on[np.abs(area) <= turns]
            short, deep = _short(view, places, loops, topology.triangles[own], (a, b), 1.0 / cells)
            if not loops.stay(at, half, DEEP * deep):
                return None
            most = max(most, short)
            result.append(loops)
    return tuple(result), most


def _from(view: LampView, places: Array, a: float, b: float) -> Array:
    """``places`` (3, P) as seen from a point of the lamp's face, in halves of its size."""
    across, along = view.half
    return np.stack(
        [places[0] - a * across * places[2], places[1] - b * along * places[2], places[2]]
    )


def _short(
    view: LampView, places: Array, loops: Loops, triangles: Numbers, middle: tuple[float, float],
    size: float,
) -> tuple[float, float]:  # fmt: skip
    """How far triangles (n, 3) reach beyond a border, in p and q, from any point of a cell of the
    lamp's face with this ``middle`` and half its ``size``; and in s. Corners tell, as whatever
    changes with the lamp's point changes linearly."""
    vertex = np.unique(triangles)
    if not len(vertex):
        return 0.0, 0.0
    following, before = loops.vertex[loops.after], np.empty_like(loops.vertex)
    before[loops.after] = loops.vertex
    short = deep = 0.0
    # from a lamp without size all corners are one
    corners = ((-1, -1), (1, -1), (1, 1), (-1, 1)) if view.lamp.extended else ((0, 0),)
    for i, j in corners:
        at = _from(view, places, middle[0] + i * size, middle[1] + j * size)
        near = cKDTree(at[:2, loops.vertex].T).query(at[:2, vertex].T, k=NEAREST)[1]
        near = near[:, np.append(True, np.full(NEAREST - 1, len(loops.vertex) >= NEAREST))]
        point = at[:2, vertex][:, :, None]
        away = np.full(near.shape, np.inf)
        for other in (following, before):
            start, end = at[:2, loops.vertex[near]], at[:2, other[near]]
            way = end - start
            length = np.maximum(np.sum(way * way, axis=0), 1e-300)
            share = np.clip(np.sum((point - start) * way, axis=0) / length, 0.0, 1.0)
            away = np.minimum(away, np.hypot(*(point - start - share * way)))
        short = max(short, float(away.min(axis=1).max()))
        rise = np.abs(places[2, vertex][:, None] - places[2, loops.vertex[near]]).min(axis=1)
        deep = max(deep, float(rise.max()))
    return short, deep
