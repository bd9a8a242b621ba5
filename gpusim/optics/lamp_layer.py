"""Lamps from which nothing is hidden: what such a lamp sees is one layer, from all of its face.

Where all triangles of an oriented sheet turn the same side to a lamp, a ray from the lamp meets it
as often as its border winds round the ray. A border that doesn't cross itself as the lamp sees it,
from any of its points, and winds once, is that of a sheet that hides nothing of itself. Of a closed
body that holds for the part turned to the lamp, which is before all the rest. Several surfaces hide
nothing of each other where the lamp sees them side by side.

Of bodies that bulge every point of an extended lamp sees another outline
(`gpusim.optics.lamp_band`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple
from weakref import WeakKeyDictionary

import numpy as np
import numpy.typing as npt
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import connected_components

from gpusim.optics.emitters import Lamp, lamps_of
from gpusim.optics.lamp_band import band_of, one_layer, turning
from gpusim.optics.lamp_dark import doubtful
from gpusim.optics.lamp_turn import Turned, turned_to
from gpusim.optics.lamp_view import LampView
from gpusim.optics.layer import border_of
from gpusim.optics.light import Light
from gpusim.optics.loops import Loops
from gpusim.optics.shape import Shape, shapes_of
from gpusim.surface.plane import used_vertices
from gpusim.surface.surface import Surface
from gpusim.surface.topology import Topology

__all__ = ["FEWEST", "Alone", "Later", "Patch", "surfaces_alone", "without_shadows"]

Array = npt.NDArray[np.float64]
Numbers = npt.NDArray[np.int64]

FEWEST = 2000
"""Triangles from which on it is worth while to find out."""

MOST_ALONE = 8
"""Surfaces that are looked at for themselves."""

MOST_KEPT = 32
"""Views of a surface from lamps that are kept."""

_BORDERS: WeakKeyDictionary[Topology, Loops | None] = WeakKeyDictionary()
_PARTS: WeakKeyDictionary[Topology, npt.NDArray[np.int32]] = WeakKeyDictionary()
_OUTWARDS: WeakKeyDictionary[Shape, bool] = WeakKeyDictionary()


@dataclass(frozen=True, eq=False)
class Patch:
    """What hides a lamp of a surface: ``triangles`` (n, 3), their ends ``low``, ``high`` (3,) in p,
    q and s, and the ``border`` of those that turn the same side to all of the lamp, and whether
    that winds ``once`` at most, but for folds. ``band`` (n,): numbers of the surface's triangles
    that don't, see `gpusim.optics.lamp_band`, and of those beside the border. ``alone``: whether it
    hides nothing of itself, but for triangles of ``doubt`` (n,), which may lie in its own shadow.
    """

    low: Array
    high: Array
    border: Loops
    once: bool
    triangles: npt.NDArray[np.int64]
    band: Numbers
    alone: bool
    doubt: Numbers

    def beside(self, other: Patch, half: tuple[float, float]) -> bool:
        """Whether a lamp with ``half`` its size sees none of them before the other."""
        rise = max(self.high[2] - other.low[2], other.high[2] - self.low[2])
        margin = np.array(half) * rise
        low, high = self.low[:2] - margin, self.high[:2] + margin
        return bool((low > other.high[:2]).any() or (high < other.low[:2]).any())


def without_shadows(
    surfaces: Sequence[Surface], lights: Sequence[Light], eye: Array
) -> list[Light]:
    """The same ``lights``, without shadows those that nothing of ``surfaces`` is hidden from, as
    far as it is seen from the ``eye``."""
    found = list(lights)
    lamps = {id(lamp.light): lamp for lamp in lamps_of(lights) if lamp.light.shadows}
    if not lamps or sum(len(surface.topology.triangles) for surface in surfaces) < FEWEST:
        return found
    shapes = shapes_of(surfaces)
    for number, light in enumerate(lights):
        lamp = lamps.get(id(light))
        if lamp is not None and _lights_all(lamp, surfaces, shapes, eye):
            found[number] = replace(lamp.light, shadows=False)
    return found


@dataclass(frozen=True, eq=False)
class Later:
    """A closed body that may hide parts of itself: what hides a lamp of it is found if somebody
    asks for it."""

    view: LampView
    surface: Surface
    shape: Shape

    @cached_property
    def patch(self) -> Patch | None:
        """None where it has no border that is short enough."""
        topology, places = self.surface.topology, _places(self.view, self.shape)
        turned = turned_to(self.view, places, topology.triangles, True)
        assert turned is not None  # of closed bodies none is refused
        band = turning(turned, topology.source)
        return None if band is None else _banded(self.view, topology, places, turned, band, None)


class Alone(NamedTuple):
    """A surface, by its number, what hides a lamp of it in the lamp's ``view``, and its ``points``
    (P, 3) in the world; ``source`` (T,): the face of each of its triangles, among those of all
    surfaces."""

    surface: int
    view: LampView
    patch: Patch | Later
    points: Array
    source: Numbers


def surfaces_alone(
    lamps: Sequence[Lamp], surfaces: Sequence[Surface], eye: Array
) -> list[list[Alone]]:
    """For each lamp those ``surfaces`` of many triangles that hide nothing of it from themselves,
    as far as they are seen from the ``eye``, and other closed ones."""
    large = [
        number
        for number, surface in enumerate(surfaces)
        if len(surface.topology.triangles) >= FEWEST
    ]
    shapes = shapes_of(surfaces) if large else []
    first = np.cumsum([0, *(len(surface.faces) for surface in surfaces)])

    def alone(lamp: Lamp) -> list[Alone]:
        view, key = _view(lamp, surfaces) if large and lamp.light.shadows else (None, b"")
        result: list[Alone] = []
        if view is None:
            return result
        for number in large:
            patch = None
            if len(result) < MOST_ALONE:
                patch = _kept(view, key, surfaces[number], shapes[number], eye)
            if patch is not None:
                source = surfaces[number].topology.source + first[number]
                result.append(Alone(number, view, patch, shapes[number].points, source))
        return result

    return [alone(lamp) for lamp in lamps]


def _lights_all(lamp: Lamp, surfaces: Sequence[Surface], shapes: list[Shape], eye: Array) -> bool:
    """Whether a lamp sees all that is turned to it."""
    view, key = _view(lamp, surfaces)
    patches: list[Patch] = []
    for surface, shape in zip(surfaces, shapes, strict=True):
        patch = None if view is None else _kept(view, key, surface, shape, eye)
        if view is None or not isinstance(patch, Patch) or not patch.alone or len(patch.doubt):
            return False
        if not all(patch.beside(other, view.half) for other in patches):
            return False
        patches.append(patch)
    return True


def _view(lamp: Lamp, surfaces: Sequence[Surface]) -> tuple[LampView | None, bytes]:
    """How a lamp sees surfaces, and what tells it from other views; None where it is amid them."""
    if not lamp.extended and not lamp.far:
        # a small lamp shines all round: one may look from it where the surfaces are
        to = np.mean([surface.points.mean(axis=0) for surface in surfaces], axis=0) - lamp.centre
        length = float(np.linalg.norm(to))
        if not length > 0.0:
            return None, b""
        lamp = replace(lamp, axis=to / length)
    vectors = lamp.centre, lamp.u, lamp.v, lamp.axis
    key = b"".join(v.tobytes() for v in vectors) + bytes([lamp.far])
    return LampView.of(lamp)[0], key


def _kept(
    view: LampView, key: bytes, surface: Surface, shape: Shape, eye: Array
) -> Patch | Later | None:
    """`_patch`, found once for each shape of a surface: of open ones whatever eye sees them."""
    if surface.topology.closed:
        key += eye.tobytes()
    if key not in shape.lamps:
        while len(shape.lamps) >= MOST_KEPT:
            # the oldest one: a body that stays while the camera or a lamp moves has ever more
            shape.lamps.pop(next(iter(shape.lamps)))
        shape.lamps[key] = _patch(view, surface, shape, eye)
    found: Patch | Later | None = shape.lamps[key]
    return found


def _places(view: LampView, shape: Shape) -> Array:
    """(3, P): p, q, s of a surface's vertices."""
    return np.stack(view.place(*(np.ascontiguousarray(v) for v in shape.points.T)))


