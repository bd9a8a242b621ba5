"""Meshes of a run for other programs: VTU and PVD, STL."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np
import numpy.typing as npt

from gpusim.export.meshes import write_pvd, write_region_stls, write_vtu
from gpusim.files.output_folder import inside
from gpusim.optics.rendering.local_origin import origin_near
from gpusim.pipeline.build.build import BodyParts
from gpusim.pipeline.stages.stresses import Stresses
from gpusim.scene import Scene

__all__ = ["write_meshes"]

Array = npt.NDArray[np.float64]
Displacement = Callable[[int, int], Array]


def write_meshes(
    scene: Scene,
    out: Path,
    bodies: Sequence[BodyParts],
    displacement: Displacement,
    stresses: Stresses | None,
) -> tuple[list[Path], list[str]]:
    """VTU per body and step with a .pvd each, STL per paint region and step; and warnings."""
    files: list[Path] = []
    origin = origin_near([parts.surface.rest for parts in bodies]) if bodies else np.zeros(3)
    factors = scene.analysis.load_factors
    # the time of a .pvd file has to grow: the load factor where it does, else the frame
    grows = all(a < b for a, b in pairwise(factors))
    times = factors if grows else tuple(float(frame) for frame in range(len(factors)))
    for index, parts in enumerate(bodies):
        name = parts.body.name
        steps: list[tuple[float, Path]] = []
        for step, time in enumerate(times):
            u = displacement(index, step)
            if scene.output.vtu:
                file = inside(out, "solution", f"{name}-{step:04d}.vtu")
                of_points, of_cells = (
                    stresses.fields(index, step, parts) if stresses is not None else ({}, {})
                )
                write_vtu(
                    file, parts.mesh.points, parts.mesh.cells, point_data={"u": u, **of_points},
                    cell_data=of_cells,
                )  # fmt: skip
                steps.append((time, file))
            if scene.output.stl:
                surface = parts.surface
                folder = inside(out, "stl", *([name] if len(bodies) > 1 else []))
                files += write_region_stls(
                    folder,
                    surface.rest + parts.skin.at_vertices(u),
                    _with_triangles(surface.faces),
                    surface.regions,
                    list(surface.paints),
                    step=step,
                    origin=origin,
                )
        files += [file for _, file in steps]
        if steps:
            files.append(write_pvd(inside(out, "solution", f"{name}.pvd"), steps))
    if not (scene.output.stl and origin.any()):
        return files, []
    place = ", ".join(f"{value:.10g}" for value in origin)
    return files, [f"STL files: coordinates are relative to ({place}) m, as their headers say: "
                   "float32 would not hold them so far from zero"]  # fmt: skip


def _with_triangles(faces: npt.NDArray[np.int32]) -> npt.NDArray[np.int32]:
    """Quads, a triangle's missing corner repeated."""
    result = faces.copy()
    result[:, 3] = np.where(faces[:, 3] < 0, faces[:, 2], faces[:, 3])
    return result
