"""The silhouettes of meshes around a point: edges between faces, in clusters of clusters.

Seen from a point, an edge between two faces that both hide, or that both don't, is no border of
what is hidden: only the contour counts, the edges where that changes. A ball of F faces has about
the root of F such edges.

Things that lie together and look the same way follow each other; every four make a cluster, every
four of these one of the next level. A cluster that a test refuses for a group of points is left out
with all that is in it. Of a cluster of edges is known what their faces' planes have in common.
Where the faces on both sides are known to hide, or not to, none of its edges is a contour.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gpusim.arrays.array_types import Bool, Float, Long
from gpusim.arrays.z_order import z_order
from gpusim.surface.topology import opposite_sides

TILT = 0.1
"""Tangent of the angle by which the rows of `gpusim.optics.ambient.hemisphere_mask` pass the
normal."""

AGAINST = -0.5
"""Cosine between the normals of face and point below which they may lie against each other."""


@dataclass(frozen=True, eq=False)
class SamplePoints:
    """Points to look from.

    ``at`` (N, 3) and the unit ``normal`` (N, 3); ``tolerance`` (N,): distance from a face's plane
    within which it hides nothing; ``thickness`` (N,): that a way up leaves a body nearer than this
    doesn't tell that the point lies inside.
    """

    at: Float
    normal: Float
    tolerance: Float
    thickness: Float

    def part(self, rows: slice | Long) -> SamplePoints:
        """Some of them."""
        return SamplePoints(
            self.at[rows], self.normal[rows], self.tolerance[rows], self.thickness[rows]
        )


def tangent(normal: Float) -> Float:
    """(N, 3) unit vectors square to unit normals, steady but where these point along -z."""
    x, y, z = normal.T
    below = z < -0.9999
    s = 1.0 / (1.0 + np.where(below, 0.0, z))
    result = np.stack([1.0 - x * x * s, -x * y * s, -x], axis=1)
    result[below] = np.stack([np.ones_like(x), 0.0 * x, -x / np.where(below, z, -1.0)], axis=1)[
        below
    ]
    length: Float = np.linalg.norm(result, axis=1)[:, None]
    return result / length


@dataclass(frozen=True, eq=False)
class EdgeAdjacency:
    """``ends`` (E, 2, 3): of each edge, counter-clockwise around its first face from outside.

    ``beside`` (E, 2): the faces that it belongs to, around the second one it runs clockwise; -1
    where there is none. ``edges`` (F, 4): twice the number of an edge, one more where the face is
    the edge's second; -1 where a triangle has its last corner twice. ``planes`` (F, 4): unit
    normal outward, and its product with a point of the face. ``balls`` (F, 4): middle and radius of
    what is around them. ``both_sides`` (F,): of surfaces that aren't closed.
    """

    ends: Float
    beside: Long
    edges: Long
    planes: Float
    balls: Float
    both_sides: Bool

    @staticmethod
    def of(points: Float, faces: Long, both_sides: Bool) -> EdgeAdjacency:
        """Those of faces (F, 4) of ``points`` (N, 3), a triangle's last corner twice."""
        start, end = faces.reshape(-1), np.roll(faces, -1, axis=1).reshape(-1)
        # where three faces meet, or two that don't go round the same way, each has its own edge
        opposite = opposite_sides(faces).reshape(-1)
        second = (opposite >= 0) & (opposite < np.arange(faces.size))
        half_edges = np.flatnonzero((start != end) & ~second)
        other = opposite[half_edges]
        edges = np.full(faces.size, -1)
        edges[half_edges] = 2 * np.arange(len(half_edges))
        pair = np.flatnonzero(other >= 0)
        edges[other[pair]] = 2 * pair + 1
        corners = points[faces]
        normal = np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
        normal /= np.maximum(np.linalg.norm(normal, axis=1), 1e-300)[:, None]
        middle = corners.mean(axis=1)
        offset = np.sum(normal * middle, axis=1)
        radius = np.linalg.norm(corners - middle[:, None], axis=2).max(axis=1, initial=0.0)
        return EdgeAdjacency(
            points[np.stack([start[half_edges], end[half_edges]], axis=1)],
            np.stack([half_edges // 4, np.where(other >= 0, other // 4, -1)], axis=1),
            edges.reshape(-1, 4), np.concatenate([normal, offset[:, None]], axis=1),
            np.concatenate([middle, radius[:, None]], axis=1), both_sides,
        )  # fmt: skip

    def ordered(self, edge: Long, face: Long) -> EdgeAdjacency:
        """The same in the order of ``edge`` (E,) and ``face`` (F,)."""
        edge_at, face_at = np.empty_like(edge), np.empty(len(face) + 1, np.int64)
        edge_at[edge], face_at[face] = np.arange(len(edge)), np.arange(len(face))
        face_at[-1] = -1
        edges = self.edges[face]
        reordered = 2 * edge_at[np.maximum(edges, 0) // 2] + edges % 2
        return EdgeAdjacency(
            self.ends[edge], face_at[self.beside[edge]], np.where(edges >= 0, reordered, -1),
            self.planes[face], self.balls[face], self.both_sides[face],
        )  # fmt: skip

    @staticmethod
    def apart(corners: Float, both_sides: Bool) -> EdgeAdjacency:
        """Faces with ``corners`` (F, 4, 3) that share no edges, a triangle's last corner twice."""
        faces = np.arange(4 * len(corners)).reshape(-1, 4)
        faces[:, 3] -= (corners[:, 3] == corners[:, 2]).all(axis=1)
        return EdgeAdjacency.of(corners.reshape(-1, 3), faces, both_sides)


MEMBERS = 4
"""Of a cluster."""

CLOSED, OPEN, NONE, MIXED = 0, 1, 2, 3
"""Planes of faces that hide by their outside, by both sides, of none, and of several of these."""


@dataclass(frozen=True, eq=False)
class BoundingSpheres:
    """What encloses things or clusters: ``middle`` (N, 3) and ``radius`` (N,)."""

    middle: Float
    radius: Float

    @staticmethod
    def of(points: Float, size: int) -> BoundingSpheres:
        """Around every ``size`` things with points (N, K, 3)."""
        first = np.arange(0, len(points), size)
        low = np.minimum.reduceat(points.min(axis=1), first)
        middle = 0.5 * (low + np.maximum.reduceat(points.max(axis=1), first))
        to = points - np.repeat(middle, size, axis=0)[: len(points), None]
        reach = np.sqrt(np.einsum("nka,nka->nk", to, to)).max(axis=1)
        return BoundingSpheres(middle, np.maximum.reduceat(reach, first))

    @staticmethod
    def around(balls: Float, size: int) -> BoundingSpheres:
        """Around every ``size`` balls (N, 4)."""
        first = np.arange(0, len(balls), size)
        middle, radius = balls[:, :3], balls[:, 3]
        low = np.minimum.reduceat(middle - radius[:, None], first)
        centre = 0.5 * (low + np.maximum.reduceat(middle + radius[:, None], first))
        to = middle - np.repeat(centre, size, axis=0)[: len(balls)]
        return BoundingSpheres(
            centre, np.maximum.reduceat(np.linalg.norm(to, axis=1) + radius, first)
        )


@dataclass(frozen=True, eq=False)
class NormalCones:
    """What planes have in common.

    Their unit normals pass from ``axis`` (N, 3) by ``spread`` (N,) at most, and they have points
    within the things' balls whose products with it are from ``low`` to ``high`` (N,). ``kind``
    (N,): `CLOSED`, `OPEN`, `NONE` or `MIXED`.
    """

    axis: Float
    spread: Float
    low: Float
    high: Float
    kind: Long

    @staticmethod
    def of(normal: Float, point: Float, kind: Long, size: int) -> NormalCones:
        """Of every ``size`` planes with unit normals and points (N, 3)."""
        first = np.arange(0, len(normal), size)
        axis = np.add.reduceat(normal, first)
        axis /= np.maximum(np.linalg.norm(axis, axis=1), 1e-300)[:, None]
        axes = np.repeat(axis, size, axis=0)[: len(normal)]
        product = np.einsum("na,na->n", axes, point)
        low, high = np.minimum.reduceat(kind, first), np.maximum.reduceat(kind, first)
        return NormalCones(
            axis, np.maximum.reduceat(np.linalg.norm(normal - axes, axis=1), first),
            np.minimum.reduceat(product, first), np.maximum.reduceat(product, first),
            np.where(low == high, low, MIXED),
        )  # fmt: skip


def levels(count: int) -> list[int]:
    """How many of ``count`` things clusters have, level by level, from the largest to the things
    themselves."""
    sizes = [1] if count else []
    while count and count > MEMBERS * sizes[-1]:
        sizes.append(MEMBERS * sizes[-1])
    return sizes[::-1]


def in_order(at: Float, *keys: Long) -> Long:
    """The order (N,) by ``keys`` (N,), the first one above the others, then by where (N, 3) is."""
    return np.lexsort((z_order(at), *keys[::-1]))


def direction_cells(normal: Float) -> Long:
    """Which of 27 ways vectors (N, 3) of length 1 or 0 look."""
    whole = np.rint(normal).astype(np.int64) + 1
    return np.asarray((whole[:, 0] * 3 + whole[:, 1]) * 3 + whole[:, 2])


ROUNDING = 2e-6
"""Of the scene's size: heights over planes are told apart by no less."""

LOW = 0.01
"""Sine of the height over the horizon below which no row has samples."""


@dataclass(frozen=True, eq=False)
class SilhouetteBVH:
    """``facets`` in the order of their clusters, which are the largest first and single ones last.

    ``balls`` and ``slopes``: those of the edges' clusters, and of the planes on both sides;
    ``spheres``: those of the faces'. ``rounding``: of heights over planes.
    """

    facets: EdgeAdjacency
    balls: list[BoundingSpheres]
    slopes: list[tuple[NormalCones, NormalCones]]
    spheres: list[BoundingSpheres]
    rounding: float

    @staticmethod
    def of(facets: EdgeAdjacency) -> SilhouetteBVH:
        """Those of ``facets``, however ordered."""
        planes, kind = _beside(facets)
        edge = in_order(
            facets.ends.mean(axis=1), kind[:, 0], kind[:, 1],
            *(direction_cells(planes[:, k, :3]) for k in (0, 1)),
        )  # fmt: skip
        facets = facets.ordered(edge, in_order(facets.balls[:, :3]))
        planes, kind = _beside(facets)
        middle = facets.ends.mean(axis=1)
        gap = planes[:, :, 3] - np.einsum("eka,ea->ek", planes[:, :, :3], middle)
        foot = middle[:, None] + gap[:, :, None] * planes[:, :, :3]
        reach = np.concatenate([facets.ends, foot], axis=1)
        slopes = [
            (
                NormalCones.of(planes[:, 0, :3], foot[:, 0], kind[:, 0], size),
                NormalCones.of(planes[:, 1, :3], foot[:, 1], kind[:, 1], size),
            )
            for size in levels(len(reach))
        ]
        return SilhouetteBVH(
            facets, [BoundingSpheres.of(reach, size) for size in levels(len(reach))], slopes,
            [BoundingSpheres.around(facets.balls, size) for size in levels(len(facets.balls))],
            ROUNDING * float(np.abs(facets.ends).max(initial=0.0)),
        )  # fmt: skip


def _beside(facets: EdgeAdjacency) -> tuple[Float, Long]:
    """Planes (E, 2, 4) on both sides of edges, zeros where there is no face, and their kinds."""
    planes = np.concatenate([facets.planes, np.zeros((1, 4))])[facets.beside]
    kind = np.where(np.append(facets.both_sides, False)[facets.beside], OPEN, CLOSED)
    return planes, np.where(facets.beside < 0, NONE, kind)
