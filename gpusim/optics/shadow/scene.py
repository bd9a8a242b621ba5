"""What hides the lamps of a view: occluders, where they are now, and the lamps' light spaces."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from gpusim.arrays.array_types import Float, Int, Long, Single
from gpusim.gpu import Device
from gpusim.optics.geometry.view import View
from gpusim.optics.light.quadrature import Lamp, check_number
from gpusim.optics.shadow.brute_force import shares_of
from gpusim.optics.shadow.light_space import LightSpace, lamp_numbers, light_spaces
from gpusim.optics.shadow.occluders import (
    OccluderBVH,
    Occluders,
    box_ends,
    planes_of,
    relative_points,
    single_sheets,
)
from gpusim.optics.shadow.receivers import TILE, Receivers
from gpusim.optics.shadow.single_layer import wound_once
from gpusim.surface.surface import Surface
from gpusim.surface.topology import Topology

LABEL = "shadow.occluders"

TOGETHER = 64
"""Receivers, about, that NumPy looks from at a time."""


@dataclass(frozen=True, eq=False)
class _CachedOccluders:
    """Those of the surfaces that were seen last, which stay while vertices move."""

    topologies: tuple[Topology, ...]
    trees: OccluderBVH

    def suits(self, topologies: tuple[Topology, ...]) -> bool:
        """Whether they are of the same surfaces."""
        return len(topologies) == len(self.topologies) and all(
            one is other for one, other in zip(topologies, self.topologies, strict=True)
        )


@dataclass(frozen=True, eq=False)
class Shadows:
    """Light and what hides it of one view.

    ``points`` (V, 3) float32: vertices of all surfaces relative to the eye. ``lamps``: centres are
    relative to the eye, too. ``spaces``: of those that cast shadows.
    """

    view: View
    occluders: Occluders
    points: Single
    lamps: tuple[Lamp, ...]
    spaces: tuple[LightSpace, ...]
    trees: OccluderBVH | None

    @staticmethod
    def of(
        view: View, lamps: Sequence[Lamp], surfaces: Sequence[Surface], device: Device | None
    ) -> Shadows:
        """Those of all ``surfaces``, whether they are in view or not.

        Raises
        ------
        InputError
            More lamps than a shader takes.
        """
        check_number(lamps)
        eye = view.camera.eye
        points = relative_points(surfaces, eye)
        relative = tuple(lamp.relative_to(eye) for lamp in lamps)
        spaces = tuple(
            replace(space, sheets=wound_once(space, surfaces, eye))
            for space in light_spaces(lamps, points, eye)
        )
        if device is None:
            own = Occluders.of(surfaces)
            return Shadows(view, own, points, relative, spaces, None)
        topologies = tuple(surface.topology for surface in surfaces)
        kept = device.pool.notes.get(LABEL)
        if not (isinstance(kept, _CachedOccluders) and kept.suits(topologies)):
            kept = _CachedOccluders(topologies, OccluderBVH(device, Occluders.of(surfaces)))
            device.pool.notes[LABEL] = kept
        kept.trees.move(points)
        own = kept.trees.occluders
        return Shadows(view, own, points, relative, spaces, kept.trees)

    @property
    def casting(self) -> int:
        """Bits of the lamps that cast shadows."""
        return sum(1 << number for number in lamp_numbers(self.spaces))

    @cached_property
    def owners(self) -> Int:
        """(T,): the occluder that each triangle of the view is part of, -1 of closed surfaces."""
        return np.take(self.occluders.owner, self.view.source, mode="clip")

    def turned(self, terminator: float) -> tuple[LightSpace, ...]:
        """The spaces for receivers whose normals lean by so much (sine)."""
        return tuple(replace(space, terminator=terminator) for space in self.spaces)

    def shares(
        self,
        x: Float,
        y: Float,
        at: Float,
        normal: Float,
        across: Float,
        down: Float,
        triangle: Long,
    ) -> Float:
        """(n, L): what receivers see of each lamp, 0 to 1, in NumPy; of one without shadows all.

        ``x``, ``y`` (n,) px; ``at`` (n, 3) their places relative to the eye, ``normal`` (n, 3)
        unit; ``across``, ``down`` (n, 3) how the places change over the pixel, or the piece;
        ``triangle`` (n,) of the view.
        """
        receivers = self.receivers(at, normal, across, down, triangle)
        corners = self.points.astype(np.float64)[self.occluders.triangles]
        planes = planes_of(corners)
        result = np.zeros((len(x), len(self.lamps)))
        result[:, [not (self.casting >> k) & 1 for k in range(len(self.lamps))]] = 1.0
        for space in self.spaces:
            low, high = box_ends(space, corners)
            single = single_sheets(space, self.occluders, corners)
            for rows in _together(space, x, y, receivers):
                face = _near(space, low, high, receivers[rows])
                result[rows, space.number] = shares_of(
                    space, self.occluders, corners, planes, receivers[rows], face, single
                )
        return result

    def receivers(
        self, at: Float, normal: Float, across: Float, down: Float, triangle: Long
    ) -> Receivers:
        """Receivers on triangles (n,) of the view."""
        return Receivers(at, normal, across, down, self.owners[triangle].astype(np.int64))


def _together(space: LightSpace, x: Float, y: Float, receivers: Receivers) -> Iterator[Long]:
    """Receivers that ask, those of a tile at about the same depth side by side."""
    asking = np.flatnonzero(space.asks(receivers.at, receivers.normal))
    tile = np.floor((y[asking] + 0.5) / TILE) * 1e6 + np.floor((x[asking] + 0.5) / TILE)
    away = np.linalg.norm(receivers.at[asking], axis=1)
    order = np.lexsort((away, tile))
    asking, tile, away = asking[order], tile[order], away[order]
    apart = (np.diff(tile) != 0.0) | (np.diff(away) > 0.02 * away[1:])
    for group in np.split(asking, np.flatnonzero(apart) + 1):
        for first in range(0, len(group), TOGETHER):
            yield group[first : first + TOGETHER]


def _near(space: LightSpace, low: Float, high: Float, receivers: Receivers) -> Long:
    """Occluders whose boxes, between ``low`` and ``high`` (T, 3), meet the shaft from all of
    ``receivers`` to the lamp."""
    least, most = np.full(3, np.inf), np.full(3, -np.inf)
    for a, b in ((-0.5, -0.5), (-0.5, 0.5), (0.5, -0.5), (0.5, 0.5)):
        place = space.place(receivers.at + a * receivers.across + b * receivers.down)
        slack = 4.0 * space.rounding_at(place)
        least = np.minimum(least, (place - slack).min(axis=0))
        most = np.maximum(most, (place + slack).max(axis=0))
    rise = np.maximum(high[:, 2] - least[2], 0.0)
    near = high[:, 2] >= least[2]
    for axis, half in enumerate(space.half):
        near &= low[:, axis] <= most[axis] + half * rise
        near &= high[:, axis] >= least[axis] - half * rise
    return np.flatnonzero(near)
