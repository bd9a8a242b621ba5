"""Bitmaps and targets of a scene, and how patterns lie on curved faces; in SI."""

from __future__ import annotations

from dataclasses import dataclass

from .finish import MATTE, Finish
from .loads import Vec3, Where

__all__ = ["Picture", "Target", "Wrap"]


@dataclass(frozen=True)
class Wrap:
    """How a pattern lies on faces that aren't plane: round an axis, or unfolded if that is None."""

    axis_point: Vec3 | None = None
    axis: Vec3 | None = None


@dataclass(frozen=True)
class Picture:
    """A bitmap with texels of side ``texel`` (m); ``origin`` is its lower left corner.

    ``finish``: how it shines, here and below.
    """

    name: str
    where: Where
    albedo: float
    up: Vec3 | None
    path: str
    texel: float
    origin: Vec3
    dark: float
    light: float
    gamma: str
    wrap: Wrap | None = None
    finish: Finish = MATTE


@dataclass(frozen=True)
class Target:
    """A target of ``kind`` "circles", "star", "aruco", "charuco", "ring_codes" or "lines".

    ``places`` (m): the centres, or the one lower left corner. ``values``: parameters of the class
    of that name in `gpusim.surface.paint`, lengths in m.
    """

    name: str
    where: Where
    albedo: float
    up: Vec3 | None
    kind: str
    places: tuple[Vec3, ...]
    values: tuple[tuple[str, float | int | str | tuple[float, ...]], ...]
    wrap: Wrap | None = None
    finish: Finish = MATTE
