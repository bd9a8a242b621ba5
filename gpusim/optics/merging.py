"""Flat parts of a mesh as fewer, larger quadrilaterals, as far as a lamp can tell.

A finite element mesh divides flat sides into many faces; for a shadow only their common outline
counts. Neighbours in a row are joined in pairs, again and again, while the corners between them
stay within a tolerance of the straight sides.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from gpusim.optics.corners import products
from gpusim.surface.topology import sorted_keys

__all__ = ["Merged", "merge_flat", "neighbours"]

Array = npt.NDArray[np.float64]
Numbers = npt.NDArray[np.int64]
ROUNDS = 6
"""At most 2^6 faces of a row become one."""


@dataclass(frozen=True, eq=False)
class Merged:
    """``faces`` (M, 4) vertices; ``owner`` (F,): in which of them each face went.

    ``inner`` (F, 4): the edges of the faces that lie inside them. The others keep their place: the
    k-th edges of the faces lie on the k-th edge of their owner.
    """

    faces: Numbers
    owner: Numbers
    inner: npt.NDArray[np.bool_]

    @property
    def member(self) -> Numbers:
        """(M,): a face of those that went into each, the last one."""
        one = np.zeros(len(self.faces), np.int64)
        one[self.owner] = np.arange(len(self.owner))
        return one

    def total(self, vectors: Array) -> Array:
        """(M, 3): sums of the faces' (F, 3)."""
        count = len(self.faces)
        return np.stack([np.bincount(self.owner, v, minlength=count) for v in vectors.T], axis=1)


def merge_flat(
    points: Array,
    faces: Numbers,
    tolerance: Array | None,
    beside: Numbers | None = None,
    plane: bool = True,
) -> Merged:
    """Join faces (F, 4) of ``points`` (N, 3); triangles, with a corner twice, stay.

    Parameters
    ----------
    tolerance : (N,) how far from a vertex the joined side may pass; None joins nothing.
    beside : (F, 4) the faces across which others may be joined, as `neighbours` finds them.
    plane : whether what is joined has to stay as flat.
    """
    count = len(faces)
    points = np.ascontiguousarray(points.T)
    beside = neighbours(faces)[0] if beside is None else beside
    owner, inner = np.arange(count), np.zeros((count, 4), bool)
    current, name = faces, np.arange(count)  # the faces left, and their numbers among all
    for k in (1, 2):  # across a face's edges 1 and 3, then 2 and 0
        for _ in range(ROUNDS if tolerance is not None else 0):
            first, second = _pairs(points, current, beside, k, tolerance, plane)
            if not len(first):
                break
            into = np.arange(count)
            into[name[second]] = name[first]
            out, back = np.zeros(count, bool), np.zeros(count, bool)
            out[name[first]], back[name[second]] = True, True
            inner[:, k] |= out[owner]
            inner[:, (k + 2) % 4] |= back[owner]
            owner = into[owner]
            current = current.copy()
            for j in (k, (k + 1) % 4):
                current[first, j] = current[second, j]
            left = np.ones(len(current), bool)
            left[second] = False
            beside = _beside(beside, first, second, k)[left]
            current, name = current[left], name[left]
    return Merged(current, np.searchsorted(name, owner), inner)


def _beside(beside: Numbers, first: Numbers, second: Numbers, k: int) -> Numbers:
    """What is across the edges (F, 4) of faces once pairs of them are joined across edges ``k``,
    by the numbers of what is then left."""
    result = beside.copy()
    result[first, k] = beside[second, k]
    into = np.arange(len(beside))
    into[second] = first
    for j in ((k + 1) % 4, (k + 3) % 4):
        a, b = beside[first, j], beside[second, j]
        # on a long side is one face, or none
        result[first, j] = np.where((a >= 0) & (b >= 0) & (into[a] == into[b]), a, -1)
    left = np.ones(len(beside), np.int64)
    left[second] = 0
    number = (np.cumsum(left) - 1)[into]
    return np.where(result >= 0, number[result], result)


