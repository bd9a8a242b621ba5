"""Small scenes for the twin checks: every kind of paint and of lamp, and what casts shadows."""

from __future__ import annotations

from dataclasses import fields, replace
from functools import cache

import numpy as np

from gpusim.arrays.array_types import Float, Single
from gpusim.optics.camera.pinhole import Camera
from gpusim.optics.geometry.view import look
from gpusim.optics.light.lights import (
    AmbientLight,
    AreaLight,
    Light,
    PointLight,
    SpotLight,
    SunLight,
)
from gpusim.optics.light.quadrature import lamps_of
from gpusim.optics.shading.setup import Setup
from gpusim.optics.shadow.light_space import LightSpace, light_spaces
from gpusim.optics.shadow.occluders import Occluders, relative_points
from gpusim.optics.shadow.receivers import PixelReceivers, Receivers
from gpusim.optics.shadow.single_layer import wound_once
from gpusim.optics.visibility_buffer import visibility_twin
from gpusim.surface.paint import Bump, Checker, Dots, Image, Markers, Paint, Plain, Speckle, Star
from gpusim.surface.surface import Surface


def block(
    centre: tuple[float, float, float], half: tuple[float, float, float], albedo: float
) -> Surface:
    """A closed box of bare metal."""
    signs = np.array([[x, y, z] for z in (-1, 1) for y in (-1, 1) for x in (-1, 1)], np.float64)
    faces = np.array(
        [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]]
    )
    points = np.array(centre) + signs * half
    return Surface(points, faces, paint=Plain(albedo, 0.45, 1.0), name="block")


def shadow_scene() -> tuple[list[Surface], Camera, list[Light]]:
    """A box on a table, a plate in the air, and a lamp of each kind."""
    corners = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    table = np.concatenate([1.1 * corners, np.zeros((4, 1))], axis=1)
    plate = np.concatenate([0.17 * corners + [0.3, 0.25], np.full((4, 1), 0.31)], axis=1)
    face = np.array([[0, 1, 2, 3]])
    surfaces = [
        Surface(table, face, paint=Checker(0.23, origin=(0.05, 0.11)), name="table"),
        Surface(plate, face, paint=Plain(0.7, 0.6), name="plate"),
        block((-0.15, -0.05, 0.11), (0.13, 0.08, 0.11), 0.6),
    ]
    camera = Camera.from_lens((36.0, 24.0), 30.0, (119, 83), (0.3, -1.4, 0.95), (0.03, 0.05, 0.05))
    lights: list[Light] = [
        AreaLight((-0.9, -0.4, 0.9), (0.0, 0.0, 0.1), (0.22, 0.13), 8.0),
        AreaLight((0.2, 0.9, 0.8), (0.0, 0.0, 0.0), (0.2, 0.2), 4.0, shape="ellipse"),
        PointLight((0.8, -0.6, 0.9), 6.0),
        SpotLight((-0.2, -0.8, 1.1), (0.0, 0.1, 0.0), 3.0, cone=0.6),
        SunLight((0.4, 0.3, -1.0), 0.6, diameter=0.05),
    ]
    return surfaces, camera, lights


@cache
def _scene() -> tuple[list[Surface], Camera, list[Light]]:
    surfaces, _, lights = shadow_scene()
    x, y = np.meshgrid(np.linspace(0.35, 0.7, 6), np.linspace(-0.3, 0.2, 5), indexing="ij")
    z = 0.15 + 0.05 * np.sin(9.0 * x) * np.cos(7.0 * y)
    number = np.arange(x.size).reshape(x.shape)
    quads = np.stack([number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]], -1)
    points = np.stack([x, y, z], axis=-1).reshape(-1, 3)
    sheet = Surface(points, quads.reshape(-1, 4).astype(np.int32), paint=Plain(0.6), name="sheet")
    more = [sheet, block((-0.55, 0.3, 0.2), (0.1, 0.07, 0.1), 0.5)]
    small = Camera.from_lens((36.0, 24.0), 30.0, (61, 43), (0.3, -1.4, 0.95), (0.03, 0.05, 0.05))
    return [*surfaces, *more], small, lights


@cache
def probe_points() -> Single:
    """(V, 3): the vertices relative to the eye."""
    surfaces, camera, _ = _scene()
    return relative_points(surfaces, camera.eye)


