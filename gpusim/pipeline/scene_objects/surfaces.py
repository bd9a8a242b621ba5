"""Bodies and props of a scene as painted surfaces."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from gpusim import mesh
from gpusim.arrays.array_types import Bool, Float, Int, Long
from gpusim.errors import InputError
from gpusim.field import Field
from gpusim.files.input_file import Reader, read_input
from gpusim.files.picture_file import claimed_pixels
from gpusim.mesh import Mesh, read_surface, read_textured
from gpusim.mesh.formats.textures import FileMaterial, TexturedSurface
from gpusim.pipeline.scene_objects.meshing import (
    build_mesh,
    faces_of,
    naming_place,
    read_given_field,
    surface_faces_of,
)
from gpusim.scene.cost import Counts
from gpusim.scene.description import model as m
from gpusim.scene.description.prop import SURFACE_SUFFIXES
from gpusim.scene.frames import Placed
from gpusim.surface import Atlas, CylinderFrame, PaintFrame, Skin, Surface
from gpusim.surface import paint as paints
from gpusim.surface.bitmap import LUMA
from gpusim.surface.color import color
from gpusim.surface.paint import Paint, Plain
from gpusim.surface.surface import plane_frame, triangulate
from gpusim.surface.texture import MOST_TEXELS, textured
from gpusim.validation import require

Frame = PaintFrame | CylinderFrame | Atlas
DEFAULT_ALBEDO = 0.5
MIDDLES: dict[str, Callable[..., Paint]] = {
    "markers": paints.Markers,
    "circles": paints.Circles,
    "aruco": paints.Aruco,
    "ring_codes": paints.RingCodes,
    "star": paints.Star,
}
"""What is placed by its middles, and by its lower left corner."""
CORNERS: dict[str, Callable[..., Paint]] = {
    "checker": paints.Checker,
    "dots": paints.Dots,
    "charuco": paints.Charuco,
    "lines": paints.Lines,
}


def build_frame(
    paint: m.Pattern,
    points: Float,
    faces: Int,
    own: Bool,
    where: str,
) -> Frame:
    """Paint coordinates of the faces that are a paint's ``own`` (F,); ``where`` names it."""
    if paint.mapping == "unfold":
        return Atlas.unfold(points, faces, own, paint.up)
    if paint.axis is not None and paint.axis_point is not None:
        return CylinderFrame.fit(points, faces[own], paint.axis_point, paint.axis, where)
    return plane_frame(points, faces[own], where, paint.up)


def finish_of(paint: m.Paint) -> dict[str, Any]:
    """Roughness, metallic share and relief of any paint, as its class takes them."""
    values: dict[str, Any] = {"roughness": paint.roughness, "metallic": paint.metallic}
    if paint.bump > 0.0:
        values["bump"] = paints.Bump(
            paint.bump, paint.bump_length, paint.bump_along, paint.bump_stretch, paint.bump_seed
        )
    return values


def build_pattern(
    paint: m.Pattern, frame: Frame, where: str, read: Reader = read_input
) -> paints.Paint:
    """The paint of a region; ``where`` names it in errors, ``read`` reads its picture."""
    with naming_place(where):
        values = {**paint.values, **finish_of(paint)}
        if isinstance(paint, m.SpeckleTable):
            return paints.Speckle(**values)
        assert not isinstance(frame, Atlas)  # nothing but speckle is unfolded
        if isinstance(paint, m.MarkersTable):
            _check_markers(paint, frame)
        places = frame.coordinates(np.array(paint.places))
        if paint.type in MIDDLES:
            return MIDDLES[paint.type](places, **values)
        s, t = (float(value) for value in places[0])
        if isinstance(paint, m.PictureTable):
            assert paint.path is not None  # it isn't laid by UV
            return paints.Image.read(read(paint.path), origin=(s, t), **values)
        return CORNERS[paint.type](origin=(s, t), **values)


