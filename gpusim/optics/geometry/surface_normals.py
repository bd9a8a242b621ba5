"""Normals of a surface's triangles and vertices: of the surface, whatever looks at it.

Those of the last image are kept. Cameras that look at the same surfaces one after another (a
stereo pair, exposures of a rig) find them there, as long as no vertex has moved.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np
import numpy.typing as npt

from gpusim.optics.geometry.feature_edges import corner_normals, creases, smooth_normals
from gpusim.optics.geometry.triangle_corners import CHUNK
from gpusim.surface.surface import Surface

__all__ = ["SurfaceNormals", "surface_normals"]

Array = npt.NDArray[np.float64]


class SurfaceNormals:
    """A surface's normals, found where somebody asks for them.

    ``points`` (P, 3): its vertices in the world; ``smooth_angle``: rad, see
    `gpusim.surface.surface.Surface`.
    """

    def __init__(self, surface: Surface) -> None:
        self._topology, self.smooth_angle = surface.topology, surface.smooth_angle
        # a copy: who looks for it may have moved the vertices in place
        self.points = surface.points.copy()

    @cached_property
    def area(self) -> Array:
        """(3, T): world normals of the triangles, twice as long as their areas."""
        triangles = self._topology.triangles
        result = np.empty((3, len(triangles)))
        for first in range(0, len(triangles), CHUNK):
            part = slice(first, first + CHUNK)
            corner = [triangles[part, k] for k in range(3)]
            corner_normals(self.points, corner, result[:, part])
        return result

    def creases(self, edges: npt.NDArray[np.int64] | None) -> npt.NDArray[np.bool_]:
        """Which edges of the surface are creases: of some (n,), or of all (None)."""
        if edges is None:
            return self._creases
        return creases(self._topology, self.area, self.smooth_angle, edges)

    @cached_property
    def _creases(self) -> npt.NDArray[np.bool_]:
        return creases(self._topology, self.area, self.smooth_angle, None)

    @cached_property
    def smooth(self) -> tuple[Array, npt.NDArray[np.bool_]]:
        """What `gpusim.optics.geometry.feature_edges.smooth_normals` makes of it: vertices' normals
        in the world, and which corners have their own."""
        triangles, vertices = self._topology.triangles, len(self.points)
        return smooth_normals(self.area, triangles, vertices, self.smooth_angle)

    def is_of(self, surface: Surface) -> bool:
        """Whether a surface has this shape."""
        return (
            self._topology is surface.topology
            and self.smooth_angle == surface.smooth_angle
            and np.array_equal(self.points, surface.points)
        )


_last: tuple[SurfaceNormals, ...] = ()


def surface_normals(surfaces: Sequence[Surface]) -> list[SurfaceNormals]:
    """The shapes of surfaces, which are kept until the next ones are asked for."""
    global _last
    kept = dict(enumerate(_last))
    found = []
    for number, surface in enumerate(surfaces):
        shape = kept.get(number)
        found.append(
            shape if shape is not None and shape.is_of(surface) else SurfaceNormals(surface)
        )
    _last = tuple(found)
    return found
