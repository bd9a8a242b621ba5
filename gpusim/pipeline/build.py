"""A scene's dataclasses turned into meshes, models, surfaces, lights and cameras."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from gpusim import fem, mesh
from gpusim.errors import InputError
from gpusim.fem import loads
from gpusim.fem.supports import check_supports
from gpusim.mesh import Faces, Mesh
from gpusim.optics.camera import Camera
from gpusim.optics.light import AmbientLight, AreaLight, Light, PointLight
from gpusim.scene import Scene
from gpusim.scene import model as m
from gpusim.surface import PaintFrame, Skin, Surface
from gpusim.surface.paint import Checker, Dots, Markers, Paint, Plain
from gpusim.surface.surface import plane_frame

__all__ = ["BodyParts", "build_body", "build_camera", "build_lights", "build_model", "build_prop"]

Array = npt.NDArray[np.float64]
DEFAULT_ALBEDO = 0.5


@dataclass(frozen=True, eq=False)
class BodyParts:
    """A body's mesh, its skin, and the painted surface at rest."""

    body: m.Body
    mesh: Mesh
    skin: Skin
    surface: Surface


def build_mesh(recipe: m.MeshRecipe) -> Mesh:
    """The mesh that a recipe describes, in m."""
    if isinstance(recipe, m.BoxMesh):
        return mesh.box(recipe.size, recipe.divisions, recipe.origin)
    return mesh.crane(
        height=recipe.height,
        foot=recipe.foot,
        length=recipe.length,
        column_thickness=recipe.column_thickness,
        beam_thickness=recipe.beam_thickness,
        width=recipe.width,
        load_length=recipe.load_length,
        element_size=recipe.element,
        through=recipe.through,
        across=recipe.across,
    )


def build_body(body: m.Body) -> BodyParts:
    """Mesh and painted skin; a face belongs to the last paint that matches it."""
    grid = build_mesh(body.mesh)
    faces = mesh.boundary_faces(grid)
    skin = Skin(grid, faces)
    region = np.zeros(len(faces), np.int32)
    paints: dict[str, Paint] = {"unpainted": Plain(DEFAULT_ALBEDO)}
    for number, paint in enumerate(body.paints, start=1):
        region[skin.numbers(_faces(grid, faces, paint.where))] = number
        paints[paint.name] = Plain(paint.albedo)
    frames: dict[str, PaintFrame] = {}
    for number, paint in enumerate(body.paints, start=1):
        own = faces.nodes[region == number]
        where = f"body {body.name!r}, paint {paint.name!r}"
        if isinstance(paint, m.Plain):
            continue
        if not len(own):
            raise InputError(f"{where}: every face it matches is painted over by a later paint")
        frames[paint.name] = plane_frame(grid.points, own, where, paint.up)
        paints[paint.name] = _pattern(paint, frames[paint.name], where)
    return BodyParts(body, grid, skin, skin.surface(paints, region, frames, body.name))


def build_prop(prop: m.Prop) -> Surface:
    """A rigid plate with its paint."""
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
        return Surface(points, faces, Plain(prop.paint.albedo), name=prop.name)
    frame = plane_frame(points, faces, where, prop.paint.up or prop.up)
    name = prop.paint.name
    paint = _pattern(prop.paint, frame, where)
    return Surface(points, faces, {name: paint}, frames={name: frame}, name=prop.name)


def _pattern(paint: m.Markers | m.Checker | m.Dots, frame: PaintFrame, where: str) -> Paint:
    if isinstance(paint, m.Markers):
        positions = np.array([marker.position for marker in paint.markers])
        normal = np.cross(frame.s_axis, frame.t_axis)
        off = np.abs((positions - frame.origin) @ normal)
        bad = np.flatnonzero(~(off <= 1e-3 * paint.size))
        if len(bad):
            marker = paint.markers[bad[0]]
            raise InputError(
                f"{where}: marker {marker.name!r}; got position {list(marker.position)} m, "
                f"{off[bad[0]] * 1e3:.3g} mm off the painted plane; expected a point on it"
            )
        return Markers(
            frame.coordinates(positions), paint.size, paint.dark, paint.light, paint.albedo
        )
    s, t = frame.coordinates(np.array(paint.origin))
    if isinstance(paint, m.Checker):
        return Checker(
            paint.cell, paint.columns, paint.rows, (float(s), float(t)), paint.dark, paint.light,
            paint.albedo,
        )  # fmt: skip
    return Dots(
        paint.diameter, paint.pitch, paint.columns, paint.rows, (float(s), float(t)), paint.dot,
        paint.albedo,
    )  # fmt: skip


