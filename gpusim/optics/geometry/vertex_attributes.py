"""What a surface's vertices carry: places, normals, paint coordinates.

Normals are of the surface, whatever looks at it. Those of the last image are kept: cameras that
look at the same surfaces one after another (a stereo pair, exposures of a rig) find them there, as
long as no vertex has moved.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np

from gpusim.arrays.array_types import Bool, Float, Long
from gpusim.optics.geometry.feature_edges import (
    area_normals,
    creases,
    sharp_normals,
    smooth_normals,
)
from gpusim.optics.geometry.triangle_corners import (
    CHUNK,
    NORMAL,
    POSITION,
    REFERENCE,
    ST,
    at_corners,
)
from gpusim.surface.frames import PaintFrame, used_vertices
from gpusim.surface.surface import Surface


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
    def area(self) -> Float:
        """(3, T): world normals of the triangles, twice as long as their areas."""
        return area_normals(self.points, self._topology.triangles)

    def creases(self, edges: Long | None) -> Bool:
        """Which edges of the surface are creases: of some (n,), or of all (None)."""
        if edges is None:
            return self._creases
        return creases(self._topology, self.area, self.smooth_angle, edges)

    @cached_property
    def _creases(self) -> Bool:
        return creases(self._topology, self.area, self.smooth_angle, None)

    @cached_property
    def smooth(self) -> tuple[Float, Bool]:
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
    normals = []
    for number, surface in enumerate(surfaces):
        shape = kept.get(number)
        normals.append(
            shape if shape is not None and shape.is_of(surface) else SurfaceNormals(surface)
        )
    _last = tuple(normals)
    return normals


MAX_VERTICES_PER_TRIANGLE = 4
"""Vertices per triangle from which on those of other triangles are left out."""


def turned_corners(triangles: Long, kept: Long, turned: Bool) -> Long:
    """(3, n): vertices at each corner of triangles ``kept``, those that are ``turned`` (n,)
    the other way round."""
    away = np.flatnonzero(turned)
    whole = len(kept) == len(triangles)
    corner = triangles.T
    if not whole:
        corner = np.empty((3, len(kept)), triangles.dtype)
        for one, out in zip(triangles.T, corner, strict=True):
            np.take(one, kept, out=out, mode="clip")
    if len(away):
        corner = corner.copy() if whole else corner
        corner[1:, away] = corner[:0:-1, away]
    return corner


class VertexTable:
    """The vertices of some of a surface's triangles, those that differ from corner to corner apart.

    ``columns`` (11, V): as in `gpusim.optics.geometry.view.View`; ``corner`` (3, n): for each
    corner the vertices of the triangles; ``origin`` (V,): the surface's vertex that each is.
    """

    def __init__(self, surface: Surface, points: Float, corner: Long, only: bool) -> None:
        """Of triangles with ``corner``s (3, n); ``points`` (P, 3) in camera space.

        ``only``: leave out vertices of other triangles even if they are few.
        """
        rest = surface.rest
        self.origin: Long = np.arange(len(points))
        self.corner = corner
        if only or len(points) > MAX_VERTICES_PER_TRIANGLE * corner.shape[1]:
            self.origin = used_vertices(corner, len(points))
            self._renumber(self.origin, len(points))
            points, rest = points[self.origin], rest[self.origin]
        self.columns = np.empty((11, len(points)))
        self.columns[POSITION], self.columns[REFERENCE] = points.T, rest.T
        self.columns[ST] = self.columns[NORMAL] = 0.0

    def _renumber(self, used: Long, count: int, rows: Long | None = None, to: int = 0) -> None:
        """Vertex ``used[i]`` of ``count`` becomes ``to + i`` in triangles ``rows``, or all."""
        number = np.zeros(count, np.int64)
        number[used] = np.arange(to, to + len(used))
        if rows is None:
            self.corner = number[self.corner]
            return
        self.corner = self.corner.copy()
        self.corner[:, rows] = number[self.corner[:, rows]]

    def _copied(self, vertices: Long) -> Long:
        """The numbers of copies of some vertices."""
        first = len(self.origin)
        self.columns = np.concatenate([self.columns, self.columns[:, vertices]], axis=1)
        self.origin = np.concatenate([self.origin, self.origin[vertices]])
        return np.arange(first, len(self.origin))

    def _apart(self, rows: Long) -> Long:
        """Gives triangles ``rows`` vertices that no others have; the numbers of these."""
        if len(rows) == self.corner.shape[1]:
            return np.arange(len(self.origin))
        before = len(self.origin)
        used = used_vertices(self.corner[:, rows], before)
        copies = self._copied(used)
        self._renumber(used, before, rows, before)
        return copies

    def _own(self, rows: Long, k: Long) -> Long:
        """Gives corners ``k`` (n,) of triangles ``rows`` (n,) a vertex each; their numbers."""
        copies = self._copied(self.corner[k, rows])
        self.corner = self.corner.copy()
        self.corner[k, rows] = copies
        return copies

    def paint(self, surface: Surface, kept: Long, turned: Bool) -> None:
        """Fill in paint coordinates, of triangles ``kept`` (n,) of the surface, some ``turned``."""
        free = True
        for number in surface.extents:
            frame = surface.paint_frame(number)
            if isinstance(frame, PaintFrame) and free:
                # the first one's coordinates do no harm to triangles without a pattern
                for first in range(0, self.columns.shape[1], CHUNK):
                    part = slice(first, first + CHUNK)
                    st = frame.coordinates(self.columns[REFERENCE, part].T)
                    self.columns[ST, part] = st.T
                free = False
                continue
            rows = np.flatnonzero(surface.regions[surface.topology.source[kept]] == number)
            if isinstance(frame, PaintFrame):
                vertices = self._apart(rows)
                self.columns[ST, vertices] = frame.coordinates(
                    self.columns[REFERENCE, vertices].T
                ).T
                continue
            st = frame.of_triangles(
                surface.rest[surface.topology.triangles[kept[rows]]], kept[rows]
            )
            st[turned[rows]] = st[turned[rows]][:, [0, 2, 1]]
            for k in range(3):
                vertices = self._own(rows, np.full(len(rows), k))
                self.columns[ST, vertices] = st[:, k].T

    def paint_at(self, turned: Bool, rows: Long) -> Float:
        """Paint coordinates (m, 3, 2) at the corners of some triangles ``rows`` (m,), in the
        order that the surface has them in; ``turned``: as in `paint`."""
        st = at_corners(self.columns[ST].T, [np.take(vertices, rows) for vertices in self.corner])
        away = turned[rows]
        st[away] = st[away][:, [0, 2, 1]]
        return st

    def smooth(self, surface: Surface, shape: SurfaceNormals, kept: Long, turned: Bool) -> None:
        """Fill in world normals of triangles ``kept`` (n,) of the surface, some ``turned``."""
        normal, sharp = shape.smooth
        self.columns[NORMAL] = (
            normal if len(self.origin) == normal.shape[1] else normal[:, self.origin]
        )
        if sharp.any():
            rows, k = np.nonzero(np.stack([sharp[self.origin[c]] for c in self.corner], axis=1))
            vertex = self._own(rows, k)
            normals = sharp_normals(
                shape.area, surface.topology.triangles, sharp, kept[rows], self.origin[vertex],
                surface.smooth_angle,
            )  # fmt: skip
            self.columns[NORMAL, vertex] = normals.T
        away = np.flatnonzero(turned)
        if len(away):
            copies = self._apart(away)
            self.columns[NORMAL, copies] *= -1.0
