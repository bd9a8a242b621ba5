"""Edges of a triangle mesh that show in an image: silhouettes, borders, creases, region borders."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

__all__ = ["Outline", "feature_edges", "smooth_normals"]


@dataclass(frozen=True, eq=False)
class Outline:
    """``edges`` (E, 2) vertex numbers; ``closed``: every edge joins exactly two triangles."""

    edges: npt.NDArray[np.int32]
    closed: bool


def feature_edges(
    triangles: npt.NDArray[np.int32],
    source: npt.NDArray[np.int32],
    front: npt.NDArray[np.bool_],
    region: npt.NDArray[np.int32],
    normal: npt.NDArray[np.float64],
    smooth_angle: float,
) -> Outline:
    """The edges across which the picture may jump.

    Parameters
    ----------
    triangles : (T, 3) vertices; source : (T,) face that each comes from (diagonals of a face that
        is seen from one side never show).
    front, region, normal : per triangle: seen from its front, paint region, normal of any length.
    smooth_angle : rad; a larger turn between two neighbours is a crease.
    """
    count = len(triangles)
    ends = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    owner = np.tile(np.arange(count, dtype=np.int64), 3)
    low, high = ends.min(axis=1).astype(np.int64), ends.max(axis=1).astype(np.int64)
    key = low * (int(triangles.max(initial=0)) + 1) + high
    order = np.argsort(key, kind="stable")
    key, owner, low, high = key[order], owner[order], low[order], high[order]
    first = np.flatnonzero(np.r_[True, key[1:] != key[:-1]])
    uses = np.diff(np.r_[first, len(key)])
    pair = uses == 2
    closed = bool(pair.all())
    a = owner[first]
    b = owner[np.minimum(first + 1, len(key) - 1)]
    length = np.linalg.norm(normal, axis=1)
    unit = normal / np.where(length > 0.0, length, 1.0)[:, None]
    turned = front[a] != front[b]
    crease = np.sum(unit[a] * unit[b], axis=1) < np.cos(smooth_angle)
    crease &= source[a] != source[b]
    jump = ~pair | turned | crease | (region[a] != region[b])
    if closed:
        jump &= front[a] | front[b]
    return Outline(np.stack([low[first], high[first]], axis=1)[jump].astype(np.int32), closed)


def smooth_normals(
    points: npt.NDArray[np.float64], triangles: npt.NDArray[np.int32], smooth_angle: float
) -> npt.NDArray[np.float64]:
    """Unit normals (T, 3, 3) per triangle corner, averaged by area over the smooth neighbours.

    A neighbour at a vertex counts if its normal lies within ``smooth_angle`` of the triangle's own.
    """
    a, b, c = (points[triangles[:, k]] for k in range(3))
    area = np.cross(b - a, c - a)
    length = np.linalg.norm(area, axis=1)
    unit = area / np.where(length > 0.0, length, 1.0)[:, None]
    corner = triangles.reshape(-1)
    owner = np.repeat(np.arange(len(triangles)), 3)
    order = np.argsort(corner, kind="stable")
    sorted_vertex, sorted_owner = corner[order], owner[order]
    start = np.searchsorted(sorted_vertex, np.arange(len(points) + 1))
    degree = np.diff(start)[corner]
    # pairs (corner, neighbour) laid out one after another
    row = np.repeat(np.arange(len(corner)), degree)
    offset = np.arange(len(row)) - np.repeat(np.cumsum(degree) - degree, degree)
    neighbour = sorted_owner[start[corner[row]] + offset]
    similar = np.sum(unit[owner[row]] * unit[neighbour], axis=1) >= np.cos(smooth_angle)
    weight = np.where(similar[:, None], area[neighbour], 0.0)
    total = np.add.reduceat(weight, np.cumsum(degree) - degree, axis=0)
    size = np.linalg.norm(total, axis=1)
    total = np.where(size[:, None] > 0.0, total / np.where(size > 0.0, size, 1.0)[:, None],
                     unit[owner])  # fmt: skip
    return total.reshape(-1, 3, 3)
