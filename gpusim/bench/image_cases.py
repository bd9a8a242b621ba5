"""Scenes of the render benchmark, for gpusim and as coloured triangles for its reference.

Fields and markers are triangles of their own colour there; only speckle is a texture.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np

from gpusim.arrays.array_types import Float
from gpusim.bench.solver_cases import SIZES
from gpusim.errors import InputError
from gpusim.mesh import boundary_faces, crane, select_faces
from gpusim.optics import AreaLight, Camera
from gpusim.surface import PaintFrame, Skin, Surface
from gpusim.surface.paint import Checker, Markers, Paint, Plain, Speckle
from gpusim.surface.surface import triangulate

Builder = Callable[[str], "ImageCase"]
LIFT = 1e-6
"""m by which markers as triangles lie before the face that they are painted on."""


@dataclass(frozen=True, eq=False)
class Soup:
    """Triangles (T, 3, 3) in world coordinates, front sides counter-clockwise, albedo (T,)."""

    corners: Float
    albedo: Float


@dataclass(frozen=True, eq=False)
class ImageCase:
    """One scene at one size. ``windows`` are rows and columns (r0, r1, c0, c1) that are judged;
    ``speckle``: the paint of the first surface, a plate, in its frame "plate"."""

    name: str
    camera: Camera
    surfaces: list[Surface]
    soup: Soup
    lights: tuple[AreaLight, ...] = ()
    speckle: Speckle | None = None
    windows: tuple[tuple[int, int, int, int], ...] = ()

    @property
    def pixels(self) -> int:
        return self.camera.width * self.camera.height


def _outline(origin: Float, a: Float, b: Float) -> Float:
    return np.stack([origin, origin + a, origin + a + b, origin + b])


def _quad(origin: Float, a: Float, b: Float) -> Float:
    """Two triangles (2, 3, 3) of a parallelogram, counter-clockwise from a to b."""
    p = _outline(origin, a, b)
    return np.stack([p[[0, 1, 2]], p[[0, 2, 3]]])


def square_windows(
    camera: Camera, points: Float, side: int
) -> tuple[tuple[int, int, int, int], ...]:
    """Squares of ``side`` px around projected points, inside the image."""
    found = []
    for x, y in camera.project(points):
        c0 = int(np.clip(round(x) - side // 2, 0, camera.width - side))
        r0 = int(np.clip(round(y) - side // 2, 0, camera.height - side))
        found.append((r0, r0 + side, c0, c0 + side))
    return tuple(dict.fromkeys(found))


def _board(width: int, lit: bool) -> ImageCase:
    """A chessboard of 18 x 12 fields on a plate, seen at an angle."""
    columns, rows, cell, rim = 18, 12, 0.04, 0.02
    height = width * 2 // 3
    camera = Camera.from_lens((36.0, 24.0), 32.0, (width, height), (0.16, -0.86, 0.24),
                              (0.01, 0.0, 0.015), up=(0.11, 0.0, 1.0))  # fmt: skip
    size = np.array([columns * cell + 2 * rim, rows * cell + 2 * rim])
    s, t = np.array([np.cos(0.13), np.sin(0.13), 0.0]), np.array([0.0, 0.0, 1.0])
    corner = -0.5 * (size[0] * s + size[1] * t)
    paint = Checker(cell, columns, rows, (rim, rim), 0.05, 0.9, 0.6)
    plate = _outline(corner, size[0] * s, size[1] * t)
    frame = PaintFrame(corner, s, t)
    surface = Surface(plate, np.array([[0, 1, 2, 3]]), {"board": paint}, frames={"board": frame})
    edges_s = np.array([0.0, rim, size[0] - rim, size[0]])
    edges_t = np.array([0.0, rim, size[1] - rim, size[1]])
    parts, albedo = [], []
    for i in range(3):
        for j in range(3):
            if (i, j) != (1, 1):
                at = corner + edges_s[i] * s + edges_t[j] * t
                parts.append(_quad(at, np.diff(edges_s)[i] * s, np.diff(edges_t)[j] * t))
                albedo.append(0.6)
    for i in range(columns):
        for j in range(rows):
            at = corner + (rim + i * cell) * s + (rim + j * cell) * t
            parts.append(_quad(at, cell * s, cell * t))
            albedo.append(0.05 if (i + j) % 2 == 0 else 0.9)
    lights = (
        AreaLight((-0.7, -1.4, 0.9), (0.0, 0.0, 0.0), (0.25, 0.2), 30.0),
        AreaLight((1.1, -1.2, -0.2), (0.0, 0.0, 0.0), (0.15, 0.3), 20.0),
    )
    rng = np.random.default_rng(7)
    spots = corner + rng.uniform(0.1, 0.9, (4, 2)) * size @ np.stack([s, t])
    return ImageCase(
        "board-lit" if lit else "board", camera, [surface],
        Soup(np.concatenate(parts), np.repeat(albedo, 2)), lights if lit else (),
        windows=square_windows(camera, spots, 96 if width >= 600 else 64),
    )  # fmt: skip


def _markers(centres: Float, size: float, s: Float, t: Float, out: Float) -> tuple[Float, Float]:
    """2 x 2 fields of markers as triangles, lifted off their face, and their albedo."""
    half, parts, albedo = 0.5 * size, [], []
    for centre in centres:
        for i in range(2):
            for j in range(2):
                at = centre + (i - 1) * half * s + (j - 1) * half * t + LIFT * out
                parts.append(_quad(at, half * s, half * t))
                albedo.append(0.04 if i == j else 0.9)
    return np.concatenate(parts), np.repeat(albedo, 2)


def _crane(width: int, lit: bool) -> ImageCase:
    """The tower crane of `examples/crane.toml`, unloaded, before its wall."""
    height = width * 2 // 3
    camera = Camera.from_lens((36.0, 24.0), 30.0, (width, height), (0.3, -1.02, 0.29),
                              (0.3, -0.02, 0.29))  # fmt: skip
    grid = crane()
    faces = boundary_faces(grid)
    skin = Skin(grid, faces)
    region = np.zeros(len(faces), np.int32)
    x, z = np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0])
    line = np.linspace(0.0, 1.0, 10)[:, None]
    column = np.array([0.003, -0.02, 0.025]) + line * np.array([0.0, 0.0, 0.531])
    beam = np.array([0.036, -0.02, 0.564]) + line * np.array([0.558, 0.0, 0.0])
    paints: dict[str, Paint] = {"steel": Plain(0.35)}
    frames = {}
    for number, (name, centres, size, bounds) in enumerate(
        (("column", column, 0.006, {"z_min": 0.0, "z_max": 0.562}),
         ("beam", beam, 0.004, {"z_min": 0.562})), start=1
    ):  # fmt: skip
        own = select_faces(grid, normal="-y", bounds=bounds, faces=faces)
        region[skin.numbers(own)] = number
        frames[name] = PaintFrame(np.array([0.0, -0.02, 0.0]), x, z)
        paints[name] = Markers(centres[:, [0, 2]], size, 0.04, 0.9, 0.35)
    body = skin.surface(paints, region, frames, "crane")
    corner, a, b = np.array([-0.6, 0.15, -0.36]), 1.8 * x, 1.3 * z
    static = np.array([[-0.12, 0.08], [-0.12, 0.47], [0.17, 0.11], [0.17, 0.41], [0.48, 0.11],
                       [0.48, 0.41]])  # fmt: skip
    frame = PaintFrame(np.array([0.0, 0.15, 0.0]), x, z)
    outline = _outline(corner, a, b)
    targets: dict[str, Paint] = {"wall": Markers(static, 0.012, 0.04, 0.9, 0.55)}
    wall = Surface(outline, np.array([[0, 1, 2, 3]], np.int32), targets, frames={"wall": frame})
    on_wall = np.stack([static[:, 0], np.full(len(static), 0.15), static[:, 1]], axis=1)
    parts = [
        (body.points[triangulate(body.faces)[0]], 0.35),
        (_quad(corner, a, b), 0.55),
        *(_markers(c, size, x, z, np.array([0.0, -1.0, 0.0]))
          for c, size in ((column, 0.006), (beam, 0.004), (on_wall, 0.012))),
    ]  # fmt: skip
    corners = np.concatenate([part for part, _ in parts])
    albedo = np.concatenate([np.resize(np.array(value), len(part)) for part, value in parts])
    lights = (
        AreaLight((-0.5, -2.0, 0.1), (0.3, -0.02, 0.3), (0.12, 0.08), 60.0),
        AreaLight((-1.3, -2.1, 0.05), (0.3, -0.02, 0.3), (0.12, 0.08), 60.0),
    )
    spots = np.concatenate([column[[2, 7]], beam[[3, 9]], on_wall[[3]]])
    return ImageCase(
        "crane-lit" if lit else "crane", camera, [body, wall], Soup(corners, albedo),
        lights if lit else (), windows=square_windows(camera, spots, 96),
    )  # fmt: skip


def _speckle(width: int) -> ImageCase:
    """A plate of speckle that fills the frame: discs of about 6 px."""
    height = width * 5 // 6
    camera = Camera.from_lens((36.0, 30.0), 50.0, (width, height), (0.01, -1.0, -0.02),
                              (0.0, 0.0, 0.0), up=(0.02, 0.0, 1.0))  # fmt: skip
    s, t = np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0])
    size = (0.8, 0.7)
    corner = np.array([-0.4, 0.0, -0.35])
    paint = Speckle(6.0 / camera.K[0, 0], 0.5, seed=5, dot=0.1, ground=0.9)
    plate = _outline(corner, size[0] * s, size[1] * t)
    surface = Surface(plate, np.array([[0, 1, 2, 3]]), {"plate": paint},
                      frames={"plate": PaintFrame(corner, s, t)})  # fmt: skip
    spots = np.array([[-0.2, 0.0, 0.1], [0.0, 0.0, 0.0], [0.22, 0.0, -0.17]])
    return ImageCase(
        "speckle", camera, [surface], Soup(_quad(corner, size[0] * s, size[1] * t), np.ones(2)),
        speckle=paint, windows=square_windows(camera, spots, 96),
    )  # fmt: skip


def sized(make: Callable[[int], ImageCase], widths: tuple[int, int, int]) -> Builder:
    return lambda size: make(widths[SIZES.index(size)])


IMAGE_CASES: dict[str, Builder] = {
    "board": sized(lambda w: _board(w, False), (750, 750, 2448)),
    "board-lit": sized(lambda w: _board(w, True), (750, 750, 2448)),
    "speckle": sized(_speckle, (800, 1224, 2464)),
    "crane": sized(lambda w: _crane(w, False), (1404, 2808, 5616)),
    "crane-lit": sized(lambda w: _crane(w, True), (1404, 2808, 5616)),
}


def find_image_cases(name: str = "", cases: Iterable[str] = IMAGE_CASES) -> list[str]:
    """Names of the cases that begin with ``name``. Raises InputError if there is none."""
    found = [case for case in cases if case.startswith(name)]
    if not found:
        known = ", ".join(cases)
        raise InputError(f"bench render: case; got {name!r}; expected one of {known}")
    return found
