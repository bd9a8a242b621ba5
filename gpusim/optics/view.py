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
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from gpusim.errors import InputError
from gpusim.optics.camera import Camera
from gpusim.optics.outline import feature_edges, smooth_normals
from gpusim.surface.paint import Paint
from gpusim.surface.surface import Surface, triangulate

__all__ = ["FIXED", "RegionPaint", "View", "look"]

FIXED = 65536
"""Steps of a screen coordinate in fixed point per pixel."""

LONGEST_EDGE = 512.0
"""px; longer edges are split so that float32 offsets from the anchor stay exact enough."""

NEAR = 1e-4
"""Near plane, as a share of the farthest depth in view."""

# columns of the attribute table that travels through clipping and splitting
POSITION, ST, NORMAL, REFERENCE = slice(0, 3), slice(3, 5), slice(5, 8), slice(8, 11)


@dataclass(frozen=True, eq=False)
class RegionPaint:
    """A paint with the extent of its region in paint coordinates and the largest pixel there."""

    paint: Paint
    low: npt.NDArray[np.float64]
    high: npt.NDArray[np.float64]
    reach: float


@dataclass(frozen=True, eq=False)
class View:
    """The triangles that a camera may see.

    ``corners`` (T, 3, 11): camera-space position, paint coordinates, world normal, undeformed
    world position per corner. ``screen`` (T, 3, 2) px. ``paint`` and ``face`` (T,): index into
    ``paints`` and into the faces of all surfaces in order. ``edges`` (E, 2, 2): the visible
    silhouettes, creases and region borders on screen, px.
    """

    camera: Camera
    corners: npt.NDArray[np.float64]
    screen: npt.NDArray[np.float64]
    paint: npt.NDArray[np.int32]
    face: npt.NDArray[np.int32]
    paints: tuple[RegionPaint, ...]
    edges: npt.NDArray[np.float64]

    @property
    def count(self) -> int:
        """Number of triangles."""
        return len(self.corners)

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
        return np.rint(self.screen * FIXED).astype(np.int32)


def look(surfaces: Sequence[Surface], camera: Camera, lit: bool) -> View:
    """Prepare ``surfaces`` for ``camera``; normals are computed only where they are used.

    Faces of closed surfaces that look away are dropped; those of open ones are turned round.
    """
    tables, paint_ids, face_ids, edges = [], [], [], []
    paints: list[RegionPaint] = []
    first_face = 0
    far = max((float(camera.to_camera(s.points)[:, 2].max()) for s in surfaces), default=0.0)
    near = NEAR * far
    for surface in surfaces:
        if not far > 0.0:
            break
        triangles, source = triangulate(surface.faces)
        camera_points = camera.to_camera(surface.points)
        positions = camera_points[triangles]
        normal = np.cross(positions[:, 1] - positions[:, 0], positions[:, 2] - positions[:, 0])
        front = np.sum(normal * positions[:, 0], axis=1) < 0.0
        outline = feature_edges(
            triangles, source, front, surface.regions[source], normal, surface.smooth_angle
        )
        segments = _clip_segments(camera_points[outline.edges], near)
        edges.append(_project(camera, segments))
        table = np.zeros((len(triangles), 3, 11))
        table[:, :, POSITION] = positions
        table[:, :, REFERENCE] = surface.rest[triangles]
        if lit:
            table[:, :, NORMAL] = smooth_normals(surface.points, triangles, surface.smooth_angle)
        paint = (len(paints) + surface.regions[source]).astype(np.int32)
        keep = front if outline.closed else np.ones(len(front), bool)
        paints += [_region(surface, index, table, paint, len(paints)) for index in
                   range(len(surface.paints))]  # fmt: skip
        turned = ~front & keep
        table[turned] = table[turned][:, [0, 2, 1]]
        table[turned, :, NORMAL] *= -1.0
        tables.append(table[keep])
        paint_ids.append(paint[keep])
        face_ids.append((first_face + source[keep]).astype(np.int32))
        first_face += len(surface.faces)
    if not tables:
        empty = np.zeros(0, np.int32)
        return View(
            camera, np.zeros((0, 3, 11)), np.zeros((0, 3, 2)), empty, empty, tuple(paints),
            np.zeros((0, 2, 2)),
        )  # fmt: skip
    corners, index = _clip_triangles(np.concatenate(tables), near)
    corners, index, screen = _split_long(corners, index, camera)
    paint = np.concatenate(paint_ids)[index]
    paints = _with_reach(paints, corners, screen, paint, camera)
    return View(
        camera, corners, screen, paint, np.concatenate(face_ids)[index], tuple(paints),
        np.concatenate(edges),
    )  # fmt: skip