@cache
def _spaces() -> list[LightSpace]:
    surfaces, camera, lights = _scene()
    spaces = light_spaces(lamps_of(lights), probe_points(), camera.eye)
    return [replace(v, sheets=wound_once(v, surfaces, camera.eye)) for v in spaces]


@cache
def _occluders() -> Occluders:
    return Occluders.of(_scene()[0])


def probe_spaces() -> list[tuple[Occluders, Single, LightSpace]]:
    """The occluders, their vertices, and each light space; one of them in the midst of these."""
    middle = light_spaces(
        [v.lamp for v in _spaces()][2:3], probe_points(), np.array([0.8, -0.5, 0.4])
    )
    return [(_occluders(), probe_points(), space) for space in [*_spaces(), *middle]]


@cache
def probe_pixels() -> tuple[Occluders, list[LightSpace], PixelReceivers]:
    """What a camera sees of it."""
    surfaces, camera, _ = _scene()
    view = look(surfaces, camera, lit=True)
    ids = visibility_twin(view)
    return _occluders(), _spaces(), PixelReceivers.of(view, ids, _occluders())


@cache
def probe_pieces() -> tuple[Occluders, list[LightSpace], Receivers]:
    """Pieces of pixels on the table, some of which lie close to what stands there."""
    random = np.random.default_rng(5)
    _, camera, _ = _scene()
    at = np.column_stack([random.uniform(-0.9, 0.9, (400, 2)), np.zeros(400)]) - camera.eye
    normal = np.broadcast_to([0.0, 0.0, 1.0], at.shape)
    turn = random.uniform(0.0, 2.0 * np.pi, 400)
    size = random.uniform(1e-3, 2e-2, (2, 400, 1))
    across = np.column_stack([np.cos(turn), np.sin(turn), 0.0 * turn])
    down = np.column_stack([-np.sin(turn), np.cos(turn), 0.0 * turn])
    on = np.full(400, -1)
    return _occluders(), _spaces(), Receivers(at, normal, size[0] * across, size[1] * down, on)


def sheet(
    wide: float, tall: float, tilt: float, paint: Paint | None = None, depth: float = 4.0
) -> Surface:
    """For probes: a sheet of 704 triangles across the viewing direction, more and more crumpled."""
    rng, columns, rows = np.random.default_rng(11), 23, 17
    grid = np.stack(np.meshgrid(np.linspace(-1, 1, columns), np.linspace(-1, 1, rows)), axis=-1)
    flat = np.concatenate([grid.reshape(-1, 2), np.full((columns * rows, 1), depth)], axis=1)
    noise = rng.normal(size=flat.shape) * [0.01 * wide, 0.01 * tall, 0.003]
    noise[:, 2] *= (0.5 + 0.5 * flat[:, 0]) ** 3
    points = flat * [wide, tall, 1.0] + noise
    points[:, 2] += tilt * points[:, 0]
    number = np.arange(columns * rows, dtype=np.int32).reshape(rows, columns)
    faces = np.stack([number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]], axis=-1)
    paint = paint or Plain()
    return Surface(points, faces.reshape(-1, 4), paint, reference=flat * [wide, tall, 1.0])


