"""Scenes of the render benchmark: gpusim's own, and sheets of many faces.

Other programs are given coloured triangles, fields and markers too, so that all render the same
shapes and no texture filter stands in for geometry; only speckle comes as a texture, as users of
those programs have it.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from gpusim.bench.image_cases import IMAGE_CASES as OWN_CASES
from gpusim.bench.image_cases import Builder, ImageCase, Soup, sized, square_windows
from gpusim.optics import AreaLight, Camera
from gpusim.surface import Surface
from gpusim.surface.paint import Plain
from gpusim.surface.surface import triangulate

__all__ = ["IMAGE_CASES", "lamp_sides"]

Array = npt.NDArray[np.float64]


def lamp_sides(lamp: AreaLight) -> tuple[Array, Array, Array]:
    """Centre of a lamp and two half sides whose cross product is the way it shines."""
    centre = np.array(lamp.position)
    axis = np.array(lamp.target) - centre
    axis /= np.linalg.norm(axis)
    across = np.cross(axis, [0.0, 0.0, 1.0])
    across /= np.linalg.norm(across)
    along = np.cross(across, axis)
    return centre, 0.5 * lamp.size[1] * along, 0.5 * lamp.size[0] * across


def _faces(width: int, count: int, fields: tuple[int, int] | None = None) -> ImageCase:
    """A wavy sheet of about ``count`` quadrilaterals, coloured like a chessboard: one by one, or
    in ``fields`` along and across of many each."""
    height = width * 2 // 3
    camera = Camera.from_lens((36.0, 24.0), 30.0, (width, height), (0.12, -1.0, 0.2),
                              (0.0, 0.0, 0.0), up=(0.1, 0.0, 1.0))  # fmt: skip
    columns = round((1.5 * count) ** 0.5)
    rows = round(count / columns)
    x, z = np.meshgrid(np.linspace(-0.55, 0.55, columns + 1), np.linspace(-0.36, 0.36, rows + 1))
    y = 0.03 * np.sin(9.0 * x) * np.cos(7.0 * z)
    points = np.stack([x, y, z], axis=-1).reshape(-1, 3)
    node = np.arange(len(points)).reshape(x.shape)
    faces = np.stack([node[:-1, :-1], node[:-1, 1:], node[1:, 1:], node[1:, :-1]], axis=-1)
    across, along = np.arange(rows), np.arange(columns)
    if fields is not None:
        along, across = along * fields[0] // columns, across * fields[1] // rows
    colour = (np.add.outer(across, along) % 2).ravel().astype(np.int32)
    quads = np.asarray(faces.reshape(-1, 4), np.int32)
    surface = Surface(points, quads, {"dark": Plain(0.1), "light": Plain(0.8)}, colour)
    triangles, source = triangulate(surface.faces)
    albedo = np.array([0.1, 0.8])[colour[source]]
    spots = np.array([[-0.2, 0.0, 0.1], [0.1, 0.0, -0.1]])
    return ImageCase(
        _faces_name(count, fields is None), camera, [surface], Soup(points[triangles], albedo),
        windows=square_windows(camera, spots, 64),
    )  # fmt: skip


def _faces_name(count: int, single: bool) -> str:
    return f"{'faces' if single else 'sheet'}-{count:.0e}".replace("+0", "")


def _faces_case(count: int, single: bool) -> Builder:
    fields = None if single else _FIELDS
    return sized(lambda width: _faces(width, count, fields), (1200, 1200, 2400))


_COUNTS = (1_000, 10_000, 100_000, 300_000, 1_000_000)
_FIELDS = (24, 16)
IMAGE_CASES: dict[str, Builder] = OWN_CASES | {
    _faces_name(count, single): _faces_case(count, single)
    for single in (True, False)
    for count in _COUNTS
}
