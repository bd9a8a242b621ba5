"""Results for other programs: truth.h5 of what every pixel sees, meshes as VTU, PVD and STL."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np
import numpy.typing as npt

from gpusim._version import __version__
from gpusim.export.meshes import write_pvd, write_region_stls, write_vtu
from gpusim.export.truth import TruthWriter
from gpusim.files.output_folder import inside
from gpusim.optics.frame import Frame
from gpusim.optics.rendering.local_origin import origin_near
from gpusim.optics.truth import Truth, seen_in
from gpusim.pipeline.build.cameras import build_camera
from gpusim.pipeline.build.scene_objects import frame_word
from gpusim.pipeline.build.surfaces import BodyParts
from gpusim.pipeline.stages.images import FrameCapture
from gpusim.pipeline.stages.mechanics import Stresses
from gpusim.scene import Scene
from gpusim.scene.amplitudes import LoadHistory

__all__ = ["write_meshes", "write_truth"]

Array = npt.NDArray[np.float64]
Displacement = Callable[[int, int], Array]


def write_truth(
    scene: Scene,
    out: Path,
    capture: FrameCapture,
    bodies: Sequence[BodyParts],
    displacement: Displacement,
) -> Path:
    """truth.h5: the layers that the scene asks for, at every pixel that sees a body."""
    path = inside(out, "truth.h5")
    word = frame_word(scene)
    history = LoadHistory(scene)
    regions = [f"{parts.body.name}/{name}" for parts in bodies for name in parts.surface.paints]
    cells = _cell_of_face(bodies)
    wanted = scene.output.truth
    attributes = {
        "version": __version__,
        "scene": scene.name,
        "pixels": "those that see a body",
        "cameras": ", ".join(spec.name for spec in scene.cameras),
    }
    with TruthWriter(path, regions=regions, attributes=attributes) as file:
        if bodies:
            _write_nodes(file, scene, bodies, displacement)
        for spec in scene.cameras:
            camera = build_camera(spec, scene.input)
            file.write_camera(
                spec.name,
                width=camera.width,
                height=camera.height,
                K=camera.K,
                camera_from_world=camera.camera_from_world,
                distortion=() if camera.distortion is None else camera.distortion,
            )
        rest = {spec.name: capture.sight(spec, None, len(bodies)) for spec in scene.cameras}
        for number, factor in enumerate(scene.analysis.load_factors):
            now = rest
            if not history.still(number):
                now = {
                    spec.name: capture.sight(spec, number, len(bodies)) for spec in scene.cameras
                }
            for spec in scene.cameras:
                frame = file.frame(spec.name, number, **{word: factor})
                sight, window = now[spec.name]
                others = [other for other, _ in now.values()]
                before = None if now is rest else rest[spec.name][0]
                for truth in sight.truth_bands(faces=(0, len(cells))):
                    if not len(truth.row):
                        continue
                    place = truth.row + window.top, truth.column + window.left
                    for layer in wanted:
                        values = _values(layer, truth, before, others, cells)
                        frame.write_sparse(layer, *place, values)
                if "cameras" not in wanted and now is not rest:
                    del now[spec.name]  # its ids are needed no longer
    return path


def _values(
    layer: str,
    truth: Truth,
    before: Frame | None,
    others: Sequence[Frame],
    cells: npt.NDArray[np.int64],
) -> npt.NDArray[np.generic]:
    """A layer at the pixels of a band; ``before``: the frame at rest, None if this is that one."""
    if layer == "element":
        return cells[truth.face]
    if layer == "visibility":
        if before is None:
            return np.ones(len(truth.row), np.int8)
        return seen_in(before.view, before.ids(), truth.reference).astype(np.int8)
    if layer == "cameras":
        points = truth.reference + truth.displacement
        bits = np.zeros(len(points), np.int32)
        for number, other in enumerate(others):
            bits |= seen_in(other.view, other.ids(), points).astype(np.int32) << number
        return bits
    return np.asarray(getattr(truth, layer))


def _cell_of_face(bodies: Sequence[BodyParts]) -> npt.NDArray[np.int64]:
    """The element, counted over all bodies, of every face of the bodies' surfaces."""
    first = np.cumsum([0, *(parts.mesh.cell_count for parts in bodies)])
    parts = [body.skin.cell_of_piece + start for body, start in zip(bodies, first, strict=False)]
    return np.concatenate(parts or [np.zeros(0, np.int64)])


def _write_nodes(
    file: TruthWriter, scene: Scene, bodies: Sequence[BodyParts], displacement: Displacement
) -> None:
    """Mesh and nodal displacement, bodies one after the other as in the layer ``element``."""
    first_node = np.cumsum([0, *(parts.mesh.node_count for parts in bodies)])
    cells: dict[str, list[npt.NDArray[np.int32]]] = {}
    for parts, first in zip(bodies, first_node, strict=False):
        for kind, block in parts.mesh.cells.items():
            cells.setdefault(kind, []).append(block + np.int32(first))
    points = np.concatenate([parts.mesh.points for parts in bodies])
    file.write_mesh(points, {kind: np.concatenate(blocks) for kind, blocks in cells.items()})
    for step, factor in enumerate(scene.analysis.load_factors):
        u = np.concatenate([displacement(body, step) for body in range(len(bodies))])
        file.write_nodal_displacement(step, u, **{frame_word(scene): factor})


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
