"""Coordinate systems in which files give nodes: rectangular, cylindrical, spherical."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gpusim.arrays.array_types import Float
from gpusim.errors import InputError

# sine of the least angle at which two directions still span a plane
_MIN_SINE = 1e-9


@dataclass(frozen=True, eq=False)
class Frame:
    """A rectangular system: ``origin`` (3,), and ``axes`` (3,3) with a unit vector in each row."""

    origin: Float
    axes: Float

    @classmethod
    def from_x(cls, origin: Float, x: Float, xy: Float, where: str) -> Frame:
        """x through the point ``x``, y on the side of the point ``xy``. Raises InputError."""
        first, normal = _directions(origin, x, xy, where)
        return cls(origin, np.stack([first, np.cross(normal, first), normal]))

    @classmethod
    def from_z(cls, origin: Float, z: Float, xz: Float, where: str) -> Frame:
        """z through the point ``z``, x on the side of the point ``xz``. Raises InputError."""
        third, normal = _directions(origin, z, xz, where)
        return cls(origin, np.stack([np.cross(normal, third), normal, third]))

    def place(self, points: Float) -> Float:
        """Global coordinates (N,3) of points (N,3) given in this system."""
        return np.asarray(self.origin + points @ self.axes)


def _directions(origin: Float, one: Float, other: Float, where: str) -> tuple[Float, Float]:
    """Unit vectors from the origin to ``one`` point, and normal to those to both."""
    first, second = one - origin, other - origin
    normal = np.cross(first, second)
    size = float(np.linalg.norm(first)) * float(np.linalg.norm(second))
    if not float(np.linalg.norm(normal)) > _MIN_SINE * size > 0.0:
        raise InputError(
            f"{where}: got three points on one line, {origin.tolist()}, {one.tolist()}, "
            f"{other.tolist()}; expected three that span a plane"
        )
    return first / np.linalg.norm(first), normal / np.linalg.norm(normal)


def from_cylindrical(points: Float) -> Float:
    """(N,3) rectangular coordinates of r, angle from x in degrees, z."""
    angle = np.deg2rad(points[:, 1])
    return np.stack([points[:, 0] * np.cos(angle), points[:, 0] * np.sin(angle), points[:, 2]], 1)


def from_spherical(points: Float) -> Float:
    """(N,3) rectangular coordinates of r, angle from z, angle from x about z, in degrees."""
    flat = points[:, 0] * np.sin(np.deg2rad(points[:, 1]))
    height = points[:, 0] * np.cos(np.deg2rad(points[:, 1]))
    angle = np.deg2rad(points[:, 2])
    return np.stack([flat * np.cos(angle), flat * np.sin(angle), height], 1)


def rotation(axis: Float, degrees: float) -> Float:
    """(3,3) matrix that turns column vectors about ``axis`` (not zero) by the right-hand rule."""
    x, y, z = axis / np.linalg.norm(axis)
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    angle = np.deg2rad(degrees)
    return np.asarray(np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * cross @ cross)
