"""A small view with every kind of paint, for the twin checks."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from gpusim.optics.camera.pinhole import Camera
from gpusim.optics.geometry.view import View, look
from gpusim.optics.light.lights import AmbientLight, AreaLight, Light, PointLight
from gpusim.optics.shading.setup import Setup
from gpusim.surface.paint import Bump, Checker, Dots, Image, Markers, Paint, Plain, Speckle
from gpusim.surface.surface import Surface

__all__ = ["fields_setup", "probe_setup"]

Array = npt.NDArray[np.float64]


def crumpled_view() -> View:
    """Small triangles over and through each other, and beyond the borders of the image."""
    camera = Camera(59, 39, np.array([[111.0, 0.3, 28.7], [0.0, 110.0, 20.2], [0.0, 0.0, 1.0]]))
    return look([sheet(0.95, 1.3, 0.0), sheet(0.6, 0.6, 0.4)], camera, lit=False)


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


def probe_setup(fine: bool = True) -> Setup:
    """A small lit view with every kind of paint, partly overlapping, for the twin checks.

    ``fine``: with bitmaps and reliefs.
    """

    def quad(x: float, y: float, z: float, tilt: float) -> Array:
        c, s = np.cos(tilt), np.sin(tilt)
        corners = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
        return np.stack([x + c * corners[:, 0], y + corners[:, 1], z + s * corners[:, 0]], axis=1)

    face = np.array([[0, 3, 2, 1]])
    paints: tuple[Paint, ...] = (
        Checker(0.31, 5, 4, (0.17, 0.21), 0.1, 0.8, 0.4),
        Dots(0.22, 0.4, None, None, (0.11, 0.05)),
        Markers(np.array([[0.6, 0.7], [1.4, 1.2]]), 0.5, angle=0.4),
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
              (0.9, 1.1, 6.0, 0.6), (-0.1, 0.2, 7.5, -0.2), (0.4, -1.6, 5.9, 0.35),
              (0.1, -0.1, 4.4, 0.9), (-0.3, 1.9, 6.4, -1.0))  # fmt: skip
    if not fine:
        paints = tuple(
            Plain(0.7) if isinstance(paint, Image) or getattr(paint, "bump", None) else paint
            for paint in paints
        )
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
    return Setup.build(look(surfaces, camera, lit=True), lights, background=0.05)


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


def _ripples(rows: int, columns: int) -> Array:
    """A bitmap with structure in both directions, without symmetry."""
    y, x = np.mgrid[:rows, :columns].astype(np.float64)
    result: Array = 0.5 + 0.25 * np.sin(0.9 * x + 0.01 * x * y) + 0.2 * np.cos(1.3 * y - 0.4 * x)
    return result
