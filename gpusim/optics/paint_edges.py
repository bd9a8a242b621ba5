"""Edges of triangles across which the speckle on them jumps or bends.

A pixel is painted with the pattern of the triangle at its centre, continued. That is right for a
plane, and second-order right where neighbours turn little; at the rim of a tube it isn't, nor
across the seam of an unfolded surface. There, edges count as ones that show: the pixels that they
cross are put together from what is seen of every triangle.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from gpusim.surface.speckle import Speckle
from gpusim.surface.topology import Topology

__all__ = ["speckle_jumps"]

Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]

BEND = 0.006
"""Change of the footprint's sides across an edge, per pixel, over the speckle's diameter."""

SEAM = 1e-6
"""Offset of the pattern across an edge, over the speckle's diameter."""

STEEP = 0.7
"""Cosine between normal and line of sight from which on no bend is looked for."""


def speckle_jumps(
    topology: Topology, kept: npt.NDArray[np.int64], own: Flags, st: Array, points: Array,
    ideal: Array, paint: Speckle,
) -> npt.NDArray[np.int64]:  # fmt: skip
    """Numbers of the edges in a region with speckle whose pixels are put together.

    Parameters
    ----------
    kept : (n,) triangles that may be seen; ``own`` (n,) which of them are the region's.
    st : (n, 3, 2) paint coordinates of their corners.
    points, ideal : vertices in camera space and on the ideal image; infinite behind the camera.
    """
    place = np.full(len(topology.triangles), -1)
    place[kept[own]] = np.flatnonzero(own)
    first, second = place[topology.first], place[topology.second]
    inner = np.flatnonzero(topology.manifold & (first >= 0) & (second >= 0))
    sides = [_side(topology, kept, rows[inner], inner) for rows in (first, second)]
    ends, at = [], []
    for rows, (k, vertices) in zip((first[inner], second[inner]), sides, strict=True):
        pair = np.stack([st[rows, k], st[rows, (k + 1) % 3]], axis=1)
        # from the vertex of lower number to the other
        turned = vertices[:, 0] > vertices[:, 1]
        pair[turned] = pair[turned, ::-1]
        ends.append(pair)
        at.append(rows)
    seam = np.abs(ends[0] - ends[1]).max(axis=(1, 2), initial=0.0) > SEAM * paint.diameter
    corners = [topology.triangles[kept[rows]] for rows in at]
    steep = np.zeros(len(inner), bool)
    for vertices in corners:
        steep |= _cosine(points[vertices]) < STEEP
        steep &= np.isfinite(ideal[vertices]).all(axis=(1, 2))
    some = np.flatnonzero(steep & ~seam)
    edge = sides[0][1][some]
    depth = points[edge, 2].mean(axis=1)
    slopes, narrow = [], np.full(len(some), np.inf)
    for rows, vertices, pair in zip(at, corners, ends, strict=True):
        screen = ideal[vertices[some]]
        slope, area = _slope(screen, points[vertices[some], 2], st[rows[some]], pair[some], depth)
        slopes.append(slope)
        length = np.linalg.norm(ideal[edge[:, 1]] - ideal[edge[:, 0]], axis=1)
        narrow = np.minimum(narrow, np.abs(area) / np.maximum(length, 1e-300))
    jump = np.sqrt(((slopes[0] - slopes[1]) ** 2).sum(axis=(1, 2)))
    bends = jump > BEND * paint.diameter * np.clip(narrow, 1e-3, 1.0)
    result: npt.NDArray[np.int64] = inner[np.concatenate([np.flatnonzero(seam), some[bends]])]
    return result


def _side(
    topology: Topology, kept: npt.NDArray[np.int64], rows: npt.NDArray[np.int64],
    edge: npt.NDArray[np.int64],
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:  # fmt: skip
    """Which side (n,) of triangles an edge is, and its vertices (n, 2) in their order."""
    number = kept[rows]
    k = np.argmax(topology.edge[number] == edge[:, None], axis=1)
    v = topology.triangles[number]
    n = np.arange(len(rows))
    return k, np.stack([v[n, k], v[n, (k + 1) % 3]], axis=1)


def _cosine(corners: Array) -> Array:
    """(n,) between the normals of triangles (n, 3, 3) and the line of sight to them."""
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    sight = corners.mean(axis=1)
    size = np.linalg.norm(normal, axis=1) * np.linalg.norm(sight, axis=1)
    result: Array = np.abs((normal * sight).sum(axis=1)) / np.maximum(size, 1e-300)
    return result


def _slope(screen: Array, z: Array, st: Array, ends: Array, depth: Array) -> tuple[Array, Array]:
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
    result: Array = depth[:, None, None] * (change[:, :2] - middle[:, :, None] * change[:, 2:])
    return result, area