def _patch(view: LampView, surface: Surface, shape: Shape, eye: Array) -> Patch | Later | None:
    """What a lamp sees of a surface; None where something of it may be hidden, or looks to the
    ``eye`` and is hidden by itself alone, and it isn't closed."""
    topology = surface.topology
    if not topology.oriented:
        return None
    if topology.closed and not _closed_suits(view.lamp, surface, shape):
        return None
    places = _places(view, shape)
    if not np.isfinite(places).all():
        return None
    turned = turned_to(view, places, topology.triangles, topology.closed)
    if turned is None:
        return None
    if topology.closed:
        return _body(view, surface, shape, places, turned, eye)
    if topology not in _BORDERS:
        _BORDERS[topology] = Loops.of(*border_of(topology, None))
    loops = _BORDERS[topology]
    if loops is None or not loops.wind_once(places, view.half):
        return None
    low, high, none = places.min(axis=1), places.max(axis=1), np.zeros(0, np.int64)
    return Patch(low, high, loops, True, topology.triangles, none, True, none)


def _body(
    view: LampView, surface: Surface, shape: Shape, places: Array, turned: Turned, eye: Array
) -> Patch | Later | None:
    """The same of a closed body."""
    topology, lit, border = surface.topology, turned.front, None
    # relief turns to the lamp what lies in the body's own shadow
    smooth = all(getattr(paint, "bump", None) is None for paint in surface.paints.values())
    if smooth and not len(turned.edge_on) and lit.any():
        border = Loops.of(*border_of(topology, lit))
    if border is not None and border.wind_once(places, view.half):
        dark = doubtful(view.lamp, shape, topology, lit, eye)
        if dark is not None:
            return _hiding(topology, places, lit, border, True, np.zeros(0, np.int64), dark)
    elif smooth:
        band = turning(turned, topology.source)
        if band is not None and one_layer(view, places, topology, turned, band):
            dark = doubtful(view.lamp, shape, topology, lit | band, eye)
            if dark is not None:
                return _banded(view, topology, places, turned, band, dark)
    return Later(view, surface, shape)


