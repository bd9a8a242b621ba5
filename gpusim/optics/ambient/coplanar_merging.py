"""Flat parts of a mesh as fewer, larger quadrilaterals.

A finite element mesh divides flat sides into many faces; for what they hide only their common
outline counts. Neighbours in a row are joined in pairs, again and again, while the corners between
them stay within a tolerance of the straight sides. Rows of faces, each beside the next, run across
edges that are opposite in every face.
"""

from __future__ import annotations

import numpy as np

from gpusim.arrays.array_types import Bool, Float, Long
from gpusim.surface.topology import opposite_sides

ROUNDS = 6
"""At most 2^6 faces of a row become one."""


def merge_flat(points: Float, faces: Long, tolerance: float) -> Long:
    """Join faces (F, 4) of ``points`` (N, 3); triangles, with a corner twice, stay: (M, 4).

    ``tolerance``: how far from a vertex the joined side may pass.
    """
    # across edges 1 and 3, then of what is left across 2 and 0
    for k in (1, 2):
        for _ in range(ROUNDS):
            first, second = _pairs(points, faces, k, tolerance)
            if not len(first):
                break
            faces = faces.copy()
            for corner in (k, k + 1):
                faces[first, corner] = faces[second, corner]
            faces = np.delete(faces, second, axis=0)
    return faces


def _pairs(points: Float, faces: Long, k: int, tolerance: float) -> tuple[Long, Long]:
    """Faces that are joined, each with the one across its edge ``k``: of those of a row that suit
    the first and the second, the third and the fourth and so on. None of rings of such."""
    after = _following(faces, k)
    one = np.flatnonzero(after >= 0)
    after[one[~_suit(points, faces, k, one, after[one], tolerance)]] = -1
    before = np.full(len(faces), -1)
    followed = np.flatnonzero(after >= 0)
    before[after[followed]] = followed
    # how many are before each in its row, by steps that double
    place = (before >= 0).astype(np.int64)
    head = np.where(before >= 0, before, np.arange(len(before)))
    for _ in range(len(before).bit_length()):
        step = place[head]
        if not step.any():
            break
        place += step
        head = head[head]
    ring = place[head] > 0
    first = np.flatnonzero((after >= 0) & ~ring & (place % 2 == 0))
    return first, after[first]


def _following(faces: Long, k: int) -> Long:
    """(F,) the quadrilateral across edge ``k`` of each one, whose own edge is opposite in it; or
    -1."""
    quad = (faces != np.roll(faces, 1, axis=1)).all(axis=1)
    other, corner = np.divmod(opposite_sides(faces)[:, k], 4)
    good = quad & (other >= 0) & quad[other] & (corner == (k - 2) % 4)
    return np.where(good, other, -1)


def _suit(
    points: Float, faces: Long, k: int, first: Long, second: Long, tolerance: float
) -> Bool:  # fmt: skip
    """Whether pairs of faces, the second across edge ``k`` of the first, may be joined."""
    one, other = faces[first], faces[second]
    start, end = points[one[:, k - 1]], points[other[:, k]]
    result = _on_segment(points[one[:, k]], start, end, tolerance)
    far_start, far_end = points[one[:, k - 2]], points[other[:, k + 1]]
    result &= _on_segment(points[one[:, k + 1]], far_start, far_end, tolerance)
    # the diagonals of what they become meet
    normal = np.cross(far_end - start, far_start - end)
    size = np.linalg.norm(normal, axis=1)
    gap = np.abs(np.einsum("na,na->n", normal, end - start))
    return np.asarray(result & (gap <= tolerance * size) & (size > 0.0))


def _on_segment(middle: Float, start: Float, end: Float, tolerance: float) -> Bool:
    """Whether places (n, 3) lie on the way from ``start`` to ``end``, within the tolerance, and it
    doesn't turn a corner there: the side of a thin plate is shorter than any tolerance."""
    way, to = end - start, middle - start
    length = np.einsum("na,na->n", way, way)
    share = np.einsum("na,na->n", to, way) / np.where(length > 0.0, length, 1.0)
    gap = np.linalg.norm(to - share[:, None] * way, axis=1)
    near = np.minimum(tolerance, share * (1.0 - share) * np.sqrt(length))
    return np.asarray((share > 0.0) & (share < 1.0) & (gap <= near))
