"""Edges of triangles across which the speckle, or a picture by texture coordinates, jumps or bends.

A pixel is painted with the pattern of the triangle at its centre, continued. That is right for a
plane, and second-order right where neighbours turn little; at the rim of a tube it isn't, nor
across the seam of an unfolded surface. There, edges count as ones that show: the pixels that they
cross are put together from what is seen of every triangle.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from gpusim.arrays.array_types import Bool, Float, Long
from gpusim.arrays.unique import distinct
from gpusim.optics.geometry.triangle_corners import CHUNK
from gpusim.surface.bitmap import Image
from gpusim.surface.frames import Atlas, Frame
from gpusim.surface.paint import Paint
from gpusim.surface.speckle import Speckle
from gpusim.surface.topology import Topology

BEND = 0.006
"""Change of the footprint's sides across an edge, per pixel, over the speckle's diameter."""

SEAM = 1e-6
"""Offset of the pattern across an edge, over the speckle's diameter."""

STEEP = 0.7
"""Cosine between normal and line of sight from which on no bend is looked for."""

ROUNDING = 1e-9
"""Of a cosine, by which a quick look may be off."""


TEXELS = 5.0
"""Of a picture, that count as a speckle's diameter does."""


def grain_of(paint: Paint, frame: Frame) -> float:
    """Size of the finest parts of a paint that may jump; 0 where no edges are looked for."""
    if isinstance(paint, Speckle):
        return paint.diameter
    return TEXELS * paint.texel if isinstance(paint, Image) and isinstance(frame, Atlas) else 0.0


def speckle_jumps(
    topology: Topology, kept: Long, in_region: Bool, st_of: Callable[[Long], Float],
    points: Float, ideal: Float, grain: float, whole: bool,
) -> Long:  # fmt: skip
    """Numbers of the edges in a region with speckle whose pixels are put together.

    Parameters
    ----------
    kept : (n,) triangles that may be seen; ``in_region`` (n,) which of them are the region's.
    st_of : paint coordinates (m, 3, 2) of the corners of some (m,) of the triangles ``kept``.
    grain : the speckle's diameter, or what stands for it (`grain_of`).
    points, ideal : vertices in camera space and on the ideal image; infinite behind the camera.
    whole : a vertex has the same coordinates in all triangles; then there are no seams.
    """
    place = np.full(len(topology.triangles), -1)
    rows = np.flatnonzero(in_region)
    place[kept[rows]] = rows
    if whole:
        # few triangles turn away so far: edges of others aren't looked at
        steep = kept[rows[_turned_away(points, topology.triangles, kept[rows])]]
        if not len(steep):
            return steep
        inner = distinct(topology.edge[steep].reshape(-1))
        inner = inner[topology.manifold[inner]]
    else:
        inner = np.flatnonzero(topology.manifold)
    first, second = place[topology.first[inner]], place[topology.second[inner]]
    both = (first >= 0) & (second >= 0)
    inner, at = inner[both], [first[both], second[both]]
    sides = [_side(topology, kept, rows, inner) for rows in at]
    st = [st_of(rows) for rows in at]
    ends = []
    for own_st, (k, vertices) in zip(st, sides, strict=True):
        n = np.arange(len(k))
        pair = np.stack([own_st[n, k], own_st[n, (k + 1) % 3]], axis=1)
        # from the vertex of lower number to the other
        turned = vertices[:, 0] > vertices[:, 1]
        pair[turned] = pair[turned, ::-1]
        ends.append(pair)
    seam = np.abs(ends[0] - ends[1]).max(axis=(1, 2), initial=0.0) > SEAM * grain
    corners = [topology.triangles[kept[rows]] for rows in at]
    bent = np.zeros(len(inner), bool)
    for vertices in corners:
        bent |= _cosine(points[vertices]) < STEEP
        bent &= np.isfinite(ideal[vertices]).all(axis=(1, 2))
    bent_edges = np.flatnonzero(bent & ~seam)
    edge = sides[0][1][bent_edges]
    depth = points[edge, 2].mean(axis=1)
    slopes, narrow = [], np.full(len(bent_edges), np.inf)
    for own_st, vertices, pair in zip(st, corners, ends, strict=True):
        screen = ideal[vertices[bent_edges]]
        slope, area = _slope(
            screen, points[vertices[bent_edges], 2], own_st[bent_edges], pair[bent_edges], depth
        )
        slopes.append(slope)
        length = np.linalg.norm(ideal[edge[:, 1]] - ideal[edge[:, 0]], axis=1)
        narrow = np.minimum(narrow, np.abs(area) / np.maximum(length, 1e-300))
    jump = np.sqrt(((slopes[0] - slopes[1]) ** 2).sum(axis=(1, 2)))
    bends = jump > BEND * grain * np.clip(narrow, 1e-3, 1.0)
    result: Long = inner[np.concatenate([np.flatnonzero(seam), bent_edges[bends]])]
    return result


