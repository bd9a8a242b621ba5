"""The paint and the light of what has none, and of who switches those of a scene off."""

from __future__ import annotations

import copy

import numpy as np

from gpusim.arrays.array_types import Float
from gpusim.optics.light.lights import AmbientLight, Light, SunLight
from gpusim.surface.paint import Plain
from gpusim.surface.surface import Surface

PAINT = Plain(0.6)

BACKDROP = 0.12
"""Radiance behind what a headlight shows."""

HEADLIGHT_WHITE = 0.85
"""Radiance that a headlight's picture shows as white."""


def headlight(axes: Float) -> list[Light]:
    """A light from over the left shoulder, and a little from everywhere; ``axes`` (3, 3): the
    image's right, down and forward."""
    x, y, z = (float(v) for v in np.array([0.2, 0.7, 1.0]) @ axes)
    return [SunLight((x, y, z), 3.0, diameter=0.0, shadows=False), AmbientLight(0.3)]


def unpainted(surface: Surface) -> Surface:
    """The same surface in one light grey."""
    result = copy.copy(surface)
    for cached in ("extents", "_found_frames"):
        result.__dict__.pop(cached, None)
    for name, value in (
        ("paint", {"neutral": PAINT}), ("frames", {}), ("region", np.zeros_like(surface.regions)),
    ):  # fmt: skip
        object.__setattr__(result, name, value)
    return result
