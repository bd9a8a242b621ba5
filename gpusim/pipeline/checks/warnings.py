"""Warnings that a scene's geometry gives before any work: for ``gpusim plan``, and for the report.

What a measure can't do without (a camera that sees its markers) is an error, here as in a run.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from gpusim.errors import GpusimError, InputError
from gpusim.optics.camera.pinhole import Camera
from gpusim.optics.geometry.view import look
from gpusim.optics.light.lights import PointLight, SpotLight
from gpusim.optics.light.quadrature import MOST_ACROSS
from gpusim.optics.shading.lighting import MAX_EMITTERS, emitting_points
from gpusim.pipeline.build.cameras import build_camera
from gpusim.pipeline.build.lights import build_lights
from gpusim.pipeline.build.scene_objects import SceneObjects, SceneSolution
from gpusim.pipeline.build.surfaces import build_body, build_prop
from gpusim.pipeline.checks.measurability import axial_loads, disc_warnings, marker_warnings
from gpusim.pipeline.checks.resources import mesh_fault
from gpusim.pipeline.checks.visibility import blind_cameras, lamps_inside
from gpusim.pipeline.notes import Notes
from gpusim.scene import Scene
from gpusim.scene.amplitudes import LoadHistory
from gpusim.scene.description import model as m
from gpusim.scene.description.mesh import CAD_SUFFIXES
from gpusim.surface import Surface

if TYPE_CHECKING:
    from gpusim.pipeline.checks.linear_theory import LinearError

__all__ = ["SceneWarnings", "scene_warnings", "with_known_warnings"]

NAMED = 6


def check_lamp_count(scene: Scene, surfaces: Sequence[Surface], cameras: Sequence[Camera]) -> None:
    """Raises InputError naming the camera whose pictures the lamps are too many for.

    Large lamps near what is seen count as several points, as in the picture.
    """
    lights = build_lights(scene) or []
    small = sum(isinstance(light, PointLight | SpotLight) for light in lights)
    if small + MOST_ACROSS**2 * (len(lights) - small) <= MAX_EMITTERS:
        return
    lamps = [one for one in scene.lights if not isinstance(one, m.Ambient | m.Environment)]
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


@dataclass
class SceneWarnings:
    """What geometry and solution make doubtful of a scene that is run.

    ``geometry``: what is known before any work, of the things that are ``shown``, unloaded. All of
    it is kept with the results, for runs that reuse them and build nothing.
    """

    geometry: tuple[str, ...] = ()
    shown: SceneObjects | None = None
    kept: Notes | None = None

    @staticmethod
    def of(
        scene: Scene,
        history: LoadHistory,
        built: SceneObjects | None,
        kept: Mapping[str, Any] | None,
    ) -> SceneWarnings:
        """Those that a run has ``kept``, else of what is ``built``, or is built for it."""
        if kept is not None:
            return SceneWarnings(kept=Notes.of(kept))
        shown = built or build_objects(scene, history)
        return SceneWarnings(() if shown is None else tuple(geometry_warnings(shown)), shown)

    def notes(self, solved: SceneSolution | None) -> Notes:
        """Warnings, and how far linear statics is off, once the scene is ``solved``."""
        if self.kept is None:
            errors = linear_theory(self.shown, solved)
            warnings = (*self.geometry, *(error.warning for error in errors if error.warning))
            facts = {f"linear statics, {one.body}": one.fact for one in errors}
            self.kept = Notes(warnings, facts)
        return self.kept


def scene_warnings(scene: Scene) -> list[str]:
    """What is known before any work of ``scene``, or of its variants; builds meshes and surfaces.

    CAD files aren't meshed for it: a scene with one gives nothing. One that the free memory can't
    hold gives that. Raises InputError for a measure
    that can't work.
    """
    if not scene.variants:
        if fault := mesh_fault(scene):
            return [fault]
        objects = build_objects(scene, LoadHistory(scene))
        return [] if objects is None else geometry_warnings(objects)
    states: dict[str, list[str]] = {}
    for variant in scene.variants:
        for text in scene_warnings(scene.variant(variant.name)):
            states.setdefault(text, []).append(variant.name)
    every = len(scene.variants)
    return [
        text if len(names) == every else f"{', '.join(names)}: {text}"
        for text, names in states.items()
    ]


def build_objects(scene: Scene, history: LoadHistory) -> SceneObjects | None:
    """Bodies and props, unloaded; None where CAD would have to be meshed."""
    if any(
        isinstance(body.mesh, m.FileMesh) and Path(body.mesh.path).suffix.lower() in CAD_SUFFIXES
        for body in scene.bodies
    ):
        return None
    bodies = [build_body(body, scene.input) for body in scene.bodies]
    return SceneObjects(
        scene, history, bodies, [build_prop(prop, scene.input) for prop in scene.props]
    )


def geometry_warnings(objects: SceneObjects) -> list[str]:
    """The same of things that are built, unloaded. Raises InputError likewise."""
    scene = objects.scene
    surfaces = objects.surfaces(None)
    cameras = [build_camera(camera, scene.input) for camera in scene.cameras]
    check_lamp_count(scene, surfaces, cameras)
    blind = blind_cameras(surfaces, cameras)
    strict = objects.history.unloaded(0)  # else the first picture shows other places
    return [
        *marker_warnings(scene, objects.bodies, surfaces, blind, strict),
        *blind.values(),
        *lamps_inside(scene, surfaces),
        *axial_loads(scene, objects.bodies),
        *disc_warnings(surfaces, cameras),
    ]


def linear_theory(shown: SceneObjects | None, solved: SceneSolution | None) -> list[LinearError]:
    """How far it is off, for each body of what is ``shown``."""
    if shown is None or solved is None:
        return []
    from gpusim.pipeline.checks.linear_theory import linear_errors  # loads the finite elements

    shown.solved = solved
    return linear_errors(shown)


def with_known_warnings(error: Exception, known: Sequence[str]) -> Exception:
    """The error of a measure or a picture with what was known before: most often that is why."""
    if not known or type(error) not in (GpusimError, InputError):
        return error
    return type(error)("\n".join([str(error), "known before:", *known]))
