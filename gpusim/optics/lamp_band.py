"""The band of a closed body that bulges: what turns about between two points of an extended lamp.

A round body has another outline from every point of such a lamp, and many thin triangles turn about
in between. The others show either their front to all of the lamp or their back to all of it. A ray
from the lamp that meets the body comes out of it last by a triangle of the band or by one that
shows its back to all of the lamp; these it always crosses the same way, so that the border of what
they cover winds round it as often as it meets any. So that border and the faces of the band hide
what the body hides, and nothing else, from what is beyond both, whether it hides parts of itself or
not.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from gpusim.optics.lamp_turn import Turned, areas
from gpusim.optics.lamp_view import LampView
from gpusim.optics.layer import border_of
from gpusim.optics.loops import Loops
from gpusim.surface.topology import Topology

__all__ = ["Band", "band_of", "one_layer", "turning"]

Array = npt.NDArray[np.float64]
Numbers = npt.NDArray[np.int64]
Flags = npt.NDArray[np.bool_]

MOST = 0.3
"""Of the triangles, that may turn about."""

FOLDED = 0.04
"""Of the lamp's lesser side, seen from half the body's depth below it, that folds of the outline
may reach over."""

ROUNDS = 4
"""In which triangles join the band until the border of the rest doesn't touch itself."""


class Band(NamedTuple):
    """``triangles`` (T,): which of a body's are part of its band, ``dark`` (T,): which show their
    back to all of the lamp, and the ``border`` of these; ``once``: whether that winds once at most,
    but for folds. ``beside`` (T,): the dark ones next to it, which overlap with what chords leave
    out of it."""

    triangles: Flags
    dark: Flags
    beside: Flags
    border: Loops
    once: bool


def turning(turned: Turned, source: npt.NDArray[np.int32]) -> Flags | None:
    """(T,) the triangles that turn about, and all others of a face that doesn't turn as a whole: a
    fold along its diagonal would be one of every face. None where these are too many."""
    own, front = np.zeros(len(turned.front), bool), turned.front
    own[turned.edge_on] = True
    own[1:] |= (source[1:] == source[:-1]) & (front[1:] != front[:-1])
    own = _with_whole(own, source)
    return None if np.count_nonzero(own) > MOST * len(own) else own


def band_of(
    view: LampView, places: Array, topology: Topology, turned: Turned, band: Flags
) -> Band | None:
    """The band of a closed body that is ``turned``, of which ``band`` (T,) is `turning`; None where
    the border is too long. ``places`` (3, P): p, q, s."""
    for _ in range(ROUNDS):
        dark = ~(turned.front | band)
        starts, ends = border_of(topology, dark)
        border = Loops.of(starts, ends)
        if border is not None:
            once = border.folds(places, view.half) is not None
            beside = dark & _touched(topology, topology.triangles[band], places.shape[1])
            return Band(band, dark, beside, border, once)
        order = np.sort(starts)
        twice = order[1:][np.diff(order) == 0]
        touched = dark & _touched(topology, twice, places.shape[1])
        if not touched.any():
            return None
        band = _with_whole(band | touched, topology.source)
    return None


def one_layer(
    view: LampView, places: Array, topology: Topology, turned: Turned, band: Flags
) -> bool:
    """Whether what such a body shows to the lamp's middle is one layer from all of the lamp, but
    for folds at its outline."""
    lit, number = turned.front.copy(), np.flatnonzero(band)
    face = np.unique(topology.source[number], return_inverse=True)[1]
    ahead = areas(view, places, topology.triangles[number])[0]
    lit[number] = np.bincount(face, ahead)[face] > turned.least
    outline = Loops.of(*border_of(topology, lit))
    folds = None if outline is None else outline.folds(places, view.half)
    if folds is None or not view.lamp.extended:
        return folds is not None
    shown = places[2, topology.triangles[turned.front | band]]
    return folds <= FOLDED * min(view.half) * 0.5 * float(np.ptp(shown))


def _touched(topology: Topology, vertices: Numbers, count: int) -> Flags:
    """(T,) which triangles have one of some ``vertices``, of ``count`` in all."""
    if not vertices.size:
        return np.zeros(len(topology.triangles), bool)
    met = np.zeros(count, bool)
    met[vertices] = True
    return np.asarray(met[topology.triangles].any(axis=1))


def _with_whole(own: Flags, source: npt.NDArray[np.int32]) -> Flags:
    """``own`` (T,) and all others of their faces."""
    result = own.copy()
    same = source[1:] == source[:-1]
    result[1:] |= same & own[:-1]
    result[:-1] |= same & own[1:]
    return result
