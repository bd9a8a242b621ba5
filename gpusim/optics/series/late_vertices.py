"""Vertices of a view that the device projects: the host finds what it is asked for, and no more."""

from __future__ import annotations

from functools import cached_property

import numpy as np
import numpy.typing as npt

from gpusim.optics.geometry.clipping import Screen
from gpusim.optics.geometry.surface_normals import Shape
from gpusim.optics.geometry.triangle_corners import (
    CHUNK,
    NORMAL,
    POSITION,
    REFERENCE,
    ST,
    at_corners,
    in_camera,
)
from gpusim.optics.geometry.vertex_positions import Vertices
from gpusim.optics.series.steady import Steady
from gpusim.surface.plane import PaintFrame

__all__ = ["LateVertices"]

Array = npt.NDArray[np.float64]
Numbers = npt.NDArray[np.int64]


class LateVertices(Vertices):
    """Those of a whole surface, or ``numbers`` (V,) of them, none with anything of its own at some
    corner. ``turned``: the triangles look away, normals are turned round.

    The same numbers as `gpusim.optics.geometry.view.look` finds.
    """

    def __init__(
        self, steady: Steady, shape: Shape, screen: Screen, turned: bool,
        numbers: Numbers | None = None,
    ) -> None:  # fmt: skip
        self._steady, self._shape, self._screen = steady, shape, screen
        self._turned, self._numbers = turned, numbers

    def _own(self, values: Array) -> Array:
        """Rows of all vertices (P, k) that are these ones'."""
        return values if self._numbers is None else values[self._numbers]

    @cached_property
    def position(self) -> Array:
        return in_camera(self._screen.camera, self._own(self._shape.points))

    @cached_property
    def place(self) -> Array:
        return self._screen.ideal(self.position)

    @property
    def about(self) -> list[npt.NDArray[np.floating]]:
        if "place" in self.__dict__:
            return super().about
        # float32 is off by a thousandth of a pixel: the image is less than 8192 px wide, and
        # vertices are near it
        camera, points = self._screen.camera, self._own(self._shape.points)
        middle = points[0]
        matrix = camera.K @ camera.camera_from_world[:3]
        rows = [(*row[:3], row[3] + row[:3] @ middle) for row in matrix]
        result = np.empty((2, len(points)), np.float32)
        for first in range(0, len(points), CHUNK):
            part = slice(first, first + CHUNK)
            x, y, z = (points[part, k] - middle[k] for k in range(3))
            own = [v.astype(np.float32) for v in (x, y, z)]
            across, down, depth = (_combined(own, row) for row in rows)
            np.divide(across, depth, out=result[0, part])
            np.divide(down, depth, out=result[1, part])
        return list(result)

    @cached_property
    def columns(self) -> Array:
        result = np.empty((11, len(self.position)))
        result[: ST.stop] = self.shown.T
        normal = self._own(self._shape.smooth[0].T)
        result[NORMAL] = -normal.T if self._turned else normal.T
        result[REFERENCE] = self._own(self._steady.rest_of(self._shape)).T
        return result.T

    @cached_property
    def shown(self) -> Array:
        result = np.zeros((ST.stop, len(self.position)))
        result[POSITION] = self.position.T
        if isinstance(self._steady.frame, PaintFrame):
            result[ST] = self._steady.frame.coordinates(
                self._own(self._steady.rest_of(self._shape))
            ).T
        return result.T

    def at_corners(self, columns: slice, corner: list[Numbers]) -> Array:
        table, corner = self._few(corner)
        values = table.columns if columns.stop is None or columns.stop > ST.stop else table.shown
        return at_corners(values[:, columns], corner)

    def places_at(self, corner: list[Numbers]) -> Array:
        table, corner = self._few(corner)
        return at_corners(table.place, corner)

    def _few(self, corner: list[Numbers]) -> tuple[LateVertices, list[Numbers]]:
        """Vertices among which those at the corners of triangles are, of few triangles no others,
        and their numbers there."""
        count = len(corner[0])
        if self._numbers is not None or 3 * count >= len(self._shape.points):
            return self, corner
        return self.some(np.concatenate(corner)), list(np.arange(3 * count).reshape(3, -1))

    def some(self, numbers: Numbers) -> LateVertices:
        own = numbers if self._numbers is None else self._numbers[numbers]
        return LateVertices(self._steady, self._shape, self._screen, self._turned, own)


def _combined(
    columns: list[npt.NDArray[np.float32]], row: tuple[float, ...]
) -> npt.NDArray[np.float32]:
    """Three ``columns`` (n,) with the factors of a ``row``, plus its last number."""
    result = columns[0] * np.float32(row[0])
    result += columns[1] * np.float32(row[1])
    result += columns[2] * np.float32(row[2])
    result += np.float32(row[3])
    return result