def _check_markers(paint: m.MarkersTable, frame: PaintFrame | CylinderFrame) -> None:
    """Raise InputError for a marker that isn't on the painted faces."""
    off = _distance(frame, np.array(paint.places))
    bad = np.flatnonzero(~(off <= 1e-3 * paint.size))
    if len(bad):
        marker = paint.markers[bad[0]]
        away = f"{1e3 * off[bad[0]]:.3g} mm off the painted plane"
        got = f"position {list(marker.position)} m, {away}"
        raise InputError(f"marker {marker.name!r}; got {got}; expected a point on it")


def _distance(frame: PaintFrame | CylinderFrame, points: Float) -> Float:
    """How far points (n, 3) lie off the surface that a frame is for."""
    relative = points - frame.origin
    if isinstance(frame, CylinderFrame):
        across = relative - np.outer(relative @ frame.axis, frame.axis)
        off: Float = np.linalg.norm(across, axis=1) - frame.radius
    else:
        off = relative @ np.cross(frame.s_axis, frame.t_axis)
    return np.abs(off)


@dataclass(frozen=True, eq=False)
class MeshedBody:
    """A body's mesh and its skin. ``field``: its displacements, if they are given."""

    body: m.Body
    mesh: Mesh
    skin: Skin
    field: Field | None = None


@dataclass(frozen=True, eq=False)
class BodyParts(MeshedBody):
    """And its painted surface at rest."""

    surface: Surface = dataclasses.field(kw_only=True)


def mesh_body(body: m.Body, read: Reader = read_input, grid: Mesh | None = None) -> MeshedBody:
    """A body's mesh and skin; ``read``: how the files that it names are read. ``grid``: the mesh,
    if it has been made before."""
    field = read_given_field(body.mesh, read) if isinstance(body.mesh, m.FieldMeshTable) else None
    if grid is None:
        grid = field.mesh if field is not None else build_mesh(body.mesh, read)
    return MeshedBody(body, grid, Skin(grid, mesh.boundary_faces(grid)), field)


def counts_of(bodies: Iterable[MeshedBody]) -> Counts:
    """How large their meshes are."""
    return {one.body.mesh: (one.mesh.node_count, one.mesh.cell_count) for one in bodies}


def paint_body(body: m.Body, meshed: MeshedBody, read: Reader = read_input) -> BodyParts:
    """A body with its painted surface; a face belongs to the last paint that matches it."""
    surface = _painted_skin(f"body {body.name!r}", body.name, meshed.skin, body.paints, read)
    return BodyParts(body, meshed.mesh, meshed.skin, meshed.field, surface=surface)


def build_body(body: m.Body, read: Reader = read_input, grid: Mesh | None = None) -> BodyParts:
    """Both, as `mesh_body` and `paint_body`."""
    return paint_body(body, mesh_body(body, read, grid), read)


def _painted_skin(
    where: str, name: str, skin: Skin, patterns: Sequence[m.Paint], read: Reader
) -> Surface:
    """The painted surface, of that ``name``, of a skin; ``where`` says in errors what it is of."""
    region = np.zeros(len(skin.faces), np.int32)
    for number, paint in enumerate(patterns, start=1):
        with naming_place(f"{where}, paint {paint.name!r}"):
            region[skin.numbers(faces_of(skin.mesh, skin.faces, paint.where))] = number
    rest, pieces = skin.at_vertices(skin.mesh.points), region[skin.face_of_piece]
    found, frames = _painted(where, patterns, rest, skin.pieces, pieces, read)
    return skin.surface(found, region, frames, name)