def _turned_away(points: Float, triangles: Long, rows: Long) -> Bool:
    """Whether triangles ``rows`` (n,) of a surface may be so `STEEP` that edges count."""
    result = np.empty(len(rows), bool)
    columns = [np.ascontiguousarray(points[:, k]) for k in range(3)]
    every = len(rows) == len(triangles)
    for first in range(0, len(rows), CHUNK):
        part = slice(first, first + CHUNK)
        corners = triangles[part] if every else triangles[rows[part]]
        x, y, z = ([np.take(column, corners[:, k]) for k in range(3)] for column in columns)
        (ux, vx), (uy, vy), (uz, vz) = ((c[1] - c[0], c[2] - c[0]) for c in (x, y, z))
        sight = [c[0] + c[1] + c[2] for c in (x, y, z)]
        normal = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
        along = normal[0] * sight[0] + normal[1] * sight[1] + normal[2] * sight[2]
        size = normal[0] ** 2 + normal[1] ** 2 + normal[2] ** 2
        size *= sight[0] ** 2 + sight[1] ** 2 + sight[2] ** 2
        along *= along
        # those without a direction are looked at closely
        result[part] = ~(along > (STEEP + ROUNDING) ** 2 * size)
    return result


def _side(topology: Topology, kept: Long, rows: Long, edge: Long) -> tuple[Long, Long]:
    """Which side (n,) of triangles an edge is, and its vertices (n, 2) in their order."""
    number = kept[rows]
    k = np.argmax(topology.edge[number] == edge[:, None], axis=1)
    v = topology.triangles[number]
    n = np.arange(len(rows))
    return k, np.stack([v[n, k], v[n, (k + 1) % 3]], axis=1)


def _cosine(corners: Float) -> Float:
    """(n,) between the normals of triangles (n, 3, 3) and the line of sight to them."""
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    sight = corners.mean(axis=1)
    size = np.linalg.norm(normal, axis=1) * np.linalg.norm(sight, axis=1)
    result: Float = np.abs((normal * sight).sum(axis=1)) / np.maximum(size, 1e-300)
    return result


def _slope(screen: Float, z: Float, st: Float, ends: Float, depth: Float) -> tuple[Float, Float]:
    """Change (n, 2, 2) of s and t per column and row at the middle of edges, and twice the area.

    st / z and 1 / z are affine in the image.
    """
    u, v = screen[:, 1] - screen[:, 0], screen[:, 2] - screen[:, 0]
    area = u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]
    values = np.concatenate([st, np.ones((*st.shape[:2], 1))], axis=2) / z[..., None]
    a, b = values[:, 1] - values[:, 0], values[:, 2] - values[:, 0]
    safe = np.where(area != 0.0, area, np.inf)[:, None]
    change = np.stack(
        [(a * v[:, 1:] - b * u[:, 1:]) / safe, (b * u[:, :1] - a * v[:, :1]) / safe], axis=2
    )
    middle = ends.mean(axis=1)
    result: Float = depth[:, None, None] * (change[:, :2] - middle[:, :, None] * change[:, 2:])
    return result, area
