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
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from gpusim.optics.camera import Camera
from gpusim.optics.corner_table import corner_table, turned_corners
from gpusim.optics.corners import (
    CHUNK,
    POSITION,
    ST,
    at_corners,
    barycentric_planes,
    corner_range,
    in_camera,
)  # fmt: skip
from gpusim.optics.cutting import (
    LONGEST_EDGE,
    SHORT_EDGE,
    Pieces,
    Screen,
    clip,
    extent,
    joined,
    split,
    without_area,
)  # fmt: skip
from gpusim.optics.distortion_map import distortion_map
from gpusim.optics.grazing import grazing_reach
from gpusim.optics.outline import area_normals, feature_edges, smooth_normals, unit
from gpusim.optics.paint_edges import speckle_jumps
from gpusim.optics.sparse import sparse_excess
from gpusim.surface.paint import Paint
from gpusim.surface.speckle import Speckle
from gpusim.surface.surface import Surface

__all__ = ["FIXED", "LONGEST_EDGE", "RegionPaint", "View", "look"]

Array = npt.NDArray[np.float64]

FIXED = 65536
"""Steps of a screen coordinate in fixed point per pixel."""

NEAR = 1e-4
"""Near plane, as a share of the farthest depth in view."""


FLAT = 1e-9
"""Share of the depth by which corners may lie off a plane."""


@dataclass(frozen=True, eq=False)
class RegionPaint:
    """A paint with the extent of its region in paint coordinates and the largest pixel there.

    ``seen`` (2, 2): lowest and highest coordinates of what may be in the image. ``grazing``: some
    footprints are larger than ``reach``, which suits the usual ones.
    """

    paint: Paint
    low: npt.NDArray[np.float64]
    high: npt.NDArray[np.float64]
    reach: float
    seen: npt.NDArray[np.float64] | None = None
    grazing: bool = False


@dataclass(frozen=True, eq=False)
class View:
    """The triangles that a camera may see.

    ``corners`` (T, 3, 11): camera-space position, paint coordinates, world normal, undeformed
    world position per corner. ``screen`` (T, 3, 2) px, through the lens. ``paint`` and ``face``
    (T,): index into ``paints`` and into the faces of all surfaces in order. ``edges`` (E, 2, 2):
    the visible silhouettes, creases and region borders on screen, px. ``planes`` (T, 3, 3): row i
    has barycentric i over depth as an affine function of the ideal position [x, y, 1].
    ``footprint`` (T,): half the width of the largest pixel on each triangle, in paint coordinates;
    0 on plain paint. ``body`` (T,): number of the surface, ascending. ``edge_source`` (E, 2): the
    triangle that each edge is of, and its corner that it begins at.
    """

    camera: Camera
    corners: npt.NDArray[np.float64]
    screen: npt.NDArray[np.float64]
    paint: npt.NDArray[np.int32]
    face: npt.NDArray[np.int32]
    paints: tuple[RegionPaint, ...]
    edges: npt.NDArray[np.float64]
    planes: npt.NDArray[np.float64]
    footprint: npt.NDArray[np.float64]
    body: npt.NDArray[np.int32]
    edge_source: npt.NDArray[np.int64]

    @property
    def count(self) -> int:
        """Number of triangles."""
        return len(self.corners)

    @cached_property
    def ideal(self) -> Array:
        """(T, 3, 2) px: ``screen`` without the lens's distortion."""
        if self.camera.lens is None:
            return self.screen
        return Screen(self.camera).ideal(self.corners[:, :, POSITION])

    @cached_property
    def flat(self) -> bool:
        """Whether all triangles are of one body and in one plane: none of them hides another."""
        if not self.count or self.body[0] != self.body[-1]:
            return False
        points = self.corners[:, :, POSITION].reshape(-1, 3)
        a, b = points[1::3] - points[::3], points[2::3] - points[::3]
        normal = np.cross(a, b)
        normal = normal[np.argmax(np.einsum("ij,ij->i", normal, normal))]
        away = np.abs((points - points[0]) @ normal)
        # far less than the depth of a triangle in front of another could be told by
        return bool(away.max() <= FLAT * np.linalg.norm(normal) * points[:, 2].min())

    def over_rows(self, first: int, stop: int) -> View:
        """The triangles and edges that touch rows ``first`` … ``stop - 1``; others are left out."""
        low, high = corner_range(self.screen[:, :, 1])
        own = (high > first - 1.0) & (low < stop)
        y = self.edges[:, :, 1]
        near = (np.maximum(y[:, 0], y[:, 1]) > first - 1.0) & (np.minimum(y[:, 0], y[:, 1]) < stop)
        source = self.edge_source[near]
        source[:, 0] = (np.cumsum(own) - 1)[source[:, 0]]
        return replace(
            self, corners=self.corners[own], screen=self.screen[own], paint=self.paint[own],
            face=self.face[own], edges=self.edges[near], planes=self.planes[own],
            footprint=self.footprint[own], body=self.body[own], edge_source=source,
        )  # fmt: skip

    def inverse_depth(self) -> npt.NDArray[np.float64]:
        """1 / z of every corner, (T, 3)."""
        result: npt.NDArray[np.float64] = 1.0 / self.corners[:, :, 2]
        return result

    def raster_depth(self) -> tuple[float, npt.NDArray[np.float32]]:
        """What 1 / z is scaled by to stay below 1 in a depth buffer, and 1 / z per corner, flat."""
        if not self.count:
            return 1.0, np.zeros(3, np.float32)
        inverse = self.inverse_depth()
        return 0.999 / float(inverse.max()), inverse.astype(np.float32).reshape(-1)

    def fixed(self) -> npt.NDArray[np.int32]:
        """Screen positions in fixed point, (T, 3, 2)."""
        result = np.empty(self.screen.shape, np.int32)
        for first in range(0, self.count, CHUNK):
            part = slice(first, first + CHUNK)
            result[part] = np.rint(self.screen[part] * FIXED)
        return result


