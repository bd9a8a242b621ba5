"""Bodies and props of a scene: meshed, painted, and what a report says of the meshes."""

from __future__ import annotations

from dataclasses import asdict

from gpusim.graph.runner import Inputs
from gpusim.graph.session import Session
from gpusim.graph.stage import StageResult
from gpusim.pipeline.notes import Notes
from gpusim.pipeline.scene_objects.meshing import mesh_summary, size_warnings_of
from gpusim.pipeline.scene_objects.surfaces import (
    BodyParts,
    MeshedBody,
    build_prop,
    mesh_body,
    paint_body,
)
from gpusim.scene import Scene
from gpusim.surface import Surface


def mesh(scene: Scene, inputs: Inputs, session: Session) -> MeshedBody:
    """A body's mesh and its skin."""
    (body,) = scene.bodies
    return mesh_body(body, scene.input)


def surface(scene: Scene, inputs: Inputs, session: Session) -> BodyParts:
    """A body's skin, painted."""
    (body,) = scene.bodies
    return paint_body(body, inputs[f"mesh/{body.name}"], scene.input)


def props(scene: Scene, inputs: Inputs, session: Session) -> list[Surface]:
    """Every prop as it is described."""
    return [build_prop(prop, scene.input) for prop in scene.props]


def mesh_notes(scene: Scene, inputs: Inputs, session: Session) -> StageResult:
    """What the meshes are like."""
    summaries, warnings = [], []
    for body in scene.bodies:
        grid = inputs[f"mesh/{body.name}"].mesh
        summary, texts = mesh_summary(body.name, grid)
        summaries.append(summary)
        warnings += [*texts, *size_warnings_of(body.name, body.mesh, grid)]
    return StageResult(notes=asdict(Notes(tuple(warnings), meshes=tuple(summaries))))
