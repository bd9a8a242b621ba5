"""Whether a scene has more lamps than a picture can be lit by: known before any work."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gpusim.errors import InputError
from gpusim.optics.camera.pinhole import Camera
from gpusim.optics.geometry.view import look
from gpusim.optics.light.lights import PointLight, SpotLight
from gpusim.optics.light.quadrature import MOST_ACROSS
from gpusim.optics.shading.lighting import MAX_EMITTERS, emitting_points
from gpusim.pipeline.build.build import build_lights
from gpusim.scene import Scene
from gpusim.scene.description import model as m
from gpusim.surface import Surface

__all__ = ["check_lamp_count"]

NAMED = 6


def check_lamp_count(scene: Scene, surfaces: Sequence[Surface], cameras: Sequence[Camera]) -> None:
    """Raises InputError naming the camera whose pictures the lamps are too many for.

    Large lamps near what is seen count as several points, as in the picture.
    """
    lights = build_lights(scene) or []
    small = sum(isinstance(light, PointLight | SpotLight) for light in lights)
    if small + MOST_ACROSS**2 * (len(lights) - small) <= MAX_EMITTERS:
        return
    names = [one.name for one in scene.lights if not isinstance(one, m.Ambient | m.Environment)]
    for camera in cameras:
        rows = emitting_points(look(surfaces, camera, lit=False), lights)
        if len(rows) <= MAX_EMITTERS:
            continue
        counts = np.bincount(rows[:, 11].astype(int), minlength=len(names))
        several = [
            f"{names[k]!r} as {counts[k]}" for k in np.argsort(-counts, kind="stable")[:NAMED]
            if counts[k] > 1
        ]  # fmt: skip
        large = f" (large lamps count as several points: {', '.join(several)})" if several else ""
        raise InputError(
            f"light: got {len(names)} lamps, which are {len(rows)} emitting points for camera "
            f"{camera.name!r}{large}; expected at most {MAX_EMITTERS}: use fewer lamps, or "
            "smaller ones farther away"
        )
