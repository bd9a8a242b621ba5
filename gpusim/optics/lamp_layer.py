"""Lamps from which nothing is hidden: what such a lamp sees is one layer, from all of its face.

Where all triangles of an oriented sheet turn the same side to a lamp, a ray from the lamp meets it
as often as its border winds round the ray. A border that doesn't cross itself as the lamp sees it,
from any of its points, and winds once, is that of a sheet that hides nothing of itself. Of a closed
body that holds for the part turned to the lamp, which is before all the rest. Several surfaces hide
nothing of each other where the lamp sees them side by side.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple
from weakref import WeakKeyDictionary

import numpy as np
import numpy.typing as npt
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import connected_components

from gpusim.optics.corners import CHUNK, products
from gpusim.optics.emitters import Lamp, lamps_of
from gpusim.optics.lamp_view import LampView
from gpusim.optics.layer import border_of
from gpusim.optics.light import Light
from gpusim.optics.loops import Loops
from gpusim.optics.outline import unit
from gpusim.optics.ragged import expand
from gpusim.optics.shape import Shape, shapes_of
from gpusim.surface.plane import used_vertices
from gpusim.surface.surface import Surface
from gpusim.surface.topology import Topology

__all__ = ["FEWEST", "Alone", "surfaces_alone", "without_shadows"]

Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]
Numbers = npt.NDArray[np.int64]

FEWEST = 2000
"""Triangles from which on it is worth while to find out."""

MOST_ALONE = 8
"""Surfaces that are looked at for themselves."""

MOST_KEPT = 32
"""Views of a surface from lamps that are kept."""

MOST_SEEN = 20_000
"""Dark triangles of a closed body that are looked at closely."""

SURE = 1e-13
"""Of the extent in a lamp's view, squared: areas that rounding may turn over; and of a cosine."""

_BORDERS: WeakKeyDictionary[Topology, Loops | None] = WeakKeyDictionary()
_PARTS: WeakKeyDictionary[Topology, npt.NDArray[np.int32]] = WeakKeyDictionary()


@dataclass(frozen=True, eq=False)
class Patch:
    """What a lamp sees of a surface, one layer: its ends ``low``, ``high`` (3,) in p, q and s, its
    border's ``loops``, and its ``triangles`` (n, 3)."""

    low: Array
    high: Array
    loops: Loops
    triangles: npt.NDArray[np.int64]

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


class Alone(NamedTuple):
    """A surface, by its number, that hides nothing of itself in a lamp's ``view``, and its
    ``points`` (P, 3) in the world."""

    surface: int
    view: LampView
    patch: Patch
    points: Array


def surfaces_alone(
    lamps: Sequence[Lamp], surfaces: Sequence[Surface], eye: Array
) -> list[list[Alone]]:
    """For each lamp those ``surfaces`` of many triangles that hide nothing of it from themselves,
    as far as they are seen from the ``eye``."""
    large = [
        number
        for number, surface in enumerate(surfaces)
        if len(surface.topology.triangles) >= FEWEST
    ]
    shapes = shapes_of(surfaces) if large else []

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
                result.append(Alone(number, view, patch, shapes[number].points))
        return result

    return [alone(lamp) for lamp in lamps]


def _lights_all(lamp: Lamp, surfaces: Sequence[Surface], shapes: list[Shape], eye: Array) -> bool:
    """Whether a lamp sees all that is turned to it."""
    view, key = _view(lamp, surfaces)
    patches: list[Patch] = []
    for surface, shape in zip(surfaces, shapes, strict=True):
        patch = None if view is None else _kept(view, key, surface, shape, eye)
        if view is None or patch is None:
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


def _kept(view: LampView, key: bytes, surface: Surface, shape: Shape, eye: Array) -> Patch | None:
    """`_patch`, found once for each shape of a surface: of open ones whatever eye sees them."""
    if surface.topology.closed:
        key += eye.tobytes()
    if key not in shape.lamps:
        while len(shape.lamps) >= MOST_KEPT:
            # the oldest one: a body that stays while the camera or a lamp moves has ever more
            shape.lamps.pop(next(iter(shape.lamps)))
        shape.lamps[key] = _patch(view, surface, shape, eye)
    found: Patch | None = shape.lamps[key]
    return found


