"""Files that a scene names, opened before any work: what is wrong in them is told at once."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial

from gpusim.errors import InputError
from gpusim.field import Field, read_field
from gpusim.mesh import check_gmsh
from gpusim.pipeline.build import build_lights
from gpusim.pipeline.cameras import build_camera
from gpusim.pipeline.photo import build_lens
from gpusim.scene import Scene
from gpusim.scene import model as m
from gpusim.surface.paint import Image

__all__ = ["check_field", "check_files", "check_mesher", "check_views"]


def check_files(scene: Scene) -> None:
    """Read the calibration, result and picture files of ``scene``, and of its variants.

    Mesh and CAD files are read by the stage that meshes, before a run writes anything.

    Raises
    ------
    InputError
        All that is wrong: a file that can't be read or doesn't fit, a lens that folds inside the
        image, a frame's time outside of a field, a displacement that isn't finite.
    """
    states = [scene.variant(variant.name) for variant in scene.variants] or [scene]
    problems: list[str] = []
    for check in (check for state in states for check in _checks(state)):
        try:
            check()
        except InputError as error:
            if str(error) not in problems:
                problems.append(str(error))
    if problems:
        raise InputError("\n".join(problems))


def _checks(scene: Scene) -> Iterator[Callable[[], object]]:
    for camera in scene.cameras:
        yield partial(build_camera, camera, scene.input)
        if camera.lens is not None and camera.calibration:
            yield partial(build_lens, camera, scene.input)
    for body in scene.bodies:
        if isinstance(body.mesh, m.FieldMesh):
            yield partial(_read_and_check, body.mesh, scene)
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


def check_views(scene: Scene) -> None:
    """Make every camera, lens and light once. Raises InputError for what is wrong in them."""
    for camera in scene.cameras:
        build_camera(camera, scene.input)
        build_lens(camera, scene.input)
    build_lights(scene)


def _read_and_check(mesh: m.FieldMesh, scene: Scene) -> None:
    file = scene.input(mesh.path)
    field = read_field(file, name=mesh.variable, scale=mesh.scale, magnify=mesh.magnify)
    check_field(field, scene.analysis.load_factors)


def _read_picture(paint: m.Picture, scene: Scene) -> None:
    Image.read(scene.input(paint.path), paint.texel, gamma=paint.gamma)


def check_field(field: Field, times: tuple[float, ...]) -> None:
    """Read every step that the frames at ``times`` lie between. Raises InputError for a time
    beyond them, or values that aren't finite."""
    for time in times:
        field.check(time)
    for time in times:
        field.at(time)