def _pairs(
    points: Array, faces: Numbers, beside: Numbers, k: int, tolerance: Array | None, plane: bool
) -> tuple[Numbers, Numbers]:
    """Disjoint pairs of faces that may be joined across the first one's edge ``k``."""
    count = len(faces)
    other, back = beside[:, k], beside[:, (k + 2) % 4]
    corner = np.ascontiguousarray(faces.T)
    quad = np.ones(count, bool)
    for j in range(4):
        quad &= corner[j] != corner[j - 1]
    known = np.flatnonzero((other >= 0) & quad)
    partner = other[known]
    good = (back[partner] == known) & quad[partner]
    known, partner = known[good], partner[good]
    a, b = ([corner[(j + k) % 4][own] for j in range(4)] for own in (known, partner))
    # the common edge runs a[0] a[1] in the first, b[3] b[2] in the second
    good = (a[0] == b[3]) & (a[1] == b[2])
    if tolerance is not None:
        good &= _on_segment(points, a[0], a[3], b[0], tolerance)
        good &= _on_segment(points, a[1], a[2], b[1], tolerance)
        if plane:
            good &= _flat(points, (a[3], b[0], b[1], a[2]), tolerance)
    known, partner = known[good], partner[good]
    # places along the rows: every second face is joined with the next
    before = np.full(count, -1)
    before[partner] = known
    place = (before >= 0).astype(np.int64)
    jump = before
    while True:
        ahead = jump >= 0
        step = np.where(ahead, place[jump], 0)
        following = np.where(ahead, jump[jump], -1)
        if not (step > 0).any() or place.max(initial=0) > count:
            break
        place, jump = place + step, following
    keep = (place[known] % 2 == 0) & (place[known] <= count)
    return known[keep], partner[keep]


def _on_segment(
    points: Array, middle: Numbers, start: Numbers, end: Numbers, tolerance: Array
) -> npt.NDArray[np.bool_]:
    """Whether vertices lie on the way from ``start`` to ``end``, within their tolerance."""
    origin = np.take(points, start, axis=1)
    way, to = np.take(points, end, axis=1) - origin, np.take(points, middle, axis=1) - origin
    length = products(way, way)
    share = products(to, way) / np.where(length > 0.0, length, 1.0)
    rest = to - share * way
    gap = np.sqrt(products(rest, rest))
    return np.asarray((share > 0.0) & (share < 1.0) & (gap <= tolerance[middle]))


def _flat(
    points: Array, quad: tuple[Numbers, Numbers, Numbers, Numbers], tolerance: Array
) -> npt.NDArray[np.bool_]:
    """Whether the diagonals of quadrilaterals meet, within the tolerance."""
    P = [np.take(points, v, axis=1) for v in quad]
    (ux, uy, uz), (vx, vy, vz) = P[2] - P[0], P[3] - P[1]
    normal = np.stack([uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx])
    size = np.sqrt(products(normal, normal))
    gap = np.abs(products(normal, P[1] - P[0])) / np.where(size > 0.0, size, 1.0)
    return np.asarray((gap <= tolerance[quad[0]]) & (size > 0.0))


def neighbours(faces: Numbers) -> tuple[Numbers, bool]:
    """Across each edge of (F, 4) faces: -1 none or several, -2 no edge. Whether all have one."""
    count = len(faces)
    a, b = faces.reshape(-1), np.roll(faces, -1, axis=1).reshape(-1)
    owner = np.repeat(np.arange(count), 4)
    result = np.full(4 * count, -1, np.int64)
    result[a == b] = -2
    real = np.flatnonzero(a != b)
    low, high = np.minimum(a, b)[real], np.maximum(a, b)[real]
    key = low * (int(faces.max(initial=0)) + 1) + high
    order, key = sorted_keys(key)
    slot = real[order]
    first = np.flatnonzero(np.r_[True, key[1:] != key[:-1]]) if len(key) else np.zeros(0, int)
    uses = np.diff(np.r_[first, len(key)])
    pair = first[uses == 2]
    result[slot[pair]] = owner[slot[pair + 1]]
    result[slot[pair + 1]] = owner[slot[pair]]
    return result.reshape(-1, 4), bool((uses == 2).all())
