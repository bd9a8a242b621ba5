"""The origin that a picture is made from, near what it shows.

Coordinates of a survey lie millions of metres from zero. A picture of a structure there is the same
as of one at zero, so both are made at zero: surfaces, camera and lamps are moved in float64, before
anything is rounded to float32 or compared with a tolerance. What is told in the world again (the
truth) has the origin added.
"""

from __future__ import annotations

import copy
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from gpusim.arrays.array_types import Float
from gpusim.optics.camera.pinhole import Camera
from gpusim.optics.geometry.view import View, look
from gpusim.optics.light.lights import AreaLight, Light, PointLight, SpotLight
from gpusim.surface.surface import Surface

NEAR = 4.0
"""Sizes of a scene: as far from zero is near enough."""

SAMPLED = 1000
"""Points of a surface, about, that tell where it is."""


class Local(NamedTuple):
    """A scene moved by minus ``origin`` (3,)."""

    surfaces: Sequence[Surface]
    camera: Camera
    lights: Sequence[Light] | None
    origin: Float


def local(
    surfaces: Sequence[Surface], camera: Camera, lights: Sequence[Light] | None = None
) -> Local:
    """A scene as it is seen from an origin near its surfaces; itself where that is zero."""
    origin = origin_near([surface.points for surface in surfaces])
    if not origin.any():
        return Local(surfaces, camera, lights, origin)
    pose = camera.camera_from_world.copy()
    pose[:3, 3] += pose[:3, :3] @ origin
    # the same lens: nothing that has been checked and found of it is done again
    moved = copy.copy(camera)
    object.__setattr__(moved, "camera_from_world", pose)
    return Local(
        [surface.relative_to(origin) for surface in surfaces], moved,
        None if lights is None else [_moved(light, origin) for light in lights], origin,
    )  # fmt: skip


def local_view(surfaces: Sequence[Surface], camera: Camera, lit: bool) -> View:
    """What a camera sees, looked at from an origin near it."""
    surfaces, camera, _, origin = local(surfaces, camera)
    return seen_from_origin(look(surfaces, camera, lit), origin)


def seen_from_origin(view: View, origin: Float) -> View:
    """The view of what has its zero at ``origin`` (3,) in the world."""
    return replace(view, origin=origin) if origin.any() else view


def origin_near(points: Sequence[Float]) -> Float:
    """(3,): an origin near all of these ``points`` (P, 3); zero where that is near enough.

    It lies on a grid as wide as a power of two, so that it stays where points move a little and
    nothing is rounded where it is subtracted.
    """
    sampled = [place[:: max(len(place) // SAMPLED, 1)] for place in points]
    low = np.min([place.min(axis=0) for place in sampled], axis=0)
    high = np.max([place.max(axis=0) for place in sampled], axis=0)
    size = float((high - low).max())
    if not size > 0.0:
        return np.zeros(3)
    step = 2.0 ** np.ceil(np.log2(2.0 * NEAR * size))
    origin: Float = step * np.rint(0.5 * (low + high) / step)
    return origin + 0.0  # no negative zeros


def _moved(light: Light, origin: Float) -> Light:
    """The same lamp; what has no place stays."""

    def at(place: tuple[float, float, float]) -> tuple[float, float, float]:
        x, y, z = (float(v) for v in np.asarray(place, np.float64) - origin)
        return x, y, z

    if isinstance(light, PointLight):
        return replace(light, position=at(light.position))
    if isinstance(light, SpotLight | AreaLight):
        return replace(light, position=at(light.position), target=at(light.target))
    return light