def _patch(view: LampView, surface: Surface, shape: Shape, eye: Array) -> Patch | None:
    """What a lamp sees of a surface; None where something of it may be hidden, or looks to the
    ``eye`` and is hidden by itself alone."""
    topology = surface.topology
    if not topology.oriented:
        return None
    if topology.closed and not _closed_suits(view.lamp, surface, shape):
        return None
    places = np.stack(view.place(*(np.ascontiguousarray(v) for v in shape.points.T)))
    if not np.isfinite(places).all():
        return None
    lit = _turned_to(view, places, topology.triangles, topology.closed)
    if lit is None:
        return None
    if topology.closed:
        if not lit.any() or not _unlit(view.lamp, shape, topology, lit, eye):
            return None
        loops = Loops.of(*border_of(topology, lit))
    else:
        if topology not in _BORDERS:
            _BORDERS[topology] = Loops.of(*border_of(topology, None))
        loops = _BORDERS[topology]
    if loops is None or not loops.wind_once(places, view.half):
        return None
    triangles, own = topology.triangles, places
    if topology.closed:
        triangles = triangles[lit]
        own = places[:, used_vertices(triangles, places.shape[1])]
    return Patch(own.min(axis=1), own.max(axis=1), loops, triangles)


def _closed_suits(lamp: Lamp, surface: Surface, shape: Shape) -> bool:
    """Whether a closed body may be looked at so: all its parts wound outwards, the lamp outside,
    and no relief that turns to the lamp what lies in the body's own shadow."""
    if not (_volumes(shape, surface.topology) > 0.0).all() or any(
        getattr(paint, "bump", None) is not None for paint in surface.paints.values()
    ):
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


def _turned_to(
    view: LampView, places: Array, triangles: npt.NDArray[np.int64], both: bool
) -> Flags | None:
    """(T,) which triangles turn their front to a lamp; None where one is seen edge-on from some of
    it or, unless they may do ``both``, some turn their front and some their back.

    ``places`` (3, P): p, q and s of their corners. Seen from the point (a, b) of the lamp's face,
    in halves of its size, areas are linear in a and b.
    """
    across, along = view.half
    turn = -np.sign(np.linalg.det([view.across, view.along, view.axis]))
    least = SURE * float(np.ptp(places[:2], axis=1).max(initial=0.0)) ** 2
    result = np.empty(len(triangles), bool)
    for first in range(0, len(triangles), CHUNK):
        part = slice(first, first + CHUNK)
        corner = [np.ascontiguousarray(triangles[part, k]) for k in range(3)]
        p, q = (_sides(values, corner) for values in places[:2])
        area = p[0] * q[1]
        area -= p[1] * q[0]
        area *= turn
        sweep = np.full(len(area), least)
        if view.lamp.extended:
            s = _sides(places[2], corner)
            sweep += across * np.abs(s[0] * q[1] - s[1] * q[0])
            sweep += along * np.abs(p[0] * s[1] - p[1] * s[0])
        front = area > sweep
        if not (front | (area < -sweep)).all():
            return None
        result[part] = front
        if not both and (not front.all() or first) and (front != result[0]).any():
            return None
    return result


def _sides(values: Array, corner: list[npt.NDArray[np.int64]]) -> tuple[Array, Array]:
    """How ``values`` (P,) change from the first corner to the others."""
    own = [np.take(values, numbers, mode="clip") for numbers in corner]
    return own[1] - own[0], own[2] - own[0]


def _unlit(lamp: Lamp, shape: Shape, topology: Topology, lit: Flags, eye: Array) -> bool:
    """Whether the triangles that aren't ``lit`` but look to the ``eye`` are dark without a shadow:
    the normals that they share with others turn away from the lamp, too."""
    triangles, points, area = topology.triangles, shape.points, shape.area
    own = np.flatnonzero(~lit)
    start = points[triangles[own, 0]]
    own = own[np.einsum("ka,ak->k", eye - start, area[:, own]) > 0.0]
    if len(own) > MOST_SEEN:
        return False
    met = np.zeros(len(points), bool)
    met[triangles[own]] = True
    some = np.flatnonzero(met[triangles[:, 0]] | met[triangles[:, 1]] | met[triangles[:, 2]])
    order = np.argsort(triangles[some], axis=None, kind="stable")
    vertex, around = triangles[some].reshape(-1)[order], some[order // 3]
    corner = triangles[own].reshape(-1)
    first = np.searchsorted(vertex, corner)
    row, offset = expand(np.searchsorted(vertex, corner, side="right") - first)
    other, own = around[first[row] + offset], own[row // 3]
    alike = products(unit(area[:, own]), unit(area[:, other])) >= np.cos(shape.smooth_angle) - SURE
    own, normal = own[alike], area[:, other[alike]]
    reach = np.abs(products(normal, lamp.u)) + np.abs(products(normal, lamp.v))
    reach += products(normal, lamp.centre)
    near = 0.0 if lamp.far else 1.0
    return all(
        bool((reach <= near * products(normal, points[triangles[own, k]].T)).all())
        for k in range(3)
    )
