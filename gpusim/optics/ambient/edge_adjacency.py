"""Faces that hide what is behind them, edge by edge.

Seen from a point, an edge between two faces that both hide, or that both don't, is no border of
what is hidden: only the contour counts, the edges where that changes. A ball of F faces has about
the root of F such edges.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from gpusim.surface.topology import sorted_keys

__all__ = ["EdgeAdjacency"]

Array = npt.NDArray[np.float64]
Numbers = npt.NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class EdgeAdjacency:
    """``ends`` (E, 2, 3): of each edge, counter-clockwise around its first face from outside.

    ``beside`` (E, 2): the faces that it belongs to, around the second one it runs clockwise; -1
    where there is none. ``edges`` (F, 4): twice the number of an edge, one more where the face is
    the edge's second; -1 where a triangle has its last corner twice. ``planes`` (F, 4): unit
    normal outward, and its product with a point of the face. ``balls`` (F, 4): middle and radius of
    what is around them. ``both_sides`` (F,): of surfaces that aren't closed.
    """

    ends: Array
    beside: Numbers
    edges: Numbers
    planes: Array
    balls: Array
    both_sides: npt.NDArray[np.bool_]

    @staticmethod
    def of(points: Array, faces: Numbers, both_sides: npt.NDArray[np.bool_]) -> EdgeAdjacency:
        """Those of faces (F, 4) of ``points`` (N, 3), a triangle's last corner twice."""
        start, end = faces.reshape(-1), np.roll(faces, -1, axis=1).reshape(-1)
        real = np.flatnonzero(start != end)
        low, high = np.minimum(start, end)[real], np.maximum(start, end)[real]
        order, key = sorted_keys(low * (len(points) + 1) + high)
        slot = real[order]
        new = np.ones(len(key), bool)
        new[1:] = key[1:] != key[:-1]
        alone = np.append(new[1:], True)
        # where three faces meet, or two that don't go round the same way, each has its own edge
        first = np.flatnonzero(new & ~alone)
        first = first[np.append(alone[1:], True)[first]]
        first = first[start[slot[first]] == end[slot[first + 1]]]
        one = np.ones(len(slot), bool)
        one[first + 1] = False
        second = np.full(len(slot), -1)
        second[first] = slot[first + 1]
        own, other = slot[one], second[one]
        edges = np.full(faces.size, -1)
        edges[own] = 2 * np.arange(len(own))
        pair = np.flatnonzero(other >= 0)
        edges[other[pair]] = 2 * pair + 1
        corners = points[faces]
        normal = np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
        normal /= np.maximum(np.linalg.norm(normal, axis=1), 1e-300)[:, None]
        middle = corners.mean(axis=1)
        offset = np.sum(normal * middle, axis=1)
        radius = np.linalg.norm(corners - middle[:, None], axis=2).max(axis=1, initial=0.0)
        return EdgeAdjacency(
            points[np.stack([start[own], end[own]], axis=1)],
            np.stack([own // 4, np.where(other >= 0, other // 4, -1)], axis=1),
            edges.reshape(-1, 4), np.concatenate([normal, offset[:, None]], axis=1),
            np.concatenate([middle, radius[:, None]], axis=1), both_sides,
        )  # fmt: skip

    def ordered(self, edge: Numbers, face: Numbers) -> EdgeAdjacency:
        """The same in the order of ``edge`` (E,) and ``face`` (F,)."""
        edge_at, face_at = np.empty_like(edge), np.empty(len(face) + 1, np.int64)
        edge_at[edge], face_at[face] = np.arange(len(edge)), np.arange(len(face))
        face_at[-1] = -1
        edges = self.edges[face]
        found = 2 * edge_at[np.maximum(edges, 0) // 2] + edges % 2
        return EdgeAdjacency(
            self.ends[edge], face_at[self.beside[edge]], np.where(edges >= 0, found, -1),
            self.planes[face], self.balls[face], self.both_sides[face],
        )  # fmt: skip

    @staticmethod
    def apart(corners: Array, both_sides: npt.NDArray[np.bool_]) -> EdgeAdjacency:
        """Faces with ``corners`` (F, 4, 3) that share no edges, a triangle's last corner twice."""
        faces = np.arange(4 * len(corners)).reshape(-1, 4)
        faces[:, 3] -= (corners[:, 3] == corners[:, 2]).all(axis=1)
        return EdgeAdjacency.of(corners.reshape(-1, 3), faces, both_sides)
