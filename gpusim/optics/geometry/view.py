"""Surfaces as one camera sees them: triangles in float64, clipped, culled, and set up for shading.

Everything that decides where an edge falls is computed here in float64. The device receives
screen positions in fixed point (1/65536 px) and, per triangle, affine functions of the pixel
relative to an anchor pixel inside the triangle, so that float32 evaluates them to 1e-5 px at any
image size. With b = M^-1 D [x, y, 1] (M: the corners in camera space as columns, D: the ray
matrix) the reciprocal depth is the sum of b and an attribute a is (a . b) / sum(b) (Olano and
Greer, "Triangle scan conversion using 2D homogeneous coordinates", 1997).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial

import numpy as np

from gpusim.arrays.array_types import Bool, Float, Int, Long, Single
from gpusim.optics.camera.pinhole import Camera
from gpusim.optics.geometry.clipping import (
    SURELY_SHORT,
    ClippedTriangles,
    ImagePlane,
    clip,
    split,
)
from gpusim.optics.geometry.culling import cull
from gpusim.optics.geometry.feature_edges import area_normals, feature_edges
from gpusim.optics.geometry.index_buffer import IndexedTriangles, whole_triangles
from gpusim.optics.geometry.pattern_seams import grain_of, speckle_jumps
from gpusim.optics.geometry.pixel_footprint import RegionPaint, regions_of, with_reach
from gpusim.optics.geometry.triangle_corners import (
    POSITION,
    at_corners,
    barycentric_planes,
    corner_range,
    in_camera,
    parts,
    products,
)
from gpusim.optics.geometry.vertex_attributes import (
    SurfaceNormals,
    VertexTable,
    surface_normals,
    turned_corners,
)
from gpusim.surface.frames import PaintFrame
from gpusim.surface.surface import Surface

FIXED = 65536
"""Steps of a screen coordinate in fixed point per pixel."""

NEAR = 1e-4
"""Near plane, as a share of the farthest depth in view."""

MIN_TRIANGLES_FOR_SHARING = 2000
"""From which on triangles that aren't cut are told from the others, and share their vertices."""

SAMPLED = 4096
"""Triangles that tell how large they are on average."""

NO_PLACES, NO_SOURCE = np.zeros((0, 3, 2)), np.zeros(0, np.int64)

ALL = slice(None)
Rows = slice | Long

PLANE_TOLERANCE = 1e-9
"""Share of the depth by which corners may lie off a plane."""


