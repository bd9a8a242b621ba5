"""What a surface's triangles share, found once and kept for every frame and camera."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from gpusim.arrays.array_types import Bool, Int, Long


@dataclass(frozen=True, eq=False)
class Topology:
    """Triangles and edges of faces.

    ``triangles`` (T, 3) vertices, corner by corner in memory; ``source`` (T,) int32 face that each
    comes from; ``edge`` (T, 3): number of the edge from corner k to the next; ``first``, ``second``
    (E,): triangles on both sides, the same one at a border; ``manifold`` (E,): exactly two
    triangles share it; ``closed``: that holds for all edges. Indices are 64 bits wide, which is
    what NumPy makes of others at every use.
    """

    triangles: Long
    source: Int
    edge: Long
    first: Long
    second: Long
    manifold: Bool
    closed: bool

    @staticmethod
    def of(faces: Int) -> Topology:
        """The topology of faces (F, 4), -1 in the last column for triangles."""
        triangles, source = triangulate(faces)
        ends = triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2).astype(np.int64)
        key = ends.min(axis=1) * (int(triangles.max(initial=0)) + 1) + ends.max(axis=1)
        order, ordered = sorted_keys(key)
        new = np.ones(len(key), bool)
        new[1:] = ordered[1:] != ordered[:-1]
        edge = np.empty(len(key), np.int64)
        edge[order] = np.cumsum(new) - 1
        start = np.flatnonzero(new)
        manifold = np.diff(np.append(start, len(key))) == 2
        first = order[start].astype(np.int64) // 3
        second = np.where(manifold, order[np.minimum(start + 1, len(key) - 1)] // 3, first)
        corners = np.asfortranarray(triangles.astype(np.int64))
        return Topology(
            corners, source, edge.reshape(-1, 3), first, second, manifold, bool(manifold.all())
        )

    @cached_property
    def opposed(self) -> Bool:
        """(E,): exactly two triangles share it, and run along it opposite ways."""
        along = self.triangles < np.roll(self.triangles, -1, axis=1)
        ways = np.where(along, 1.0, -1.0).reshape(-1)
        total = np.bincount(self.edge.reshape(-1), ways, len(self.first))
        return np.asarray(self.manifold & (total == 0.0))

    @cached_property
    def oriented(self) -> bool:
        """Whether no edge has more than two triangles, which then run along it opposite ways."""
        most = np.bincount(self.edge.reshape(-1)).max(initial=0)
        return bool(most <= 2 and self.opposed[self.manifold].all())

    def sides(self, flags: Bool, kept: Long) -> Bool:
        """(n, 3): of every side of triangles ``kept`` (n,), ascending, whether its edge has a flag
        (E,)."""
        return np.asarray(flags[self.edge if len(kept) == len(self.edge) else self.edge[kept]])


def opposite_sides(faces: Long) -> Long:
    """(F, k): of each side of faces (F, k), from a corner to the next, the one that runs along it
    the other way: k times its face, and the corner that it begins at. -1 where an edge hasn't got
    two sides, or these run the same way, and for sides without length."""
    start, end = faces.reshape(-1), np.roll(faces, -1, axis=1).reshape(-1)
    long = np.flatnonzero(start != end)
    low, high = np.minimum(start, end)[long], np.maximum(start, end)[long]
    order, key = sorted_keys(low * (int(faces.max(initial=0)) + 1) + high)
    begin = np.flatnonzero(np.diff(key, prepend=-1))
    begin = begin[np.diff(begin, append=len(key)) == 2]
    one, other = long[order[begin]], long[order[begin + 1]]
    against = start[one] == end[other]
    one, other = one[against], other[against]
    result = np.full(faces.size, -1)
    result[one], result[other] = other, one
    return result.reshape(faces.shape)


def sorted_keys(
    key: Long,
) -> tuple[Int, Long]:
    """The stable order of keys from 0 up, and the keys in it."""
    bits = len(key).bit_length()
    if int(key.max(initial=0)).bit_length() + bits > 63:
        order = np.argsort(key, kind="stable")
        return order.astype(np.int32), key[order]
    # sorting numbers takes a fraction of the time of sorting their places
    both = np.sort((key << bits) | np.arange(len(key)))
    return (both & ((1 << bits) - 1)).astype(np.int32), both >> bits


def triangulate(
    faces: Int,
) -> tuple[Int, Int]:
    """(F, 4) faces to (T, 3) triangles, and the face (T,) that each comes from."""
    quads = np.flatnonzero(faces[:, 3] >= 0)
    triangles = np.concatenate([faces[:, :3], faces[quads][:, [0, 2, 3]]])
    source = np.concatenate([np.arange(len(faces)), quads]).astype(np.int32)
    order = np.argsort(source, kind="stable")
    return np.ascontiguousarray(triangles[order]), source[order]
