"""Lights as `gpusim.scene.description.model` has them: SI, angles in rad."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["Ambient", "Area", "Environment", "Light", "Point", "Spot", "Sun"]

Vec3 = tuple[float, float, float]


@dataclass(frozen=True)
class Point:
    """A lamp of radiant flux ``power`` (W) that shines evenly."""

    name: str
    position: Vec3
    power: float
    shadows: bool


@dataclass(frozen=True)
class Spot:
    """A small lamp with a beam of full angle ``cone``, fading over a share ``penumbra`` of it."""

    name: str
    position: Vec3
    target: Vec3
    power: float
    cone: float
    penumbra: float
    shadows: bool


@dataclass(frozen=True)
class Area:
    """A lamp of ``size`` (m), a "rectangle" or an "ellipse"."""

    name: str
    position: Vec3
    target: Vec3
    size: tuple[float, float]
    power: float
    shape: str
    shadows: bool


@dataclass(frozen=True)
class Sun:
    """``irradiance`` (W/m2) along ``direction``; it looks ``diameter`` large."""

    name: str
    direction: Vec3
    irradiance: float
    diameter: float
    shadows: bool


@dataclass(frozen=True)
class Ambient:
    """One ``radiance`` (W / (m2 sr)) from everywhere; surfaces hide it if ``occlusion``."""

    name: str
    radiance: float
    occlusion: bool


@dataclass(frozen=True)
class Environment:
    """Radiance of the ``sky`` and of the ``ground`` (W / (m2 sr)), or a picture of it all.

    ``path`` (absolute) of an equirectangular picture whose middle looks ``forward``; ``scale`` is
    the radiance of its value 1. Surfaces hide it if ``occlusion``.
    """

    name: str
    sky: float
    ground: float
    up: Vec3
    occlusion: bool
    path: str = ""
    scale: float = 1.0
    forward: Vec3 | None = None


Light = Point | Spot | Area | Sun | Ambient | Environment
