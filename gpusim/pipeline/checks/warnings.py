"""Warnings that a scene's geometry gives before any work: for ``gpusim plan``, and for the report.

What a measure can't do without (a camera that sees its markers) is an error, here as in a run.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gpusim.errors import GpusimError, InputError
from gpusim.optics.camera.pinhole import Camera
from gpusim.optics.geometry.view import look
from gpusim.optics.light.lights import PointLight, SpotLight
from gpusim.optics.light.quadrature import MOST_ACROSS
from gpusim.optics.shading.lighting import MAX_EMITTERS, emitting_points
from gpusim.pipeline.checks.measurability import disc_warnings
from gpusim.pipeline.checks.resources import mesh_fault
from gpusim.pipeline.measurements.kinds import Unloaded, kind_of
from gpusim.pipeline.pictures.framing import board_warnings
from gpusim.pipeline.pictures.visibility import blind_cameras, lamps_inside
from gpusim.pipeline.scene_objects.cameras import build_camera
from gpusim.pipeline.scene_objects.lights import build_lights
from gpusim.pipeline.scene_objects.modelling import build_model
from gpusim.pipeline.scene_objects.moving_bodies import SceneObjects
from gpusim.pipeline.scene_objects.surfaces import build_body, build_prop, counts_of
from gpusim.plan.scene_stages import scene_stages
from gpusim.plan.stages import RunOptions
from gpusim.scene import Scene
from gpusim.scene.amplitudes import load_groups
from gpusim.scene.cost import Counts
from gpusim.scene.description import model as m
from gpusim.scene.frames import frame_table
from gpusim.surface import Surface

NAMED = 6


def check_lamp_count(scene: Scene, surfaces: Sequence[Surface], cameras: Sequence[Camera]) -> None:
    """Raises InputError naming the camera whose pictures the lamps are too many for.

    Large lamps near what is seen count as several points, as in the picture.
    """
    lights = build_lights(scene) or []
    small = sum(isinstance(light, PointLight | SpotLight) for light in lights)
    if small + MOST_ACROSS**2 * (len(lights) - small) <= MAX_EMITTERS:
        return
    lamps = [
        one for one in scene.lights if not isinstance(one, m.AmbientTable | m.EnvironmentTable)
    ]
    names = [one.name for one in sorted(lamps, key=lambda lamp: not lamp.shadows)]  # `lamps_of`
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


def scene_warnings(scene: Scene, made: Counts | None = None) -> list[str]:
    """What is known before any work of ``scene``, or of its variants; builds meshes and surfaces.
    ``made`` gets the sizes of the meshes.

    A scene that the free memory can't hold gives that. Raises InputError for what a run would end
    with before it solves: a measure that can't work, a place where a body has nothing.
    """
    if not scene.variants:
        if fault := mesh_fault(scene):
            return [fault]
        objects = build_objects(scene)
        if made is not None:
            made |= counts_of(objects.bodies)
        return geometry_warnings(objects)
    states: dict[str, list[str]] = {}
    for variant in scene.variants:
        for text in scene_warnings(scene.variant(variant.name), made):
            states.setdefault(text, []).append(variant.name)
    every = len(scene.variants)
    return [
        text if len(names) == every else f"{', '.join(names)}: {text}"
        for text, names in states.items()
    ]


def build_objects(scene: Scene) -> SceneObjects:
    """Bodies and props, unloaded. Raises InputError, also where a body's model can't be built."""
    bodies = [build_body(body, scene.input) for body in scene.bodies]
    stages = {one.name for one in scene_stages(scene, RunOptions("numpy")).stages}
    for parts in bodies:
        if f"model/{parts.body.name}" in stages:
            groups = load_groups(parts.body, scene.analysis.load_factors)
            build_model(parts, groups, may_be_free=scene.analysis.vibrates)
    props = [build_prop(prop, scene.input) for prop in scene.props]
    board = scene.calibration.board if scene.calibration is not None else ""
    shown = [instant.shown for instant in frame_table(scene)]
    return SceneObjects(scene, shown, bodies, props=props, board=board)


def geometry_warnings(objects: SceneObjects) -> list[str]:
    """The same of things that are built, unloaded. Raises InputError likewise."""
    scene = objects.scene
    surfaces = objects.surfaces(None)
    cameras = [build_camera(camera, scene.input) for camera in scene.cameras]
    check_lamp_count(scene, surfaces, cameras)
    blind = blind_cameras(surfaces, cameras)
    strict = objects.frames[0].unloaded  # else the first picture shows other places
    unloaded = Unloaded(objects.bodies, surfaces, blind, strict)
    return [
        *(text for spec in scene.measures for text in kind_of(spec).checks(spec, scene, unloaded)),
        *blind.values(),
        *board_warnings(objects, cameras),
        *lamps_inside(scene, surfaces),
        *disc_warnings(surfaces, cameras),
    ]


def with_known_warnings(error: Exception, known: Sequence[str]) -> Exception:
    """The error of a measure or a picture with what was known before: most often that is why."""
    if not known or type(error) not in (GpusimError, InputError):
        return error
    return type(error)("\n".join([str(error), "known before:", *known]))