def look(surfaces: Sequence[Surface], camera: Camera, lit: bool) -> View:
    """Prepare ``surfaces`` for ``camera``; normals are computed only where they are used.

    Faces of closed surfaces that look away are dropped; those of open ones are turned round.
    """
    screen = Screen(camera)
    at = [in_camera(camera, surface.points) for surface in surfaces]
    far = max((float(points[:, 2].max()) for points in at), default=0.0)
    empty: npt.NDArray[np.int64] = np.zeros(0, np.int64)
    parts = [Pieces(np.zeros((0, 3, 11)), np.zeros((0, 3), bool), empty)]
    places = [np.zeros((0, 3, 2))]
    paint_ids: list[npt.NDArray[np.integer]] = [empty]
    face_ids: list[npt.NDArray[np.integer]] = [empty]
    paints: list[RegionPaint] = []
    body_ids: list[npt.NDArray[np.integer]] = [empty]
    first_face = 0
    for number, (surface, points) in enumerate(zip(surfaces, at, strict=True)):
        if far > 0.0:
            pieces, place = _pieces(surface, points, screen, NEAR * far, lit)
            source = surface.topology.source[pieces.source]
            paint_ids.append(len(paints) + surface.regions[source])
            face_ids.append(first_face + source)
            body_ids.append(np.full(len(source), number))
            parts.append(pieces)
            places.append(place)
        for region, paint in enumerate(surface.paints.values()):
            low, high = surface.extents.get(region, (np.zeros(2), np.zeros(2)))
            paints.append(RegionPaint(paint, low, high, 0.0))
        first_face += len(surface.faces)
    pieces, place = Pieces.joined(parts), joined(places)
    shown, k = np.nonzero(pieces.shows)
    planes = barycentric_planes(pieces.corners, camera)
    number_of_paint = np.concatenate(paint_ids).astype(np.int32)
    regions, footprint = _with_reach(paints, pieces.corners, planes, number_of_paint, place, camera)
    return View(
        camera, pieces.corners, place, number_of_paint, np.concatenate(face_ids).astype(np.int32),
        tuple(regions),
        np.stack([place[shown, k], place[shown, (k + 1) % 3]], axis=1), planes, footprint,
        np.concatenate(body_ids).astype(np.int32), np.stack([shown, k], axis=1),
    )  # fmt: skip


def _pieces(
    surface: Surface, points: Array, screen: Screen, near: float, lit: bool
) -> tuple[Pieces, Array]:
    """What may be seen of a surface whose vertices are at camera-space ``points``."""
    topology = surface.topology
    triangles = topology.triangles
    area = area_normals(points, triangles)
    x, y, z = (np.take(points[:, axis], triangles[:, 0]) for axis in range(3))
    front = area[0] * x + area[1] * y + area[2] * z < 0
    ahead = points[:, 2] > near
    ideal = np.full((len(points), 2), np.inf)
    ideal[ahead] = screen.ideal(points[ahead])
    seen = _may_be_seen(triangles, ahead, ideal, screen)
    keep = seen & front if topology.closed else seen
    direction = unit(area)
    angle, smooth = surface.smooth_angle, None
    if lit:
        smooth = smooth_normals(area, direction, triangles, len(points), angle)
    sharp = None if smooth is None else smooth[1]
    shows = feature_edges(topology, front, surface.regions, direction, angle, keep, sharp)
    kept = np.flatnonzero(keep)
    corner = turned_corners(triangles, kept, front)
    place = None
    if ahead.all():
        place = at_corners(ideal, corner)
        across, down = ([place[:, k, axis] for k in range(3)] for axis in (0, 1))
        # as `split` would do later, with more to carry
        none = without_area(across, down)
        if none.any():
            kept, place = kept[~none], None
            corner = turned_corners(triangles, kept, front)
    table = corner_table(surface, points, area, smooth, kept, corner, front, screen.camera)
    every = slice(None) if len(kept) == len(triangles) else kept
    for number, paint in enumerate(surface.paints.values()):
        if isinstance(paint, Speckle):
            own = surface.regions[topology.source[kept]] == number
            st = table[:, :, ST].copy()
            st[~front[kept]] = st[~front[kept]][:, [0, 2, 1]]
            shows[speckle_jumps(topology, kept, own, st, points, ideal, paint)] = True
    flags = shows[topology.edge[every]]
    turned = ~front[every]
    if turned.any():
        flags[turned] = flags[turned][:, [2, 1, 0]]
    pieces = Pieces(table, flags, kept)
    out = ~ahead | screen.beyond(ideal)
    crossing = np.zeros(len(kept), bool)
    if out.any():
        crossing = out[corner[0]] | out[corner[1]] | out[corner[2]]
    if crossing.any():
        cut = clip(pieces[crossing], np.array([0.0, 0.0, 1.0]), near)
        for normal in screen.guards():
            cut = clip(cut, normal, 0.0)
        pieces = Pieces.joined([pieces[~crossing], cut])
    elif ahead.all() and screen.camera.lens is None:
        place = at_corners(ideal, corner) if place is None else place
        if extent(place) <= SHORT_EDGE:
            # what `split` would find, which has been seen to already
            return pieces, place
    return split(pieces, screen, sparse_excess(surface, ST))


