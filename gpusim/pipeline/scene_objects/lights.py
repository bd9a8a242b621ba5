"""Lights of a scene as the optics take them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from gpusim.files.input_file import Reader
from gpusim.optics.light.blackbody import blackbody
from gpusim.optics.light.flicker import Flicker
from gpusim.optics.light.lights import (
    AmbientLight,
    AreaLight,
    EnvironmentLight,
    Light,
    PointLight,
    SpotLight,
    SunLight,
)
from gpusim.optics.light.studio import studio
from gpusim.pipeline.scene_objects.arguments import arguments_of
from gpusim.scene import Scene
from gpusim.scene.description import model as m

LAMPS: dict[type, Callable[..., Light]] = {
    m.PointTable: PointLight,
    m.SpotTable: SpotLight,
    m.AreaTable: AreaLight,
    m.SunTable: SunLight,
    m.AmbientTable: AmbientLight,
}


def build_lights(scene: Scene, time: float | None = None) -> list[Light] | None:
    """The lights, or None for a scene without: it then shows albedo. They flicker by a clock that
    starts at a ``time`` (s) of the scene; None: they are steady."""
    return [_looking(light, scene.input, time) for light in scene.lights] or None


def _looking(light: m.Light, read: Reader, time: float | None) -> Light:
    """With its colour and its flicker."""
    kelvin, flicker = light.temperature_K, None
    if light.flicker is not None and time is not None:
        flicker = Flicker(**arguments_of(Flicker, light.flicker)).later(time)
    tint = light.color if kelvin is None else blackbody(kelvin)
    made = replace(_light(light, read), flicker=flicker)
    return made if tint is None else replace(made, color=tint)


def _light(light: m.Light, read: Reader) -> Light:
    if isinstance(light, m.EnvironmentTable):
        return _surroundings(light, read)
    kind = LAMPS[type(light)]
    return kind(**arguments_of(kind, light))


def _surroundings(light: m.EnvironmentTable, read: Reader) -> EnvironmentLight:
    along_y = abs(light.up[1]) > 0.999999 * float(np.linalg.norm(light.up))
    forward = light.forward or ((1.0, 0.0, 0.0) if along_y else (0.0, 1.0, 0.0))
    make = EnvironmentLight.read if light.path else EnvironmentLight
    values = {**arguments_of(make, light), "forward": forward}
    if light.path:
        return EnvironmentLight.read(**{**values, "path": read(light.path)})
    if light.studio:
        values["image"] = light.studio * studio()
    return EnvironmentLight(**values)