def _banded(
    view: LampView,
    topology: Topology,
    places: Array,
    turned: Turned,
    band: npt.NDArray[np.bool_],
    dark: Numbers | None,
) -> Patch | None:
    """What hides a lamp of a closed body with a ``band`` (T,); ``dark`` (n,): triangles that are
    turned away and yet in doubt, None where the body may hide parts of itself."""
    found = band_of(view, places, topology, turned, band)
    if found is None:
        return None
    listed, hides = np.flatnonzero(found.triangles | found.beside), found.triangles | found.dark
    if dark is not None:
        dark = np.concatenate([np.flatnonzero(found.triangles), dark])
    return _hiding(topology, places, hides, found.border, found.once, listed, dark)


def _hiding(
    topology: Topology,
    places: Array,
    hides: npt.NDArray[np.bool_],
    border: Loops,
    once: bool,
    band: Numbers,
    doubt: Numbers | None,
) -> Patch:
    """The patch of triangles that ``hides`` (T,)."""
    triangles = topology.triangles[hides]
    own = places[:, used_vertices(triangles, places.shape[1])]
    alone, doubt = doubt is not None, np.zeros(0, np.int64) if doubt is None else doubt
    low, high = own.min(axis=1), own.max(axis=1)
    return Patch(low, high, border, once, triangles, band, alone, doubt)


def _closed_suits(lamp: Lamp, surface: Surface, shape: Shape) -> bool:
    """Whether a closed body may be looked at so: all its parts wound outwards, and the lamp
    outside."""
    if shape not in _OUTWARDS:
        _OUTWARDS[shape] = bool((_volumes(shape, surface.topology) > 0.0).all())
    if not _OUTWARDS[shape]:
        return False
    if lamp.far:
        return True
    reach = np.abs(lamp.u) + np.abs(lamp.v)
    # rows of three numbers would take ten times as long
    low, high = (np.array([end(v) for v in surface.points.T]) for end in (np.min, np.max))
    return bool((lamp.centre + reach < low).any() or (lamp.centre - reach > high).any())


def _volumes(shape: Shape, topology: Topology) -> Array:
    """Of each part of a closed surface that hangs together; below 0 where it is wound inwards."""
    if topology not in _PARTS:
        count = len(topology.triangles)
        ends = topology.first, topology.second
        beside = csr_matrix((np.ones(len(ends[0]), bool), ends), shape=(count, count))
        _PARTS[topology] = connected_components(beside, directed=False)[1]
    middle, own = shape.points.mean(axis=0), np.zeros(len(topology.triangles))
    for axis, area in enumerate(shape.area):
        start = np.take(shape.points[:, axis], topology.triangles[:, 0], mode="clip")
        start -= middle[axis]
        start *= area
        own += start
    own /= 6.0
    result: Array = np.bincount(_PARTS[topology], own).astype(np.float64)
    return result