def _may_be_seen(
    triangles: npt.NDArray[np.int64], ahead: npt.NDArray[np.bool_], ideal: Array, screen: Screen
) -> npt.NDArray[np.bool_]:
    """(T,) whether triangles are at least partly ahead and not wholly beside the image."""
    # a bit for every side that a corner is beside; one behind the camera is on no side
    sides = np.zeros(len(ideal), np.uint8)
    for axis in range(2):
        value = ideal[:, axis]
        sides |= (value <= screen.low[axis]).view(np.uint8) << np.uint8(2 * axis)
        sides |= (value >= screen.high[axis]).view(np.uint8) << np.uint8(2 * axis + 1)
    sides *= ahead.view(np.uint8)
    corner = [triangles[:, k] for k in range(3)]
    result: npt.NDArray[np.bool_]
    result = (sides[corner[0]] & sides[corner[1]] & sides[corner[2]]) == 0
    if not ahead.all():
        result &= ahead[corner[0]] | ahead[corner[1]] | ahead[corner[2]]
    return result


def _with_reach(
    paints: list[RegionPaint],
    corners: Array,
    planes: Array,
    paint: npt.NDArray[np.int32],
    place: Array,
    camera: Camera,
) -> tuple[list[RegionPaint], Array]:
    """Half the largest pixel footprint of every patterned region and (T,) of every triangle."""
    bends = distortion_map(camera)
    stretch = 1.0 if bends is None else bends.stretch
    result, widest = [], np.zeros(len(paint))
    for number, region in enumerate(paints):
        extent = float((region.high - region.low).max())
        rows = np.flatnonzero(paint == number) if extent > 0.0 else np.zeros(0, np.int64)
        if len(rows):
            whole = len(rows) == len(paint)
            starts = range(0, len(rows), CHUNK)
            parts = [slice(k, k + CHUNK) if whole else rows[k : k + CHUNK] for k in starts]
            st = [corners[:, k, ST] if whole else corners[:, k, ST][rows] for k in range(3)]
            seen = np.stack(
                [np.min([v.min(axis=0) for v in st], axis=0),
                 np.max([v.max(axis=0) for v in st], axis=0)]
            )  # fmt: skip
            limit = None
            if isinstance(region.paint, Speckle):
                slope = stretch * _footprints(corners[rows], planes[rows])
                half = 0.5 * np.abs(slope).sum(axis=-1).max(axis=-1)
                widest[rows] = half.max(axis=1)
                reach = float(half.max())
                image = (camera.width, camera.height)
                limit = grazing_reach(region.paint, half, slope, place[rows], image)
            else:
                reach = stretch * max(_largest_footprint(corners, planes, part) for part in parts)
            reach = min(reach, extent) if limit is None else limit
            region = replace(region, reach=reach, seen=seen, grazing=limit is not None)
        result.append(region)
    return result, widest


def _footprints(corners: Array, planes: Array) -> Array:
    """(n, 3, 2, 2): change of s and t per column and row at the corners of triangles."""
    st = corners[:, :, ST]
    scaled = np.swapaxes(st, 1, 2) @ planes
    slope = scaled[:, None, :, :2] - st[..., None] * planes.sum(axis=1)[:, None, None, :2]
    result: Array = slope * corners[:, :, 2, None, None]
    return result


def _largest_footprint(corners: Array, planes: Array, part: slice | npt.NDArray[np.int64]) -> float:
    """Half the largest pixel in paint coordinates at the corners of some triangles."""
    basis = [[planes[:, i, k][part] for k in (0, 1)] for i in range(3)]
    weight = [basis[0][k] + basis[1][k] + basis[2][k] for k in (0, 1)]
    depth = [corners[:, corner, 2][part] for corner in range(3)]
    most = 0.0
    for axis in (ST.start, ST.start + 1):
        value = [corners[:, k, axis][part] for k in range(3)]
        slope = [sum(value[i] * basis[i][k] for i in range(3)) for k in (0, 1)]
        for corner in range(3):
            size = np.abs(slope[0] - value[corner] * weight[0])
            size += np.abs(slope[1] - value[corner] * weight[1])
            most = max(most, float((size * depth[corner]).max()))
    return 0.5 * most