def build_model(parts: BodyParts) -> fem.Model:
    """Material, supports and the loads at load factor 1.

    Raises
    ------
    InputError
        A selection finds nothing, two supports want a node at different places, or the supports
        leave a rigid-body motion free.
    """
    body, grid = parts.body, parts.mesh
    fixed = np.zeros((grid.node_count, 3), bool)
    prescribed = np.zeros((grid.node_count, 3))
    for support in body.supports:
        nodes = _nodes(grid, support.where)
        for axis in support.axes:
            k = "xyz".index(axis)
            other = fixed[nodes, k] & (prescribed[nodes, k] != support.displacement[k])
            if other.any():
                raise InputError(
                    f"body {body.name!r}, support {support.name!r}: {int(other.sum())} of its "
                    f"nodes are held at another {axis} by an earlier support; got "
                    f"{support.displacement[k]:g} m; expected one displacement per node"
                )
            fixed[nodes, k] = True
            prescribed[nodes, k] = support.displacement[k]
    forces = np.zeros((grid.node_count, 3))
    for load in body.loads:
        forces += _load(parts, load)
    material = body.material
    model = fem.Model(
        grid,
        materials=[
            fem.Isotropic(material.youngs_modulus, material.poissons_ratio, material.density)
        ],
        fixed=fixed,
        prescribed=prescribed,
        forces=forces,
    )
    check_supports(model)
    return model


def _load(parts: BodyParts, load: m.Load) -> Array:
    grid = parts.mesh
    if isinstance(load, m.Gravity):
        return loads.body_force(grid, parts.body.material.density, load.acceleration)
    if isinstance(load, m.NodalForce):
        nodes = _nodes(grid, load.where)
        return loads.nodal_force(grid, nodes, np.array(load.force) * len(nodes))
    faces = _faces(grid, parts.skin.faces, load.where)
    if isinstance(load, m.Pressure):
        return loads.pressure(grid, faces, load.pressure)
    if isinstance(load, m.Traction):
        return loads.traction(grid, faces, load.traction)
    return loads.face_force(grid, faces, load.force)


def _nodes(grid: Mesh, where: m.Where) -> npt.NDArray[np.int32]:
    return mesh.select_nodes(
        grid,
        bounds=_bounds(where),
        normal=where.normal,
        name=where.set,
        tolerance=where.tolerance,
    )


def _faces(grid: Mesh, faces: Faces, where: m.Where) -> Faces:
    return mesh.select_faces(
        grid,
        bounds=_bounds(where),
        normal=where.normal,
        name=where.set,
        tolerance=where.tolerance,
        faces=None if where.set is not None else faces,
    )


def _bounds(where: m.Where) -> dict[str, float]:
    """Only the finite limits."""
    limits = {}
    for axis, low, high in zip("xyz", where.lower, where.upper, strict=True):
        limits[f"{axis}_min"], limits[f"{axis}_max"] = low, high
    return {key: value for key, value in limits.items() if np.isfinite(value)}


def build_camera(camera: m.Camera) -> Camera:
    """The pinhole camera of a scene."""
    mm = 1e3
    return Camera.from_lens(
        (camera.sensor[0] * mm, camera.sensor[1] * mm),
        camera.focal * mm,
        camera.resolution,
        camera.position,
        camera.target,
        camera.up,
        (camera.principal_point_offset[0] * mm, camera.principal_point_offset[1] * mm),
        camera.name,
    )


def build_lights(scene: Scene) -> list[Light] | None:
    """The lamps, or None for a scene without: it then shows albedo."""
    lights: list[Light] = []
    for lamp in scene.lights:
        if lamp.type == "ambient":
            lights.append(AmbientLight(lamp.radiance))
        elif lamp.type == "point":
            lights.append(PointLight(lamp.position, lamp.power))
        else:
            assert lamp.target is not None
            lights.append(AreaLight(lamp.position, lamp.target, lamp.size, lamp.power))
    return lights or None
