"""Props of a scene: plates, boxes and things from files, and where they are in a frame."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt

from gpusim import mesh
from gpusim.errors import InputError
from gpusim.files.input_file import Reader, read_input
from gpusim.pipeline.build.build import painted_skin
from gpusim.pipeline.build.painting import Frame, build_frame, build_pattern, finish_of
from gpusim.pipeline.build.places import surface_faces_of
from gpusim.scene.description import model as m
from gpusim.scene.description.prop import SURFACE_SUFFIXES
from gpusim.surface import Surface
from gpusim.surface.paint import Paint, Plain
from gpusim.surface.surface import plane_frame

__all__ = ["build_prop", "posed", "rotation"]

Array = npt.NDArray[np.float64]
DEFAULT_ALBEDO = 0.5


def build_prop(prop: m.Prop, read: Reader = read_input) -> Surface:
    """A prop with its paint, as it is described: before any rotation.

    ``read``: how the files that it names are read.
    """
    if isinstance(prop, m.Plate):
        return _plate(prop, read)
    if isinstance(prop, m.Shape) and Path(prop.path).suffix.lower() in SURFACE_SUFFIXES:
        return _faces(prop, read)
    # a box or a mesh is painted as a body is
    if isinstance(prop, m.Box):
        x, y, z = (c - 0.5 * s for c, s in zip(prop.center, prop.size, strict=True))
        grid = mesh.box(prop.size, (1, 1, 1), (x, y, z))
    else:
        grid = mesh.read_mesh(read(prop.path), scale=prop.scale)
    return painted_skin(f"prop {prop.name!r}", prop.name, grid, prop.paints, read)[1]


def _plate(prop: m.Plate, read: Reader) -> Surface:
    normal = np.array(prop.normal) / np.linalg.norm(prop.normal)
    up = np.array(prop.up) - normal * (np.array(prop.up) @ normal)
    up /= np.linalg.norm(up)
    right = np.cross(up, normal)
    x, z = 0.5 * prop.size[0] * right, 0.5 * prop.size[1] * up
    centre = np.array(prop.center)
    points = np.stack([centre - x - z, centre + x - z, centre + x + z, centre - x + z])
    faces = np.array([[0, 1, 2, 3]], np.int32)
    where = f"prop {prop.name!r}, paint {prop.paint.name!r}"
    if isinstance(prop.paint, m.Plain):
        plain = Plain(prop.paint.albedo, *finish_of(prop.paint))
        return Surface(points, faces, plain, name=prop.name)
    frame = plane_frame(points, faces, where, prop.paint.up or prop.up)
    name = prop.paint.name
    paint = build_pattern(prop.paint, frame, where, read)
    return Surface(points, faces, {name: paint}, frames={name: frame}, name=prop.name)


def _faces(prop: m.Shape, read: Reader) -> Surface:
    """Triangles of a file without solids; a face belongs to the last paint that matches it."""
    points, faces = mesh.read_surface(read(prop.path))
    points = points * prop.scale
    region = np.zeros(len(faces), np.int32)
    paints: dict[str, Paint] = {"unpainted": Plain(DEFAULT_ALBEDO)}
    frames: dict[str, Frame] = {}
    places = [f"prop {prop.name!r}, paint {paint.name!r}" for paint in prop.paints]
    for number, (paint, where) in enumerate(zip(prop.paints, places, strict=True), start=1):
        region[surface_faces_of(points, faces, paint.where, where)] = number
    for number, (paint, where) in enumerate(zip(prop.paints, places, strict=True), start=1):
        paints[paint.name] = Plain(paint.albedo, *finish_of(paint))
        own = region == number
        if isinstance(paint, m.Plain):
            continue
        if not own.any():
            raise InputError(f"{where}: every face it matches is painted over by a later paint")
        frames[paint.name] = build_frame(paint, points, faces, own, where)
        paints[paint.name] = build_pattern(paint, frames[paint.name], where, read)
    return Surface(points, faces, paints, region, frames=frames, name=prop.name)


def posed(surface: Surface, prop: m.Prop, pose: m.Pose | None = None) -> Surface:
    """The prop's surface in a pose (None: as it stands); its paint goes with it."""
    pose = pose or prop.stand
    if pose.position == prop.origin and not any(pose.rotation):
        return surface
    points = (surface.rest - np.array(prop.origin)) @ rotation(pose.rotation).T
    return surface.moved(points + np.array(pose.position))


def rotation(angles: m.Vec3) -> Array:
    """(3, 3): first about the world's x axis, then y, then z (rad)."""
    result = np.eye(3)
    for axis, angle in enumerate(angles):
        i, j = (axis + 1) % 3, (axis + 2) % 3
        turn = np.eye(3)
        turn[i, i] = turn[j, j] = np.cos(angle)
        turn[j, i], turn[i, j] = np.sin(angle), -np.sin(angle)
        result = turn @ result
    return result
