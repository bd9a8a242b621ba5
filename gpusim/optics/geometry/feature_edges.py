"""Edges of a triangle mesh that show in an image: silhouettes, borders, creases, region borders."""

from __future__ import annotations

from collections.abc import Callable, Collection

import numpy as np

from gpusim.arrays.array_types import Bool, Float, Int, Long
from gpusim.optics.geometry.triangle_corners import CHUNK, parts, products
from gpusim.surface.topology import Topology


def area_normals(points: Float, triangles: Long) -> Float:
    """(3, T): components of the triangles' normals, twice as long as their areas."""
    result = np.empty((3, len(triangles)))
    columns = [np.ascontiguousarray(points[:, k]) for k in range(3)]
    for part in parts(len(triangles)):
        corner = [np.ascontiguousarray(triangles[part, k]) for k in range(3)]
        p, u, v = ([np.take(x, numbers, mode="clip") for x in columns] for numbers in corner)
        for k in range(3):
            u[k] -= p[k]
            v[k] -= p[k]
        for k, normal in enumerate(result[:, part]):
            i, j = (k + 1) % 3, (k + 2) % 3
            np.multiply(u[i], v[j], out=normal)
            normal -= u[j] * v[i]
    return result


def unit(vectors: Float) -> Float:
    """(3, T) vectors scaled to length 1; zeros stay."""
    length = np.sqrt(vectors[0] ** 2 + vectors[1] ** 2 + vectors[2] ** 2)
    result: Float = vectors / np.where(length > 0.0, length, 1.0)
    return result


def feature_edges(
    topology: Topology,
    front: Bool,
    region: Int,
    creases: Callable[[Long | None], Bool],
    seen: Bool,
    sharp: Bool | None = None,
    patterned: Collection[int] = (),
) -> Bool:
    """(E,): the edges across which the picture may jump; diagonals of a face never are.

    Parameters
    ----------
    front, seen : (T,) per triangle: looks at the camera, may be in the image.
    region : (F,) paint region of each face.
    creases : which of these edges are creases, or (E,) of all (None).
    sharp : (P,) vertices at which `smooth_normals` found such turns: no crease is anywhere else.
        None without light, where creases show on patterns alone.
    patterned : the regions that carry one.
    """
    first, second = topology.first, topology.second
    jump = ~topology.manifold
    if not front.all():
        jump |= front[first] != front[second]
    if region.any():
        region_of = region[topology.source]
        jump |= region_of[first] != region_of[second]
    if not seen.all():
        edge = np.flatnonzero(jump)
        jump[edge] = seen[first[edge]] | seen[second[edge]]
    if sharp is None and patterned:
        edge = np.flatnonzero(creases(None) & ~jump)
        carries = np.isin(region, list(patterned))
        for triangle in (first[edge], second[edge]):
            jump[edge] |= seen[triangle] & carries[topology.source[triangle]]
    elif sharp is not None and sharp.any():
        turns = np.zeros(len(seen), bool)
        for corner in topology.triangles.T:
            turns |= sharp[corner]
        # a crease's vertices are those of the triangles on both sides
        edge = np.flatnonzero(turns[first] & turns[second] & ~jump)
        jump[edge] = creases(edge) & (seen[first[edge]] | seen[second[edge]])
    return jump


def creases(topology: Topology, normal: Float, smooth_angle: float, edges: Long | None) -> Bool:
    """Which of ``edges`` (n,), or of all (None), lie between faces whose normals differ by more
    than ``smooth_angle``, rad; ``normal`` (3, T): of the triangles, of any length."""
    numbers = np.arange(len(topology.first)) if edges is None else edges
    result = np.zeros(len(numbers), bool)
    for start in range(0, len(numbers), CHUNK):
        chunk = numbers[start : start + CHUNK]
        sides = [np.take(triangle, chunk) for triangle in (topology.first, topology.second)]
        a, b = (np.take(topology.source, triangle, mode="clip") for triangle in sides)
        between = np.flatnonzero(a != b)
        one, other = (unit(np.take(normal, side[between], axis=1, mode="clip")) for side in sides)
        result[start + between] = products(one, other) < np.cos(smooth_angle)
    return result


