"""Lamps reduced to tables of point emitters, and the faces that shadows are taken of.

A lamp's face is integrated by Gauss-Legendre points, enough of them that the irradiance is right
to 1e-4 at the distance of the nearest surface, and that the highlights of glossy paints have no
gaps; the result is smooth and has no noise.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from gpusim.arrays.array_types import Float
from gpusim.optics.camera.pinhole import Camera
from gpusim.optics.light.lights import (
    AmbientLight,
    AreaLight,
    EnvironmentLight,
    Light,
    PointLight,
    SpotLight,
    SunLight,
)
from gpusim.validation import require

MOST_ACROSS = 8
"""Emitting points along one side of a lamp; shadows have samples of their own, `sample_mask`."""

MOST_SHADOWS = 32
"""Lamps that cast shadows: each has a bit of a word."""


@dataclass(frozen=True, eq=False)
class Lamp:
    """A light that has a place, as shadows see it.

    Its face is ``centre + a u + b v`` with a, b from -1 to 1 (those inside the unit circle where
    ``round``); a ``far`` one is a direction instead, ``centre`` being its unit vector. ``axis`` is
    the way that it shines: zero for a light without one.
    """

    light: PointLight | SpotLight | AreaLight | SunLight
    centre: Float
    u: Float
    v: Float
    axis: Float
    round: bool
    far: bool

    @property
    def extended(self) -> bool:
        """Whether it has a size, and so casts soft shadows."""
        return bool(np.any(self.u) or np.any(self.v))

    def relative_to(self, origin: Float) -> Lamp:
        """The same in a frame with another ``origin``; a direction stays."""
        return self if self.far else replace(self, centre=self.centre - origin)


def check_number(lamps: Sequence[Lamp]) -> None:
    """Raises InputError for more lamps that cast shadows than shaders take."""
    casting = sum(lamp.light.shadows for lamp in lamps)
    got = f"{casting} lamps that cast shadows"
    less = "set shadows to False for those whose shadows don't matter"
    require(casting <= MOST_SHADOWS, "render lights", got, f"at most {MOST_SHADOWS}: {less}")


def lamps_of(lights: Sequence[Light]) -> list[Lamp]:
    """Every light but the surroundings: in order, those that cast shadows first."""
    zero = np.zeros(3)
    lamps = []
    for light in lights:
        if isinstance(light, (AmbientLight, EnvironmentLight)):
            continue
        if isinstance(light, SunLight):
            axis = np.array(light.direction, np.float64)
            axis /= np.linalg.norm(axis)
            across, along = _square_to(axis)
            radius = np.tan(0.5 * light.diameter)
            lamps.append(Lamp(light, -axis, radius * across, radius * along, axis, True, True))
            continue
        position = np.array(light.position, np.float64)
        if isinstance(light, PointLight):
            lamps.append(Lamp(light, position, zero, zero, zero, False, False))
            continue
        axis = np.array(light.target, np.float64) - position
        axis /= np.linalg.norm(axis)
        if isinstance(light, SpotLight):
            lamps.append(Lamp(light, position, zero, zero, axis, False, False))
            continue
        across, along = _square_to(axis)
        u, v = 0.5 * light.size[0] * across, 0.5 * light.size[1] * along
        lamps.append(Lamp(light, position, u, v, axis, light.shape == "ellipse", False))
    return sorted(lamps, key=lambda lamp: not lamp.light.shadows)


def _square_to(axis: Float) -> tuple[Float, Float]:
    """Two unit vectors square to ``axis`` and each other; the first is level where possible."""
    x, y, z = axis
    # axis x (0, 0, 1), or x (0, 1, 0) where it is nearly upright; NumPy's own takes a hundred times
    # as long for three numbers
    across = np.array([y, -x, 0.0]) if abs(z) < 0.9 else np.array([-z, 0.0, x])
    across /= np.linalg.norm(across)
    a, b, c = across
    return across, np.array([b * z - c * y, c * x - a * z, a * y - b * x])


def emitters(lights: Sequence[Light], points: Float, sharpness: float = np.inf) -> Float:
    """Table (E, 12): one row per point of a lamp's face, lamp by lamp.

    Columns: position (of the sun: direction to it), intensity along the axis (W/sr; of the sun:
    W per square unit), axis, 1 if it follows Lambert's law; 1 if it is near (inverse square), the
    cosine at which a beam ends, 1 / (what the cosine grows by until it is full), lamp number.

    ``points`` (P, 3) are surface points; the nearest decides how finely a lamp is divided.
    ``sharpness``: the smallest GGX alpha of glossy paints; emitters lie closer than their lobe.
    Surroundings have no row.
    """
    rows = []
    for number, lamp in enumerate(lamps_of(lights)):
        light = lamp.light
        plain = [1.0, -2.0, 1.0, float(number)]
        if isinstance(light, PointLight):
            rows.append([*lamp.centre, light.power / (4.0 * np.pi), *lamp.axis, 0.0, *plain])
            continue
        if isinstance(light, SpotLight):
            outer, inner = light.cosines
            beam = [1.0, outer, 1.0 / (inner - outer), float(number)]
            rows.append([*lamp.centre, light.intensity, *lamp.axis, 0.0, *beam])
            continue
        if isinstance(light, SunLight):
            count = _points_across(0.0, light.diameter / sharpness)
            for x, y, weight in _face_points(lamp, count):
                at = lamp.centre + x * lamp.u + y * lamp.v
                rows.append([*at, weight * light.irradiance, *lamp.axis, 0.0, 0.0, *plain[1:]])
            continue
        nearest = float(np.sqrt(np.min(np.sum((points - lamp.centre) ** 2, axis=1), initial=1e300)))
        ratio = max(light.size) / max(nearest, 1e-12)
        intensity = light.power / np.pi
        for x, y, weight in _face_points(lamp, _points_across(ratio, ratio / sharpness)):
            at = lamp.centre + x * lamp.u + y * lamp.v
            rows.append([*at, weight * intensity, *lamp.axis, 1.0, *plain])
    return np.array(rows, np.float64).reshape(-1, 12)


def _face_points(lamp: Lamp, count: int) -> list[tuple[float, float, float]]:
    """Points (a, b) of a lamp's face and their weights, which sum to 1.

    Gauss-Legendre in both directions of a rectangle; of a disc in the square of the radius, with
    equal steps of the angle.
    """
    nodes, weights = np.polynomial.legendre.leggauss(count)
    if not lamp.round:
        return [
            (float(x), float(y), float(0.25 * wx * wy))
            for x, wx in zip(nodes, weights, strict=True)
            for y, wy in zip(nodes, weights, strict=True)
        ]
    if count == 1:
        return [(0.0, 0.0, 1.0)]
    spokes = 2 * count
    result = []
    for ring, (x, w) in enumerate(zip(nodes, weights, strict=True)):
        radius = np.sqrt(0.5 * (x + 1.0))
        for k in range(spokes):
            angle = 2.0 * np.pi * (k + 0.5 * (ring % 2)) / spokes
            at = (float(radius * np.cos(angle)), float(radius * np.sin(angle)))
            result.append((*at, float(0.5 * w / spokes)))
    return result


def closest_points(lights: Sequence[Light], triangles: Float, camera: Camera) -> Float:
    """World points of camera-space triangles (T, 3, 3) nearest to each area lamp, (L, 3)."""
    R, t = camera.camera_from_world[:3, :3], camera.camera_from_world[:3, 3]
    result = [
        (_closest(R @ lamp.centre + t, triangles) - t) @ R
        for lamp in lamps_of(lights)
        if len(triangles) and isinstance(lamp.light, AreaLight)
    ]
    return np.array(result, np.float64).reshape(-1, 3)


def _closest(position: Float, triangles: Float) -> Float:
    # only triangles whose first corner is nearly as close as any, by the lengths of their sides
    p = [[np.ascontiguousarray(triangles[:, k, axis]) for axis in range(3)] for k in range(3)]
    distance = np.sqrt(sum((p[0][axis] - position[axis]) ** 2 for axis in range(3)))
    sides = [np.sqrt(sum((p[k][axis] - p[0][axis]) ** 2 for axis in range(3))) for k in (1, 2)]
    nearest_corner = float(distance.min()) * (1.0 + 1e-12)
    triangles = triangles[distance - np.maximum(*sides) <= nearest_corner]
    a, edges = triangles, np.roll(triangles, -1, axis=1) - triangles
    normal = np.cross(edges[:, 0], edges[:, 1])
    square = np.sum(normal * normal, axis=1)
    height = np.sum((position - a[:, 0]) * normal, axis=1) / np.where(square > 0.0, square, 1.0)
    foot = position - height[:, None] * normal
    sides = np.sum(np.cross(edges, foot[:, None] - a) * normal[:, None], axis=2)
    inside = (sides >= 0.0).all(axis=1) & (square > 0.0)
    length = np.sum(edges * edges, axis=2)
    t = np.sum((position - a) * edges, axis=2) / np.where(length > 0.0, length, 1.0)
    candidates = np.concatenate(
        [(a + np.clip(t, 0.0, 1.0)[..., None] * edges).reshape(-1, 3), foot[inside]]
    )
    nearest: Float = candidates[np.argmin(np.sum((candidates - position) ** 2, axis=1))]
    return nearest


def _points_across(ratio: float, lobes: float) -> int:
    """Gauss points per side of a lamp.

    ``ratio``: size / distance; the irradiance is then off by about ratio^2n / 6^n. ``lobes``: its
    angle over the half width of the narrowest highlight, which needs about as many points.
    """
    for count in (1, 2, 3, 4, 6):
        if (ratio * ratio / 6.0) ** count <= 1e-4 and (count >= lobes + 1.0 or lobes <= 0.1):
            return count
    return MOST_ACROSS


def emitter_light(row: Float, points: Float, normals: Float) -> tuple[Float, Float, Float]:
    """Of one emitter: irradiance (N,), unit directions to it (N, 3), cosine of incidence (N,)."""
    near = row[8]
    to = row[:3] - near * points
    square = np.maximum(np.sum(to * to, axis=1), 1e-30)
    unit = to / np.sqrt(square)[:, None]
    falling = np.maximum(np.sum(unit * normals, axis=1), 0.0)
    along = -(unit @ row[4:7])
    leaving = np.maximum(along, 0.0) if row[7] else np.ones(len(points))
    t = np.clip((along - row[9]) * row[10], 0.0, 1.0)
    beam = t * t * (3.0 - 2.0 * t)
    spread = 1.0 / square if near else 1.0
    return row[3] * leaving * beam * falling * spread, unit, falling