def _region(
    surface: Surface,
    region: int,
    table: npt.NDArray[np.float64],
    paint_of: npt.NDArray[np.int32],
    first: int,
) -> RegionPaint:
    """Fill in the paint coordinates of a region's triangles, and find their extent."""
    paint = list(surface.paints.values())[region]
    zero = np.zeros(2)
    rows = np.flatnonzero(paint_of == first + region)
    if not len(rows) or paint.features(zero, zero) is None:
        return RegionPaint(paint, zero, zero, 0.0)
    st = surface.paint_frame(region).of_triangles(table[rows][:, :, REFERENCE], rows)
    table[rows, :, ST] = st
    flat = st.reshape(-1, 2)
    return RegionPaint(paint, flat.min(axis=0), flat.max(axis=0), 0.0)


def _project(camera: Camera, points: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Camera-space points (…, 3) with z > 0 to pixels (…, 2)."""
    homogeneous = points @ camera.K.T
    result: npt.NDArray[np.float64] = homogeneous[..., :2] / homogeneous[..., 2:]
    return result


def _clip_segments(segments: npt.NDArray[np.float64], near: float) -> npt.NDArray[np.float64]:
    z = segments[:, :, 2]
    segments, z = segments[(z > near).any(axis=1)], z[(z > near).any(axis=1)]
    for end in (0, 1):
        behind = z[:, end] < near
        a, b = segments[behind, end], segments[behind, 1 - end]
        t = (near - a[:, 2]) / (b[:, 2] - a[:, 2])
        segments[behind, end] = a + t[:, None] * (b - a)
        z = segments[:, :, 2]
    return segments


def _clip_triangles(
    corners: npt.NDArray[np.float64], near: float
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.int64]]:
    """Cut triangles at the near plane; returns corners and the triangle each comes from."""
    ahead = corners[:, :, 2] > near
    count = ahead.sum(axis=1)
    parts, sources = [corners[count == 3]], [np.flatnonzero(count == 3)]

    def cut(a: npt.NDArray[np.float64], b: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        t = (near - a[:, 2]) / (b[:, 2] - a[:, 2])
        result: npt.NDArray[np.float64] = a + t[:, None] * (b - a)
        return result

    for k in range(3):
        i, j = (k + 1) % 3, (k + 2) % 3
        one = np.flatnonzero((count == 1) & ahead[:, k])
        if len(one):
            a, b, c = corners[one, k], corners[one, i], corners[one, j]
            parts.append(np.stack([a, cut(a, b), cut(a, c)], axis=1))
            sources.append(one)
        two = np.flatnonzero((count == 2) & ~ahead[:, k])
        if len(two):
            c, a, b = corners[two, k], corners[two, i], corners[two, j]
            bc, ca = cut(b, c), cut(a, c)  # as the neighbours do: no cracks
            parts += [np.stack([a, b, bc], axis=1), np.stack([a, bc, ca], axis=1)]
            sources += [two, two]
    return np.concatenate(parts), np.concatenate(sources)


def _split_long(
    corners: npt.NDArray[np.float64], index: npt.NDArray[np.int64], camera: Camera
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.int64], npt.NDArray[np.float64]]:
    """Bisect longest edges until none exceeds the limit; drop what lies outside the image.

    Neighbours see the same edge and cut it at the same point, so that no cracks open.
    """
    done: list[tuple[npt.NDArray[np.float64], npt.NDArray[np.int64], npt.NDArray[np.float64]]] = []
    limit = np.array([camera.width, camera.height], np.float64)
    while len(corners):
        screen = _project(camera, corners[:, :, POSITION])
        inside = ((screen.max(axis=1) > -1.0) & (screen.min(axis=1) < limit)).all(axis=1)
        area = _cross(screen[:, 1] - screen[:, 0], screen[:, 2] - screen[:, 0])
        inside &= area != 0.0
        corners, index, screen = corners[inside], index[inside], screen[inside]
        length = np.linalg.norm(np.roll(screen, -1, axis=1) - screen, axis=2)
        long = length.max(axis=1) > LONGEST_EDGE
        done.append((corners[~long], index[~long], screen[~long]))
        corners, index, length = corners[long], index[long], length[long]
        if not len(corners):
            break
        k = np.argmax(length, axis=1)
        rows = np.arange(len(corners))
        a, b, c = corners[rows, k], corners[rows, (k + 1) % 3], corners[rows, (k + 2) % 3]
        middle = 0.5 * (a + b)
        corners = np.concatenate([np.stack([a, middle, c], 1), np.stack([middle, b, c], 1)])
        index = np.concatenate([index, index])
    if not done:
        return corners, index, np.zeros((0, 3, 2))
    return (
        np.concatenate([d[0] for d in done]),
        np.concatenate([d[1] for d in done]),
        np.concatenate([d[2] for d in done]),
    )


def _cross(a: npt.NDArray[np.float64], b: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    result: npt.NDArray[np.float64] = a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
    return result


def barycentric_planes(corners: npt.NDArray[np.float64], camera: Camera) -> npt.NDArray[np.float64]:
    """(T, 3, 3): row i holds the coefficients of b_i as an affine function of [x, y, 1]."""
    M = np.swapaxes(corners[:, :, POSITION], 1, 2)
    a, b, c = M[:, :, 0], M[:, :, 1], M[:, :, 2]
    cofactors = np.stack([np.cross(b, c), np.cross(c, a), np.cross(a, b)], axis=1)
    determinant = np.sum(a * cofactors[:, 0], axis=1)
    if not (determinant != 0.0).all():
        raise InputError("a triangle is seen exactly edge-on; it should have been dropped")
    result: npt.NDArray[np.float64] = cofactors @ camera.ray_matrix() / determinant[:, None, None]
    return result


def _with_reach(
    paints: list[RegionPaint],
    corners: npt.NDArray[np.float64],
    screen: npt.NDArray[np.float64],
    paint: npt.NDArray[np.int32],
    camera: Camera,
) -> list[RegionPaint]:
    """Half the largest pixel footprint of every patterned region, in paint coordinates."""
    result = []
    for number, region in enumerate(paints):
        rows = np.flatnonzero(paint == number)
        if not len(rows) or not (region.high > region.low).any():
            result.append(region)
            continue
        planes = barycentric_planes(corners[rows], camera)
        weight = planes.sum(axis=1)
        scaled = np.einsum("tik,tia->tak", planes, corners[rows][:, :, ST])
        st = corners[rows][:, :, ST]
        w = 1.0 / corners[rows][:, :, 2]
        slope = scaled[:, None, :, :2] - st[..., None] * weight[:, None, None, :2]
        footprint = 0.5 * np.abs(slope).sum(axis=-1) / w[..., None]
        extent = float((region.high - region.low).max())
        reach = min(float(footprint.max()), extent)
        result.append(RegionPaint(region.paint, region.low, region.high, reach))
    return result
