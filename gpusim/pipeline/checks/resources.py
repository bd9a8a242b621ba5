"""What a run needs of the machine, asked before any work: files, folders, memory."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

from gpusim.errors import InputError
from gpusim.field import Field
from gpusim.files.output_folder import check_below, inside
from gpusim.graph.folder import INNER
from gpusim.parallel.machine import host_memory
from gpusim.pipeline.scene_objects.cameras import build_camera, build_lens
from gpusim.pipeline.scene_objects.lights import build_lights
from gpusim.pipeline.scene_objects.meshing import (
    build_mesh,
    read_given_field,
    size_warnings_of,
    waits_for_gmsh,
)
from gpusim.pipeline.scene_objects.vibrations import ground_of
from gpusim.plan.plan import Plan
from gpusim.plan.vibration_stages import opening
from gpusim.scene import Scene
from gpusim.scene.cost import element_counts
from gpusim.scene.description import model as m
from gpusim.surface.paint import Image

_QUICK = 50_000_000  # bytes of a mesh file that a plan reads, in a second or two


def check_files(scene: Scene) -> list[str]:
    """Read the mesh, calibration, result and picture files of ``scene``, and of its variants.

    CAD files and large meshes are read by the stage that meshes, before a run writes anything.
    Returns what is implausible in the size of what the mesh files hold.

    Raises
    ------
    InputError
        All that is wrong: a file that can't be read or doesn't fit, a lens that folds inside the
        image, a frame's time outside of a field, a displacement that isn't finite.
    """
    problems: dict[str, None] = {}
    warnings: list[str] = []
    for check in (check for state in _states(scene) for check in _checks(state, warnings)):
        try:
            check()
        except InputError as error:
            problems[str(error)] = None
    if problems:
        raise InputError("\n".join(problems))
    return list(dict.fromkeys(warnings))


def _states(scene: Scene) -> list[Scene]:
    return [scene.variant(variant.name) for variant in scene.variants] or [scene]


def _checks(scene: Scene, warnings: list[str]) -> Iterator[Callable[[], object]]:
    for camera in scene.cameras:
        yield partial(build_camera, camera, scene.input)
        if camera.lens is not None and camera.calibration:
            yield partial(build_lens, camera, scene.input)
    for body in scene.bodies:
        if isinstance(body.mesh, m.FieldMeshTable):
            yield partial(_check_field, body.mesh, body.name, scene, warnings)
        elif isinstance(body.mesh, m.FileMeshTable) and body.mesh.size is None:
            if Path(body.mesh.path).stat().st_size <= _QUICK:
                yield partial(_check_size, body, scene, warnings)
    for thing in (*scene.bodies, *scene.props):
        for paint in thing.paints:
            if isinstance(paint, m.PictureTable):
                yield partial(_read_picture, paint, scene)
    yield partial(build_lights, scene)
    yield partial(_check_ground, scene)


def waits_for_cad(scene: Scene) -> bool:
    """Whether a body of ``scene``, in any variant, is a CAD part that is still to be meshed."""
    return any(
        waits_for_gmsh(body.mesh, state.input) for state in _states(scene) for body in state.bodies
    )


def _check_size(body: m.Body, scene: Scene, warnings: list[str]) -> None:
    warnings += size_warnings_of(body.name, body.mesh, build_mesh(body.mesh, scene.input))


def check_views(scene: Scene) -> None:
    """Make every camera, lens and light once, and read how the ground moves. Raises InputError for
    what is wrong in them."""
    for camera in scene.cameras:
        build_camera(camera, scene.input)
        build_lens(camera, scene.input)
    build_lights(scene)
    _check_ground(scene)


def _read_picture(paint: m.PictureTable, scene: Scene) -> None:
    if paint.path is not None:
        Image.read(
            scene.input(paint.path), paint.texel or 1.0, gamma=paint.gamma, channels=paint.channels
        )


def _check_ground(scene: Scene) -> None:
    """The record of a moving ground is one, and reaches as far as cameras look."""
    table, ground = scene.analysis, ground_of(scene)
    if isinstance(table, m.TransientTable) and table.base_motion and ground:
        end = table.frame_values[-1] + opening(scene)
        ground.within(0.0, end, f"{table.base_motion.path}: analysis.base_motion")


def _check_field(mesh: m.FieldMeshTable, name: str, scene: Scene, warnings: list[str]) -> None:
    field = read_given_field(mesh, scene.input)
    check_field(field, scene.analysis.frame_values)
    warnings += size_warnings_of(name, mesh, field.mesh)


def check_field(field: Field, times: tuple[float, ...]) -> None:
    """Read every step that the frames at ``times`` lie between. Raises InputError for a time
    beyond them, or values that aren't finite."""
    for time in times:
        field.check(time)
    for time in times:
        field.at(time)


_FILES = ("report.html", "report.json", "scene.toml", "truth.h5")
_FOLDERS = (
    INNER, "budget", "calibration", "explain", "fields", "figures", "images", "measure", "solution",
    "stl", "variants",
)  # fmt: skip


def check_folders(scene: Scene, out: Path) -> None:
    """Raises InputError naming the first thing in ``out`` that has the name of a folder or file
    that the run writes, but is something else, leads elsewhere or can't be written."""
    check_below(out, *_FOLDERS)
    for root in (out, *(inside(out, "variants", variant.name) for variant in scene.variants)):
        check_below(root, *(f"images/{camera.name}" for camera in scene.cameras), *_FOLDERS)
        for name in _FILES:
            if inside(root, name).is_dir():
                raise InputError(f"{root / name}: is a folder; expected a file, or nothing")


_DOUBT = 2.0  # the plan's estimates may be this far off
_LEAST = 256_000_000  # bytes that libraries map besides; OpenBLAS can hang with less
_BUILT = 600  # bytes per node of a mesh, its faces and its surface while they are made


def check_memory(plan: Plan) -> None:
    """Raises InputError naming the first stage that can't fit the free memory."""
    if fault := memory_fault(plan):
        raise InputError(fault)


def memory_fault(plan: Plan) -> str:
    """The same as a sentence; "" for a plan that fits."""
    free = host_memory()
    if free < _LEAST:
        return (
            f"memory: got {free / 1e6:.0f} MB free (of the machine, the container or ulimit -v); "
            f"expected at least {_LEAST / 1e6:.0f} MB"
        )
    for stage in plan.stages:
        if not stage.memory_bytes <= _DOUBT * free:
            return (
                f"{stage.name}: needs about {stage.memory_bytes / 1e9:.3g} GB of memory "
                f"({stage.detail}); got {free / 1e9:.3g} GB free; expected a smaller scene"
            )
    return ""


def mesh_fault(scene: Scene) -> str:
    """Why the meshes and surfaces of ``scene`` can't be built to look at; "" if they fit."""
    free = host_memory()
    nodes = sum(element_counts(body.mesh)[0] for body in scene.bodies)
    if _BUILT * nodes <= free:
        return ""
    return (
        f"the scene's geometry was not looked at: meshes of {nodes:,} nodes need about "
        f"{_BUILT * nodes / 1e9:.3g} GB of memory, {free / 1e9:.3g} GB are free"
    )
