"""A scene's dataclasses turned into meshes, surfaces, lights and cameras."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from gpusim import mesh
from gpusim.errors import InputError
from gpusim.field import Field, read_field
from gpusim.files.input_file import Reader, read_input
from gpusim.mesh import Mesh
from gpusim.optics.light.lights import (
    AmbientLight,
    AreaLight,
    EnvironmentLight,
    Light,
    PointLight,
    SpotLight,
    SunLight,
)
from gpusim.pipeline.build.meshing import build_mesh
from gpusim.pipeline.build.painting import Frame, build_frame, build_pattern, finish_of
from gpusim.pipeline.build.places import faces_of
from gpusim.scene import Scene
from gpusim.scene.description import model as m
from gpusim.surface import Skin, Surface
from gpusim.surface.paint import Paint, Plain

__all__ = ["BodyParts", "build_body", "build_lights", "build_pattern", "painted_skin"]

Array = npt.NDArray[np.float64]
DEFAULT_ALBEDO = 0.5


@dataclass(frozen=True, eq=False)
class BodyParts:
    """A body's mesh, its skin, and the painted surface at rest.

    ``field``: its displacements, if they are given.
    """

    body: m.Body
    mesh: Mesh
    skin: Skin
    surface: Surface
    field: Field | None = None


def build_body(body: m.Body, read: Reader = read_input) -> BodyParts:
    """Mesh and painted skin; a face belongs to the last paint that matches it.

    ``read``: how the files that it names are read.
    """
    field = None
    if isinstance(body.mesh, m.FieldMesh):
        given = body.mesh
        field = read_field(
            read(given.path), name=given.variable, scale=given.scale, magnify=given.magnify
        )
    grid = field.mesh if field is not None else build_mesh(body.mesh, read)
    skin, surface = painted_skin(f"body {body.name!r}", body.name, grid, body.paints, read)
    return BodyParts(body, grid, skin, surface, field)


def painted_skin(
    what: str, name: str, grid: Mesh, scene_paints: tuple[m.Paint, ...], read: Reader
) -> tuple[Skin, Surface]:
    """The skin of a mesh and its painted surface of that ``name``; ``what`` says in errors what it
    is of."""
    faces = mesh.boundary_faces(grid)
    skin = Skin(grid, faces)
    region = np.zeros(len(faces), np.int32)
    paints: dict[str, Paint] = {"unpainted": Plain(DEFAULT_ALBEDO)}
    for number, paint in enumerate(scene_paints, start=1):
        try:
            painted = faces_of(grid, faces, paint.where)
        except InputError as error:
            raise InputError(f"{what}, paint {paint.name!r}: {error}") from None
        region[skin.numbers(painted)] = number
        paints[paint.name] = Plain(paint.albedo, *finish_of(paint))
    frames: dict[str, Frame] = {}
    rest = skin.at_vertices(grid.points)
    for number, paint in enumerate(scene_paints, start=1):
        own = (region == number)[skin.face_of_piece]
        where = f"{what}, paint {paint.name!r}"
        if isinstance(paint, m.Plain):
            continue
        if not own.any():
            raise _painted_over(where)
        frames[paint.name] = build_frame(paint, rest, skin.pieces, own, where)
        paints[paint.name] = build_pattern(paint, frames[paint.name], where, read)
    return skin, skin.surface(paints, region, frames, name)


def _painted_over(where: str) -> InputError:
    """What there is to say of a paint that nobody sees."""
    return InputError(
        f"{where}: every face it matches is painted over by a later paint"
    )  # fmt: skip


def build_lights(scene: Scene) -> list[Light] | None:
    """The lights, or None for a scene without: it then shows albedo."""
    return [_light(light, scene.input) for light in scene.lights] or None


def _light(light: m.Light, read: Reader) -> Light:
    if isinstance(light, m.Ambient):
        return AmbientLight(light.radiance, light.occlusion)
    if isinstance(light, m.Environment):
        along_y = abs(light.up[1]) > 0.999999 * float(np.linalg.norm(light.up))
        forward = light.forward or ((1.0, 0.0, 0.0) if along_y else (0.0, 1.0, 0.0))
        if light.path:
            return EnvironmentLight.read(
                read(light.path), scale=light.scale, up=light.up, forward=forward,
                occlusion=light.occlusion,
            )  # fmt: skip
        return EnvironmentLight(
            light.sky, light.ground, up=light.up, forward=forward, occlusion=light.occlusion
        )
    if isinstance(light, m.Point):
        return PointLight(light.position, light.power, light.shadows)
    if isinstance(light, m.Spot):
        return SpotLight(
            light.position, light.target, light.power, light.cone, light.penumbra, light.shadows
        )
    if isinstance(light, m.Area):
        return AreaLight(
            light.position, light.target, light.size, light.power, light.shape, light.shadows
        )
    return SunLight(light.direction, light.irradiance, light.diameter, light.shadows)
