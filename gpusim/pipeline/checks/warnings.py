"""Warnings that a scene's geometry gives before any work: for ``gpusim plan``, and for the report.

What a measure can't do without (a camera that sees its markers) is an error, here as in a run.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gpusim.errors import GpusimError, InputError
from gpusim.pipeline.build.build import build_body
from gpusim.pipeline.build.cameras import build_camera
from gpusim.pipeline.build.props import build_prop
from gpusim.pipeline.build.scene_objects import Things
from gpusim.pipeline.build.solution_store import Solved
from gpusim.pipeline.checks.axial_loads import axial_loads
from gpusim.pipeline.checks.lamp_count import check_lamp_count
from gpusim.pipeline.checks.marker_visibility import marker_warnings
from gpusim.pipeline.checks.memory import mesh_fault
from gpusim.pipeline.checks.pattern_scale import disc_warnings
from gpusim.pipeline.checks.viewing import blind_cameras, lamps_inside
from gpusim.pipeline.notes import Notes
from gpusim.scene import Scene
from gpusim.scene.amplitudes import LoadHistory
from gpusim.scene.description import model as m
from gpusim.scene.schema.mesh import CAD_SUFFIXES

if TYPE_CHECKING:
    from gpusim.pipeline.checks.linear_theory import LinearError

__all__ = ["Doubts", "warnings_beforehand", "with_doubts"]


@dataclass
class Doubts:
    """What geometry and solution make doubtful of a scene that is run.

    ``geometry``: what is known before any work, of the things that are ``shown``, unloaded. All of
    it is kept with the results, for runs that reuse them and build nothing.
    """

    geometry: tuple[str, ...] = ()
    shown: Things | None = None
    kept: Notes | None = None

    @staticmethod
    def of(
        scene: Scene, history: LoadHistory, built: Things | None, kept: Mapping[str, Any] | None
    ) -> Doubts:
        """Those that a run has ``kept``, else of what is ``built``, or is built for it."""
        if kept is not None:
            return Doubts(kept=Notes.of(kept))
        shown = built or build_things(scene, history)
        return Doubts(() if shown is None else tuple(geometry_warnings(shown)), shown)

    def notes(self, solved: Solved | None) -> Notes:
        """Warnings, and how far linear statics is off, once the scene is ``solved``."""
        if self.kept is None:
            errors = linear_theory(self.shown, solved)
            warnings = (*self.geometry, *(error.warning for error in errors if error.warning))
            facts = {f"linear statics, {one.body}": one.fact for one in errors}
            self.kept = Notes(warnings, facts)
        return self.kept


def warnings_beforehand(scene: Scene) -> list[str]:
    """What is known before any work of ``scene``, or of its variants; builds meshes and surfaces.

    CAD files aren't meshed for it: a scene with one gives nothing. One that the free memory can't
    hold gives that. Raises InputError for a measure
    that can't work.
    """
    if not scene.variants:
        if fault := mesh_fault(scene):
            return [fault]
        things = build_things(scene, LoadHistory(scene))
        return [] if things is None else geometry_warnings(things)
    states: dict[str, list[str]] = {}
    for variant in scene.variants:
        for text in warnings_beforehand(scene.variant(variant.name)):
            states.setdefault(text, []).append(variant.name)
    every = len(scene.variants)
    return [
        text if len(names) == every else f"{', '.join(names)}: {text}"
        for text, names in states.items()
    ]


def build_things(scene: Scene, history: LoadHistory) -> Things | None:
    """Bodies and props, unloaded; None where CAD would have to be meshed."""
    if any(
        isinstance(body.mesh, m.FileMesh) and Path(body.mesh.path).suffix.lower() in CAD_SUFFIXES
        for body in scene.bodies
    ):
        return None
    bodies = [build_body(body, scene.input) for body in scene.bodies]
    return Things(scene, history, bodies, [build_prop(prop, scene.input) for prop in scene.props])


def geometry_warnings(things: Things) -> list[str]:
    """The same of things that are built, unloaded. Raises InputError likewise."""
    scene = things.scene
    surfaces = things.surfaces(None)
    cameras = [build_camera(camera, scene.input) for camera in scene.cameras]
    check_lamp_count(scene, surfaces, cameras)
    blind = blind_cameras(surfaces, cameras)
    strict = things.history.unloaded(0)  # else the first picture shows other places
    return [
        *marker_warnings(scene, things.bodies, surfaces, blind, strict),
        *blind.values(),
        *lamps_inside(scene, surfaces),
        *axial_loads(scene, things.bodies),
        *disc_warnings(surfaces, cameras),
    ]


def linear_theory(shown: Things | None, solved: Solved | None) -> list[LinearError]:
    """How far it is off, for each body of what is ``shown``."""
    if shown is None or solved is None:
        return []
    from gpusim.pipeline.checks.linear_theory import linear_errors  # loads the finite elements

    shown.solved = solved
    return linear_errors(shown)


def with_doubts(error: Exception, doubts: Sequence[str]) -> Exception:
    """The error of a measure or a picture with what was known before: most often that is why."""
    if not doubts or type(error) not in (GpusimError, InputError):
        return error
    return type(error)("\n".join([str(error), "known before:", *doubts]))