def probe_setup(fine: bool = True, coloured: bool = False) -> Setup:
    """A small lit view with many kinds of paint, partly overlapping, for the twin checks.

    ``fine``: with bitmaps and reliefs; ``coloured``: in colour, the lamps as well.
    """

    def quad(x: float, y: float, z: float, tilt: float) -> Float:
        c, s = np.cos(tilt), np.sin(tilt)
        corners = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
        return np.stack([x + c * corners[:, 0], y + corners[:, 1], z + s * corners[:, 0]], axis=1)

    face = np.array([[0, 3, 2, 1]])
    paints: tuple[Paint, ...] = (
        Checker(0.31, 5, 4, (0.17, 0.21), 0.1, 0.8, 0.4),
        Dots(0.22, 0.4, None, None, (0.11, 0.05)),
        Markers(np.array([[0.6, 0.7], [1.4, 1.2]]), 0.5, angle=0.4),
        Star(np.array([[1.6, 1.0]]), 1.1, 5, 0.2),
        Plain(0.7, bump=Bump(0.011, 0.13)),
        Speckle(
            0.23, 0.5, 0.03, "lognormal", 0.25, seed=3, bump=Bump(0.02, 0.3, (1, 2, 0), 3.0, 4)
        ),
        Speckle(0.31, 0.4, seed=4),
        # one seen at about a texel a pixel, one at many
        Image(_ripples(23, 37), 0.04, (0.13, 0.09), 0.1, 0.9, 0.3),
        Image(_ripples(300, 200), 0.002, (-0.01, 0.05), 0.2, 0.7, 0.5),
    )
    places = ((-1.1, -0.6, 5.0, 0.3), (1.0, -0.7, 5.5, -0.5), (-0.8, 1.0, 5.2, 0.2),
              (2.4, 0.3, 5.2, -0.2), (0.9, 1.1, 6.0, 0.6), (-0.1, 0.2, 7.5, -0.2),
              (0.4, -1.6, 5.9, 0.35), (0.1, -0.1, 4.4, 0.9), (-0.3, 1.9, 6.4, -1.0))  # fmt: skip
    if not fine:
        paints = tuple(
            Plain(0.7) if isinstance(paint, Image) or getattr(paint, "bump", None) else paint
            for paint in paints
        )
    if coloured:
        paints = tuple(_coloured(paint, number) for number, paint in enumerate(paints))
    surfaces = [
        Surface(quad(*place), face, paint=paint)
        for place, paint in zip(places, paints, strict=True)
    ]
    camera = Camera(91, 67, np.array([[115.0, 0.2, 44.1], [0.0, 116.0, 34.3], [0.0, 0.0, 1.0]]))
    lights: list[Light] = [
        PointLight((-2.0, -3.0, 1.0), 90.0),
        AreaLight((2.0, -2.0, 0.0), (0.0, 0.0, 5.0), (0.5, 0.8), 60.0),
        AmbientLight(0.05),
    ]
    if coloured:
        lights = [replace(one, color=(1.0 + k, 2.0, 3.0 - k)) for k, one in enumerate(lights)]
    return Setup.build(look(surfaces, camera, lit=True), lights, background=0.05)


def _coloured(paint: Paint, number: int) -> Paint:
    """A paint whose albedos have different colours."""
    share = np.roll([1.0, 0.7, 0.4], number)
    names = ("albedo", "dark", "light", "ground", "dot")
    own = [name for name in names if name in (field.name for field in fields(paint))]  # type: ignore[arg-type]
    changes = {name: tuple(np.roll(share, k) * getattr(paint, name)) for k, name in enumerate(own)}
    if isinstance(paint, Image):
        return replace(paint, pixels=paint.pixels[..., None] * np.roll(share, 1))
    return replace(paint, **changes)  # type: ignore[type-var]


def fields_setup(lit: bool) -> Setup:
    """A bent picture of a crumpled sheet in fields of two plain paints, before a plain one."""
    front = sheet(0.7, 0.9, 0.2)
    row, column = np.divmod(np.arange(len(front.faces)), 22)
    field = ((row // 3 + column // 4) % 2).astype(np.int32)
    paints = {"dark": Plain(0.1), "light": Plain(0.8)}
    surfaces = [
        Surface(front.points, front.faces, paints, field),
        sheet(0.6, 0.4, 0.0, Plain(0.5), 5.0),
    ]
    K = np.array([[111.0, 0.3, 28.7], [0.0, 110.0, 20.2], [0.0, 0.0, 1.0]])
    camera = Camera(59, 39, K, distortion=[-0.1, 0.03, 1e-3, -2e-3])
    lights: list[Light] = [PointLight((-6.0, -5.0, -9.0), 2e3, shadows=False), AmbientLight(0.3)]
    return Setup.build(look(surfaces, camera, lit), lights if lit else None, 0.25)


def _ripples(rows: int, columns: int) -> Float:
    """A bitmap with structure in both directions, without symmetry."""
    y, x = np.mgrid[:rows, :columns].astype(np.float64)
    result: Float = 0.5 + 0.25 * np.sin(0.9 * x + 0.01 * x * y) + 0.2 * np.cos(1.3 * y - 0.4 * x)
    return result