def _painted(
    where: str,
    patterns: Sequence[m.Paint],
    points: Float,
    faces: Int,
    region: Int,
    read: Reader,
) -> tuple[dict[str, Paint], dict[str, Frame]]:
    """Paints by name, and paint coordinates of those that need some; ``region`` (F,): which of the
    ``patterns`` a face has, from 1, 0 for none."""
    without = _new_name("unpainted", {paint.name for paint in patterns})
    found: dict[str, Paint] = {without: Plain(DEFAULT_ALBEDO)}
    frames: dict[str, Frame] = {}
    for number, paint in enumerate(patterns, start=1):
        found[paint.name] = Plain(paint.albedo, **finish_of(paint))
        if isinstance(paint, m.PlainTable) or paint.mapping == "uv":
            continue
        own, place = region == number, f"{where}, paint {paint.name!r}"
        if not own.any():
            raise InputError(f"{place}: every face it matches is painted over by a later paint")
        frames[paint.name] = build_frame(paint, points, faces, own, place)
        found[paint.name] = build_pattern(paint, frames[paint.name], place, read)
    return found, frames


def build_prop(prop: m.Prop, read: Reader = read_input) -> Surface:
    """A prop with its paint, as it is described: before any rotation.

    ``read``: how the files that it names are read.
    """
    if isinstance(prop, m.PlateTable):
        return _plate(prop, read)
    if isinstance(prop, m.ShapeTable) and Path(prop.path).suffix.lower() in SURFACE_SUFFIXES:
        return _faces(prop, read)
    # a box or a mesh is painted as a body is
    if isinstance(prop, m.BoxTable):
        x, y, z = (c - 0.5 * s for c, s in zip(prop.center, prop.size, strict=True))
        grid = mesh.box(prop.size, (1, 1, 1), (x, y, z))
    else:
        grid = mesh.read_mesh(read(prop.path), scale=prop.scale)
    skin = Skin(grid, mesh.boundary_faces(grid))
    return _painted_skin(f"prop {prop.name!r}", prop.name, skin, prop.paints, read)


def _plate(prop: m.PlateTable, read: Reader) -> Surface:
    normal = np.array(prop.normal) / np.linalg.norm(prop.normal)
    up = np.array(prop.up) - normal * (np.array(prop.up) @ normal)
    up /= np.linalg.norm(up)
    right = np.cross(up, normal)
    x, z = 0.5 * prop.size[0] * right, 0.5 * prop.size[1] * up
    centre = np.array(prop.center)
    points = np.stack([centre - x - z, centre + x - z, centre + x + z, centre - x + z])
    faces = np.array([[0, 1, 2, 3]], np.int32)
    where = f"prop {prop.name!r}, paint {prop.paint.name!r}"
    if isinstance(prop.paint, m.PlainTable):
        plain = Plain(prop.paint.albedo, **finish_of(prop.paint))
        return Surface(points, faces, {prop.paint.name: plain}, name=prop.name)
    frame = plane_frame(points, faces, where, prop.paint.up or prop.up)
    name = prop.paint.name
    paint = build_pattern(prop.paint, frame, where, read)
    return Surface(points, faces, {name: paint}, frames={name: frame}, name=prop.name)


def _faces(prop: m.ShapeTable, read: Reader) -> Surface:
    """Triangles of a file without solids; a face belongs to the last paint that matches it."""
    by_uv = [p for p in prop.paints if isinstance(p, m.PictureTable) and p.mapping == "uv"]
    look = read_textured(read(prop.path)) if by_uv else None
    points, faces = (look.points, look.faces) if look else read_surface(read(prop.path))
    points = points * prop.scale
    region, where = np.zeros(len(faces), np.int32), f"prop {prop.name!r}"
    for number, paint in enumerate(prop.paints, start=1):
        with naming_place(f"{where}, paint {paint.name!r}"):
            region[surface_faces_of(points, faces, paint.where)] = number
    found, frames = _painted(where, prop.paints, points, faces, region, read)
    for paint in by_uv:
        assert look is not None
        own = np.flatnonzero(region == list(found).index(paint.name))
        place = f"{where}, paint {paint.name!r}"
        for number, (faces_of_it, material) in enumerate(_looks(look, paint, own, place, read)):
            name = paint.name
            if number:
                name = _new_name(f"{name}/{material.name}", found)
                region[faces_of_it] = len(found)
            found[name], frame = _by_uv(look, paint, faces_of_it, material, place)
            if frame is not None:
                frames[name] = frame
    return Surface(points, faces, found, region, frames=frames, name=prop.name)