@dataclass(frozen=True, eq=False)
class View:
    """The triangles that a camera may see.

    ``vertices`` (V, 11): camera-space position, paint coordinates, world normal, undeformed world
    position; ``place`` (V, 2) px, through the lens. ``corner`` (T, 3): vertices of each triangle;
    those of some of its corners may be no other triangle's. ``paint`` and ``face`` (T,):
    index into ``paints`` and into the faces of all surfaces in order. ``regions``: ``paints`` of
    which not all is known yet; ``found``: these and ``footprint`` where they are known. ``edges``
    (E, 2, 2): the visible silhouettes, creases and region borders on screen, px. ``body`` (T,):
    number of the surface, ascending. ``edge_source`` (E, 2): the triangle that each edge is of, and
    its corner that it begins at. ``extent``: px, no box round a triangle has a longer side.
    ``source`` (T,): of what `look` makes, index into the triangles of all surfaces in order.
    ``origin`` (3,): where what was looked at has its zero, the undeformed positions excepted.
    """

    camera: Camera
    vertices: Float
    place: Float
    corner: Long
    paint: Int
    face: Int
    regions: tuple[RegionPaint, ...]
    edges: Float
    body: Int
    edge_source: Long
    extent: float
    found: tuple[tuple[RegionPaint, ...], Float] | None = None
    source: Long = field(default_factory=NO_SOURCE.copy)
    origin: Float = field(default_factory=partial(np.zeros, 3))

    @property
    def count(self) -> int:
        """Number of triangles."""
        return len(self.corner)

    @cached_property
    def _found(self) -> tuple[tuple[RegionPaint, ...], Float]:
        return self.found or with_reach(
            self.regions, self.vertices, self.place, self.ideal_place, self.corner, self.paint,
            self.camera,
        )  # fmt: skip

    @property
    def paints(self) -> tuple[RegionPaint, ...]:
        """The paints of all surfaces' regions in order, with the largest pixel on each."""
        return self._found[0]

    @property
    def footprint(self) -> Float:
        """(T,): half the width of the largest pixel on each triangle, in paint coordinates; 0 where
        the paint isn't speckle, or none of many is too large for the usual tables."""
        return self._found[1]

    @cached_property
    def corners(self) -> Float:
        """(T, 3, 11): ``vertices`` at every corner; large, see `corners_of`."""
        return self.corners_of(slice(None))

    def corners_of(self, triangles: Rows, columns: slice = ALL) -> Float:
        """(n, 3, …): those of some triangles, or some ``columns`` of them."""
        return at_corners(self.vertices[:, columns], self._vertices_of(triangles))

    @cached_property
    def screen(self) -> Float:
        """(T, 3, 2) px: ``place`` at every corner."""
        return self.screen_of(slice(None))

    def screen_of(self, triangles: Rows) -> Float:
        """(n, 3, 2) px: those of some triangles."""
        return at_corners(self.place, self._vertices_of(triangles))

    def _vertices_of(self, triangles: Rows) -> list[Long]:
        """The vertices (n,) of some triangles by corner: rows of three take twice as long."""
        if isinstance(triangles, slice):
            return list(self.corner[triangles].T)
        return [np.take(vertices, triangles) for vertices in self.corner.T]

    def planes_of(self, triangles: Rows) -> Float:
        """(n, 3, 3) of some triangles: row i has barycentric i over depth as an affine function of
        the ideal position [x, y, 1]."""
        return barycentric_planes(self.corners_of(triangles, POSITION), self.camera)

    @cached_property
    def ideal(self) -> Float:
        """(T, 3, 2) px: ``screen`` without the lens's distortion."""
        return at_corners(self.ideal_place, list(self.corner.T))

    @cached_property
    def ideal_place(self) -> Float:
        """(V, 2) px: ``place`` without the lens's distortion."""
        if self.camera.lens is None:
            return self.place
        return ImagePlane(self.camera).ideal(self.vertices[:, POSITION])

    @cached_property
    def flat(self) -> bool:
        """Whether all triangles are of one body and in one plane: none of them hides another."""
        if not self.count or self.body[0] != self.body[-1]:
            return False
        corners = self.corners_of(ALL, POSITION)
        normals = area_normals(self.vertices[:, POSITION], self.corner)
        normal = normals[:, np.argmax(products(normals, normals))]
        away = [np.abs(products((corners[:, k] - corners[0, 0]).T, normal)).max() for k in range(3)]
        # far less than the depth of a triangle in front of another could be told by
        return bool(max(away) <= PLANE_TOLERANCE * np.linalg.norm(normal) * corners[:, :, 2].min())

    @cached_property
    def box(self) -> tuple[Float, Float]:
        """(T, 2) px: first and last place of every triangle, column by column in memory."""
        low, high = (np.empty((2, self.count)).T for _ in range(2))
        for part in parts(self.count):
            low[part], high[part] = corner_range(self.screen_of(part))
        return low, high

    @cached_property
    def mean_pixels(self) -> float:
        """How many pixels the triangles (some of them, if they are many) cover each."""
        corners = self.screen_of(slice(None, None, -(-max(self.count, 1) // SAMPLED)))
        a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
        area = np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])
        return 0.5 * float(area.mean()) if len(area) else 0.0

    def over_rows(self, first: int, stop: int) -> View:
        """The triangles and edges that touch rows ``first`` … ``stop - 1``; others are left out."""
        in_rows = (self.box[1][:, 1] > first - 1.0) & (self.box[0][:, 1] < stop)
        y = self.edges[:, :, 1]
        near = (np.maximum(y[:, 0], y[:, 1]) > first - 1.0) & (np.minimum(y[:, 0], y[:, 1]) < stop)
        source = self.edge_source[near]
        source[:, 0] = (np.cumsum(in_rows) - 1)[source[:, 0]]
        return replace(
            self, corner=self.corner[in_rows], paint=self.paint[in_rows], face=self.face[in_rows],
            edges=self.edges[near], body=self.body[in_rows], edge_source=source,
            source=self.source[in_rows], found=(self.paints, self.footprint[in_rows]),
        )  # fmt: skip

    def some(self, triangles: Long) -> View:
        """The view of some triangles (n,) that share no vertices, without edges."""
        corner = self.corner[triangles].reshape(-1)
        return replace(
            self, vertices=self.vertices.T[:, corner].T, place=self.place.T[:, corner].T,
            corner=np.arange(len(corner)).reshape(-1, 3), paint=self.paint[triangles],
            face=self.face[triangles], body=self.body[triangles], edges=self.edges[:0],
            edge_source=self.edge_source[:0], source=self.source[:0],
        )  # fmt: skip

    def inverse_depth(self, triangles: Long | None = None) -> Float:
        """1 / z of every corner, (T, 3), or of those of some ``triangles`` (n,), (n, 3)."""
        if triangles is not None:
            depth = self.vertices[:, 2]
            return 1.0 / np.stack([np.take(depth, v) for v in self._vertices_of(triangles)]).T
        return np.take(1.0 / self.vertices[:, 2], self.corner)

    def raster_depth(self) -> tuple[float, Single]:
        """What 1 / z is scaled by to stay below 1 in a depth buffer, and 1 / z of every vertex."""
        if not self.count:
            return 1.0, np.zeros(1, np.float32)
        inverse = 1.0 / self.vertices[:, 2]
        return 0.999 / float(inverse.max()), inverse.astype(np.float32)

    def rays(self) -> Float:
        """(3, 3): columns x, y, 1 of the world-space ray of unit depth through a pixel."""
        result: Float = self.camera.camera_from_world[:3, :3].T @ self.camera.ray_matrix()
        return result

    def fixed(self) -> Int:
        """Screen positions of the vertices in fixed point, (V, 2), one at least."""
        result = np.zeros((max(len(self.place), 1), 2), np.int32)
        for fixed_column, column in zip(result.T, self.place.T, strict=True):
            fixed_column[: len(column)] = np.rint(column * FIXED)
        return result


def look(surfaces: Sequence[Surface], camera: Camera, lit: bool) -> View:
    """Prepare ``surfaces`` for ``camera``; normals are computed only where they are used.

    Faces of closed surfaces that look away are dropped; those of open ones are turned round.
    """
    screen = ImagePlane(camera)
    at = [in_camera(camera, surface.points) for surface in surfaces]
    far = max((float(points[:, 2].max()) for points in at), default=0.0)
    none = ClippedTriangles(np.zeros((0, 3, 11)), np.zeros((0, 3), bool), NO_SOURCE)
    parts = [IndexedTriangles.of(none, NO_PLACES)]
    paint_ids: list[Int] = []
    face_ids: list[Int] = []
    paints: list[RegionPaint] = []
    body_ids: list[Int] = []
    sources, first, first_face = [NO_SOURCE], 0, 0
    shapes = surface_normals(surfaces)
    for number, (surface, shape, points) in enumerate(zip(surfaces, shapes, at, strict=True)):
        if far > 0.0:
            part = _seen_of(surface, shape, points, screen, NEAR * far, lit)
            source = np.take(surface.topology.source, part.source, mode="clip")
            if len(surface.paints) == 1:
                paint_ids.append(np.full(len(source), len(paints), np.int32))
            else:
                regions = np.take(surface.regions, source, mode="clip")
                paint_ids.append(regions + np.int32(len(paints)))
            face_ids.append(source + np.int32(first_face) if first_face else source)
            body_ids.append(np.full(len(source), number, np.int32))
            sources.append(part.source + first)
            parts.append(part)
        paints += regions_of(surface)
        first, first_face = first + len(surface.topology.triangles), first_face + len(surface.faces)
    all_of = IndexedTriangles.joined(parts)
    place, corner = all_of.place, all_of.corner
    shown, k = np.divmod(np.flatnonzero(all_of.shows), 3)
    ends = [place[corner[shown, j]] for j in (k, (k + 1) % 3)]
    return View(
        camera, all_of.vertices, place, corner, _joined(paint_ids), _joined(face_ids),
        tuple(paints), np.stack(ends, axis=1), _joined(body_ids), np.stack([shown, k], axis=1),
        all_of.extent, source=np.concatenate(sources),
    )  # fmt: skip


def _joined(parts: list[Int]) -> Int:
    """Several in one; one alone as it is."""
    return parts[0] if len(parts) == 1 else np.concatenate([np.zeros(0, np.int32), *parts])


def _seen_of(
    surface: Surface,
    shape: SurfaceNormals,
    points: Float,
    screen: ImagePlane,
    near: float,
    lit: bool,
) -> IndexedTriangles:
    """What may be seen of a surface whose vertices are at camera-space ``points``."""
    topology = surface.topology
    triangles = topology.triangles
    ahead = points[:, 2] > near
    if ahead.all():
        ideal = screen.ideal(points)
    else:
        ideal = np.full((len(points), 2), np.inf)
        ideal[ahead] = screen.ideal(points[ahead])
    culled = cull(
        surface.points, lambda: shape.area, triangles, ideal, ahead, topology.closed, screen
    )  # fmt: skip
    front = culled.front
    kept = np.flatnonzero(culled.keep)
    turned = ~(front if len(kept) == len(front) else np.take(front, kept, mode="clip"))
    corner = turned_corners(triangles, kept, turned)
    out = ~ahead | screen.beyond(ideal)
    crossing = np.zeros(len(kept), bool)
    if out.any():
        crossing = out[corner[0]] | out[corner[1]] | out[corner[2]]
    # then `split` would find nothing that hasn't been seen to already
    straight = not crossing.any() and ahead.all() and screen.camera.lens is None
    untouched = straight and culled.extent <= SURELY_SHORT
    table = VertexTable(surface, points, corner, bool(out.any()))
    shows = feature_edges(
        topology, front, surface.regions, shape.creases, culled.keep,
        shape.smooth[1] if lit else None, surface.extents,
    )  # fmt: skip
    table.paint(surface, kept, turned)
    if lit:
        table.smooth(surface, shape, kept, turned)
    for number, paint in enumerate(surface.paints.values()):
        if number in surface.extents and (grain := grain_of(paint, surface.paint_frame(number))):
            in_region = surface.regions[topology.source[kept]] == number
            plane = isinstance(surface.paint_frame(number), PaintFrame)
            st_of = partial(table.paint_at, turned)
            jumps = speckle_jumps(topology, kept, in_region, st_of, points, ideal, grain, plane)
            shows[jumps] = True
    flags = topology.sides(shows, kept)
    if turned.any():
        flags[turned] = flags[turned][:, [2, 1, 0]]
    place = np.take(ideal.T, table.origin, axis=1).T
    found = IndexedTriangles(table.columns.T, place, table.corner.T, flags, kept, culled.extent)
    return found if untouched else _clipped(found, screen, near, crossing)


def _clipped(
    triangles: IndexedTriangles, screen: ImagePlane, near: float, crossing: Bool
) -> IndexedTriangles:
    """What is within the view frustum, at its place through the lens; ``crossing`` (T,): which
    have to be clipped."""
    left, parts = np.ones(len(triangles.source), bool), []
    if len(left) >= MIN_TRIANGLES_FOR_SHARING:
        whole, done = whole_triangles(triangles, screen, crossing)
        left, parts = ~done, [whole]
        if not left.any():
            return whole
    pieces = triangles.pieces(left)
    crossing = crossing[left]
    if crossing.any():
        cut = clip(pieces[crossing], np.array([0.0, 0.0, 1.0]), near)
        for normal in screen.guards():
            cut = clip(cut, normal, 0.0)
        pieces = ClippedTriangles.joined([pieces[~crossing], cut])
    return IndexedTriangles.joined([*parts, IndexedTriangles.of(*split(pieces, screen))])
