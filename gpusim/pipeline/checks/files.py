"""Files that a scene names, opened before any work: what is wrong in them is told at once."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

from gpusim.errors import InputError
from gpusim.field import Field, read_field
from gpusim.mesh import check_gmsh
from gpusim.pipeline.build.build import build_lights
from gpusim.pipeline.build.cameras import build_camera
from gpusim.pipeline.build.meshing import build_mesh, size_warnings_of
from gpusim.pipeline.build.photo import build_lens
from gpusim.scene import Scene
from gpusim.scene.description import model as m
from gpusim.surface.paint import Image

__all__ = ["check_field", "check_files", "check_mesher", "check_views"]

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
    states = [scene.variant(variant.name) for variant in scene.variants] or [scene]
    problems: list[str] = []
    warnings: list[str] = []
    for check in (check for state in states for check in _checks(state, warnings)):
        try:
            check()
        except InputError as error:
            if str(error) not in problems:
                problems.append(str(error))
    if problems:
        raise InputError("\n".join(problems))
    return list(dict.fromkeys(warnings))


def _checks(scene: Scene, warnings: list[str]) -> Iterator[Callable[[], object]]:
    for camera in scene.cameras:
        yield partial(build_camera, camera, scene.input)
        if camera.lens is not None and camera.calibration:
            yield partial(build_lens, camera, scene.input)
    for body in scene.bodies:
        if isinstance(body.mesh, m.FieldMesh):
            yield partial(_read_and_check, body, scene, warnings)
        elif isinstance(body.mesh, m.FileMesh) and body.mesh.size is None:
            if Path(body.mesh.path).stat().st_size <= _QUICK:
                yield partial(_check_size, body, scene, warnings)
    for thing in (*scene.bodies, *scene.props):
        for paint in thing.paints:
            if isinstance(paint, m.Picture):
                yield partial(_read_picture, paint, scene)
    yield partial(build_lights, scene)


def check_mesher(scene: Scene) -> None:
    """Raises InputError where a CAD file is to be meshed and Gmsh isn't there."""
    for state in [scene.variant(variant.name) for variant in scene.variants] or [scene]:
        for body in state.bodies:
            if isinstance(body.mesh, m.FileMesh) and body.mesh.size is not None:
                check_gmsh(body.mesh.path)


def _check_size(body: m.Body, scene: Scene, warnings: list[str]) -> None:
    warnings += size_warnings_of(body.name, body.mesh, build_mesh(body.mesh, scene.input))


def check_views(scene: Scene) -> None:
    """Make every camera, lens and light once. Raises InputError for what is wrong in them."""
    for camera in scene.cameras:
        build_camera(camera, scene.input)
        build_lens(camera, scene.input)
    build_lights(scene)


def _read_picture(paint: m.Picture, scene: Scene) -> None:
    Image.read(scene.input(paint.path), paint.texel, gamma=paint.gamma)


def _read_and_check(body: m.Body, scene: Scene, warnings: list[str]) -> None:
    mesh = body.mesh
    assert isinstance(mesh, m.FieldMesh)
    file = scene.input(mesh.path)
    field = read_field(file, name=mesh.variable, scale=mesh.scale, magnify=mesh.magnify)
    check_field(field, scene.analysis.load_factors)
    warnings += size_warnings_of(body.name, mesh, field.mesh)


def check_field(field: Field, times: tuple[float, ...]) -> None:
    """Read every step that the frames at ``times`` lie between. Raises InputError for a time
    beyond them, or values that aren't finite."""
    for time in times:
        field.check(time)
    for time in times:
        field.at(time)