def _new_name(name: str, known: Collection[str]) -> str:
    """The name, or one like it that isn't ``known``: those in files needn't differ."""
    names = (f"{name} {number}" for number in itertools.count(2))
    return name if name not in known else next(one for one in names if one not in known)


def _looks(
    surface: TexturedSurface, paint: m.PictureTable, own: Long, where: str, read: Reader
) -> list[tuple[Long, FileMaterial]]:
    """Of a paint's ``own`` faces (n,) those that look alike, and how."""
    if not len(own):
        raise InputError(f"{where}: every face it matches is painted over by a later paint")
    if paint.path is not None:
        return [(own, FileMaterial(paint.name, (1.0, 1.0, 1.0), read(paint.path)))]
    if not surface.materials:
        raise InputError(f"{where}: the prop's file names no materials; expected file = a picture")
    result: list[tuple[Long, FileMaterial]] = []
    ground = FileMaterial("none", color(paint.albedo))
    for number in np.unique(surface.material[own]).tolist():
        material = surface.materials[number] if number >= 0 else ground
        if material.missing:
            raise InputError(f"{where}: {material.missing!r}, of material {material.name!r}, isn't "
                             "there; expected it beside the prop's file")  # fmt: skip
        result.append((own[surface.material[own] == number], material))
    texels = sum(claimed_pixels(one.picture) for _, one in result if one.picture)
    most = f"at most {MOST_TEXELS:,} in all"
    require(texels <= MOST_TEXELS, where, f"pictures of {texels:,} pixels", most)
    return result


def _by_uv(
    surface: TexturedSurface,
    paint: m.PictureTable,
    own: Long,
    material: FileMaterial,
    where: str,
) -> tuple[Paint, Atlas | None]:
    """The paint of faces ``own`` (n,), and where it lies on them."""
    finish = finish_of(paint)
    if material.picture is None:
        return Plain(material.color, **finish), None
    factor = material.color if paint.channels == "rgb" else np.dot(LUMA, material.color)
    dark, light = (np.multiply(color(one), factor) for one in (paint.dark, paint.light))
    corner = np.where(surface.faces < 0, -1, np.arange(surface.faces.size).reshape(-1, 4))
    triangles, source = triangulate(corner.astype(np.int32))
    wanted = np.isin(source, own)
    with naming_place(where):
        picture = paints.Image.read(
            material.picture, 1.0, dark=dark, light=light, ground=paint.albedo, gamma=paint.gamma,
            channels=paint.channels, **finish,
        )  # fmt: skip
        uv = surface.uv.reshape(-1, 2)[triangles[wanted]]
        picture, places = textured(picture, uv, material.wrap)
    st = np.full((len(triangles), 3, 2), np.nan)
    st[wanted] = places
    return picture, Atlas(st)


def posed(
    surface: Surface, prop: m.Prop, pose: m.Prop | m.PoseTable | Placed | None = None
) -> Surface:
    """The prop's surface in a pose (None: as it stands); its paint goes with it."""
    pose = pose or prop
    if pose.position == prop.origin and not any(pose.rotation):
        return surface
    points = (surface.rest - np.array(prop.origin)) @ rotation(pose.rotation).T
    return surface.moved(points + np.array(pose.position))


def rotation(angles: m.Vec3) -> Float:
    """(3, 3): first about the world's x axis, then y, then z (rad)."""
    result = np.eye(3)
    for axis, angle in enumerate(angles):
        i, j = (axis + 1) % 3, (axis + 2) % 3
        turn = np.eye(3)
        turn[i, i] = turn[j, j] = np.cos(angle)
        turn[j, i], turn[i, j] = np.sin(angle), -np.sin(angle)
        result = turn @ result
    return result