def smooth_normals(
    area: Float,
    triangles: Long,
    vertices: int,
    smooth_angle: float,
) -> tuple[Float, Bool]:
    """Unit normals (3, vertices), and where corners have their own (vertices,).

    They are the mean of the normals ``area`` (3, T) of the triangles at a vertex, weighted by
    area. Where two of those may differ by more than ``smooth_angle``, see `sharp_normals`.
    """
    columns = [np.ascontiguousarray(triangles[:, j]) for j in range(3)]
    mean = np.zeros((3, vertices))
    for k in range(3):
        for corner in columns:
            mean[k] += np.bincount(corner, weights=area[k], minlength=vertices)
    mean = unit(mean)
    # where all lie within half the angle of their mean, any two lie within the whole
    sharp, least = np.zeros(vertices, bool), np.cos(0.5 * smooth_angle)
    for first in range(0, len(triangles), CHUNK):
        part = slice(first, first + CHUNK)
        direction = unit(area[:, part])
        for column in columns:
            corner = column[part]
            cosine = direction[0] * np.take(mean[0], corner)
            cosine += direction[1] * np.take(mean[1], corner)
            cosine += direction[2] * np.take(mean[2], corner)
            if not cosine.min() >= least:
                sharp[corner[~(cosine >= least)]] = True
    return mean, sharp


def sharp_normals(
    area: Float,
    triangles: Long,
    sharp: Bool,
    faces: Long,
    vertex: Long,
    smooth_angle: float,
) -> Float:
    """Normals (n, 3) of triangles ``faces`` at their corners ``vertex``, which are ``sharp``.

    The mean, weighted by area, of the normals ``area`` (3, T) of those triangles at the vertex
    whose normal lies within ``smooth_angle`` of the triangle's own.
    """
    at = triangles.reshape(-1)
    hit = np.flatnonzero(np.take(sharp, at))
    vertices = np.take(at, hit)
    order = np.argsort(vertices, kind="stable")
    around = hit[order] // 3
    start = np.searchsorted(vertices[order], np.arange(len(sharp) + 1))
    degree = np.diff(start)[vertex]
    # pairs (corner, neighbour) laid out one after another
    row = np.repeat(np.arange(len(vertex)), degree)
    begin = np.cumsum(degree) - degree
    neighbour = around[start[vertex[row]] + np.arange(len(row)) - begin[row]]
    neighbour_area = np.take(area, neighbour, axis=1)
    direction = unit(np.take(area, faces, axis=1))
    cosine = np.sum(direction[:, row] * unit(neighbour_area), axis=0)
    weight = np.where(cosine >= np.cos(smooth_angle), neighbour_area, 0.0)
    total = np.add.reduceat(weight, begin, axis=1)
    defined = np.any(total != 0.0, axis=0)
    result: Float = np.where(defined, unit(total), direction).T
    return result


def border_of(topology: Topology, keep: Bool | None) -> tuple[Long, Long]:
    """Vertices that sides without a neighbour begin and end at, of all triangles or of those to
    ``keep`` (T,)."""
    edge = np.flatnonzero(~topology.manifold)
    triangle = topology.first[edge]
    if keep is not None:
        # besides, an edge without one of its two triangles is one of those that aren't kept
        lost = np.zeros(len(topology.first), bool)
        lost[topology.edge[np.flatnonzero(~keep)]] = True
        edge = np.concatenate([edge, np.flatnonzero(lost & topology.manifold)])
        first, second = topology.first[edge], topology.second[edge]
        triangle = np.where(keep[first], first, second)
        alone = keep[triangle] & ~(keep[first] & keep[second] & topology.manifold[edge])
        edge, triangle = edge[alone], triangle[alone]
    k = np.argmax(topology.edge[triangle] == edge[:, None], axis=1)
    return topology.triangles[triangle, k], topology.triangles[triangle, (k + 1) % 3]
