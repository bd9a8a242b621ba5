"""Lights of a scene as the optics take them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gpusim.files.input_file import Reader
from gpusim.optics.light.blackbody import blackbody
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
from gpusim.scene import Scene
from gpusim.scene.description import model as m


def build_lights(scene: Scene) -> list[Light] | None:
    """The lights, or None for a scene without: it then shows albedo."""
    return [_tinted(light, scene.input) for light in scene.lights] or None


def _tinted(light: m.Light, read: Reader) -> Light:
    kelvin, made = light.temperature_K, _light(light, read)
    tint = light.color if kelvin is None else blackbody(kelvin)
    return made if tint is None else replace(made, color=tint)


def _light(light: m.Light, read: Reader) -> Light:
    if isinstance(light, m.AmbientTable):
        return AmbientLight(light.radiance, light.occlusion)
    if isinstance(light, m.EnvironmentTable):
        along_y = abs(light.up[1]) > 0.999999 * float(np.linalg.norm(light.up))
        forward = light.forward or ((1.0, 0.0, 0.0) if along_y else (0.0, 1.0, 0.0))
        if light.path:
            return EnvironmentLight.read(
                read(light.path), scale=light.scale, up=light.up, forward=forward,
                occlusion=light.occlusion, channels=light.channels,
            )  # fmt: skip
        if light.studio:
            return EnvironmentLight(
                image=light.studio * studio(), up=light.up, forward=forward,
                occlusion=light.occlusion,
            )  # fmt: skip
        return EnvironmentLight(
            light.sky, light.ground, up=light.up, forward=forward, occlusion=light.occlusion
        )
    if isinstance(light, m.PointTable):
        return PointLight(light.position, light.power, light.shadows)
    if isinstance(light, m.SpotTable):
        return SpotLight(
            light.position, light.target, light.power, light.cone, light.penumbra, light.shadows
        )
    if isinstance(light, m.AreaTable):
        return AreaLight(
            light.position, light.target, light.size, light.power, light.shape, light.shadows
        )
    return SunLight(light.direction, light.irradiance, light.diameter, light.shadows)
