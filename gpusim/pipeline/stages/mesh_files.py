"""Meshes for other programs: VTU, PVD and STL, by body and frame."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import numpy as np

from gpusim.arrays.array_types import Int
from gpusim.export.body_state import BodyState
from gpusim.export.field_catalogue import VTU_ARRAYS
from gpusim.export.meshes import write_pvd, write_region_stls, write_vtu
from gpusim.graph.runner import Inputs
from gpusim.graph.session import Session
from gpusim.graph.stage import StageResult
from gpusim.optics.rendering.local_origin import origin_near
from gpusim.pipeline.notes import notes_of
from gpusim.pipeline.scene_objects.moving_bodies import SceneObjects, scene_objects
from gpusim.pipeline.stages.mechanics import STRESS, Stresses
from gpusim.scene import Scene
from gpusim.scene.frames import FrameTable


def meshes(scene: Scene, inputs: Inputs, session: Session) -> StageResult:
    """What the scene asks for."""
    frames = FrameTable(inputs.row)
    objects = scene_objects(scene, inputs, [one.shown for one in frames])
    stresses = Stresses(inputs.open("stress", STRESS)) if inputs.has("stress") else None
    try:
        warnings = _write(objects, frames, stresses, inputs.new_file)
    finally:
        if stresses is not None:
            stresses.close()
    files = inputs.new_files()
    return StageResult(files, notes_of(warnings), f"{len(files)} files for other programs")


def _write(
    objects: SceneObjects,
    frames: FrameTable,
    stresses: Stresses | None,
    new_file: Callable[[str], Path],
) -> list[str]:
    """VTU per body and step with a .pvd each, STL per paint region and step; gives warnings."""
    bodies, output = objects.bodies, objects.scene.output
    origin = origin_near([parts.surface.rest for parts in bodies]) if bodies else np.zeros(3)
    # the time of a .pvd file has to grow: the load factor where it does, else the frame
    grows = all(a.factor < b.factor for a, b in pairwise(frames))
    times = [one.factor if grows else float(one.number) for one in frames]
    for index, parts in enumerate(bodies):
        name = parts.body.name
        steps: list[tuple[float, Path]] = []
        for step, time in enumerate(times):
            u = objects.displacement(index, step)
            if output.vtu:
                file = new_file(f"solution/{name}-{step:04d}.vtu")
                known = stresses.of(index, step, parts) if stresses else {}
                state = BodyState(parts.mesh, u, known=known)
                arrays = {name: one.of(state) for name, one in VTU_ARRAYS.items()}
                of_points, of_cells = (
                    {name: values for name, values in arrays.items()
                     if values is not None and VTU_ARRAYS[name].place == place}
                    for place in ("nodes", "elements")
                )  # fmt: skip
                write_vtu(
                    file, parts.mesh.points, parts.mesh.cells, point_data=of_points,
                    cell_data=of_cells,
                )  # fmt: skip
                steps.append((time, file))
            if output.stl:
                surface = parts.surface
                write_region_stls(
                    new_file(f"stl/{name}/-" if len(bodies) > 1 else "stl/-").parent,
                    surface.rest + parts.skin.at_vertices(u),
                    _with_triangles(surface.faces),
                    surface.regions,
                    list(surface.paints),
                    step=step,
                    origin=origin,
                )
        if steps:
            write_pvd(new_file(f"solution/{name}.pvd"), steps)
    if not (output.stl and origin.any()):
        return []
    place = ", ".join(f"{value:.10g}" for value in origin)
    return [f"STL files: coordinates are relative to ({place}) m, as their headers say: "
            "float32 would not hold them so far from zero"]  # fmt: skip


def _with_triangles(faces: Int) -> Int:
    """Quads, a triangle's missing corner repeated."""
    result = faces.copy()
    result[:, 3] = np.where(faces[:, 3] < 0, faces[:, 2], faces[:, 3])
    return result
