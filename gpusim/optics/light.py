"""Lights in radiometric units, reduced to a table of point emitters.

A lamp's face is integrated by Gauss-Legendre points, enough of them that the irradiance is right
to 1e-4 at the distance of the nearest surface; the result is smooth and has no noise.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from gpusim.errors import InputError

__all__ = [
    "AmbientLight",
    "AreaLight",
    "Light",
    "PointLight",
    "ambient",
    "closest_points",
    "emitters",
    "irradiance",
]

Vector = tuple[float, float, float]
Points = npt.NDArray[np.float64]


def _check(what: str, power: float, *vectors: Vector) -> None:
    if not (np.isfinite(power) and power > 0.0):
        raise InputError(f"{what} power; got {power}; expected watts above 0")
    for vector in vectors:
        if np.shape(vector) != (3,) or not np.isfinite(vector).all():
            raise InputError(f"{what}; got {vector}; expected three finite numbers")


@dataclass(frozen=True)
class PointLight:
    """Shines equally in all directions: radiant flux ``power`` (W), intensity power / 4 pi."""

    position: Vector
    power: float

    def __post_init__(self) -> None:
        _check("PointLight", self.power, self.position)


@dataclass(frozen=True)
class AreaLight:
    """A rectangle of ``size`` (width, height) that faces ``target`` and emits by Lambert's law.

    ``power`` is its radiant flux (W); its radiance is power / (pi width height).
    """

    position: Vector
    target: Vector
    size: tuple[float, float]
    power: float

    def __post_init__(self) -> None:
        _check("AreaLight", self.power, self.position, self.target)
        size = np.asarray(self.size, np.float64)
        if size.shape != (2,) or not (np.isfinite(size) & (size > 0.0)).all():
            raise InputError(f"AreaLight size; got {self.size}; expected two lengths above 0")
        if tuple(self.position) == tuple(self.target):
            raise InputError(f"AreaLight target; got the lamp's own position {self.target}")


@dataclass(frozen=True)
class AmbientLight:
    """Surroundings of one ``radiance`` (W per square unit and sr) in every direction.

    It stands for what a room's walls send back; every unhidden face receives pi x radiance.
    """

    radiance: float

    def __post_init__(self) -> None:
        if not (np.isfinite(self.radiance) and self.radiance > 0.0):
            raise InputError(f"AmbientLight radiance; got {self.radiance}; expected above 0")


Light = PointLight | AreaLight | AmbientLight


def ambient(lights: Sequence[Light]) -> float:
    """Irradiance that every face receives from the surroundings."""
    return float(np.pi * sum(v.radiance for v in lights if isinstance(v, AmbientLight)))


def emitters(lights: Sequence[Light], points: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Table (E, 8): position, intensity along the axis (W/sr), axis, 1 if it follows Lambert's law.

    ``points`` (P, 3) are surface points; the nearest decides how finely a lamp is divided.
    Surroundings have no row: see `ambient`.
    """
    rows = []
    for light in lights:
        if isinstance(light, AmbientLight):
            continue
        position = np.array(light.position, np.float64)
        if isinstance(light, PointLight):
            rows.append([*position, light.power / (4.0 * np.pi), 0.0, 0.0, 0.0, 0.0])
            continue
        axis = np.array(light.target, np.float64) - position
        axis /= np.linalg.norm(axis)
        up = np.array([0.0, 0.0, 1.0]) if abs(axis[2]) < 0.9 else np.array([0.0, 1.0, 0.0])
        across = np.cross(axis, up)
        across /= np.linalg.norm(across)
        along = np.cross(across, axis)
        nearest = float(np.sqrt(np.min(np.sum((points - position) ** 2, axis=1), initial=np.inf)))
        count = _points_across(max(light.size) / max(nearest, 1e-12))
        nodes, weights = np.polynomial.legendre.leggauss(count)
        for x, wx in zip(nodes, weights, strict=True):
            for y, wy in zip(nodes, weights, strict=True):
                at = position + 0.5 * (x * light.size[0] * across + y * light.size[1] * along)
                rows.append([*at, 0.25 * wx * wy * light.power / np.pi, *axis, 1.0])
    return np.array(rows, np.float64).reshape(-1, 8)


def closest_points(lights: Sequence[Light], triangles: npt.NDArray[np.float64]) -> Points:
    """The point of triangles (T, 3, 3) that is nearest to each lamp, (L, 3)."""
    result = [
        _closest(np.array(light.position, np.float64), triangles)
        for light in lights
        if len(triangles) and not isinstance(light, AmbientLight)
    ]
    return np.array(result, np.float64).reshape(-1, 3)


def _closest(position: Points, triangles: Points) -> Points:
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
    nearest: Points = candidates[np.argmin(np.sum((candidates - position) ** 2, axis=1))]
    return nearest


def _points_across(ratio: float) -> int:
    """Gauss points per side for a lamp of size / distance ``ratio``: error about ratio^2n / 6^n."""
    for count in (1, 2, 3, 4, 6):
        if (ratio * ratio / 6.0) ** count <= 1e-4:
            return count
    return 8


def irradiance(
    table: npt.NDArray[np.float64],
    points: npt.NDArray[np.float64],
    normals: npt.NDArray[np.float64],
    surroundings: float = 0.0,
) -> npt.NDArray[np.float64]:
    """Irradiance (N,) in W per square unit at points (N, 3) with unit normals (N, 3).

    ``surroundings`` is added everywhere (see `ambient`).
    """
    total = np.full(len(points), surroundings)
    for row in table:
        to_light = row[:3] - points
        square = np.maximum(np.sum(to_light * to_light, axis=1), 1e-30)
        distance = np.sqrt(square)
        falling = np.maximum(np.sum(to_light * normals, axis=1) / distance, 0.0)
        leaving = np.maximum(-(to_light @ row[4:7]) / distance, 0.0) if row[7] else 1.0
        total += row[3] * leaving * falling / square
    return total
