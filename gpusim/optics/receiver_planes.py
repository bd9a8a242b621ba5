"""Where faces lie from receivers of light, by the planes of both, pair by pair."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import numpy.typing as npt

from gpusim.optics.casters import Casters
from gpusim.optics.corners import parts, products
from gpusim.optics.emitters import Lamp

__all__ = ["lies_low", "meets_middle", "sides_of_planes"]

Array = npt.NDArray[np.float64]
Numbers = npt.NDArray[np.int64]
Flags = npt.NDArray[np.bool_]

LOW = 5e-4
"""Sine of the elevation up to which what rises beside a receiver hides no light that counts: light
from there is no brighter than this, where from above it is 1."""


def sides_of_planes(
    casters: Casters, face: Numbers, points: Array, box: Numbers
) -> tuple[Flags, Flags]:
    """Whether boxes of points lie behind the planes of faces, or before them, pair by pair."""
    normal = [np.ascontiguousarray(casters.normal[:, axis]) for axis in range(3)]
    offset = np.sum(casters.corners[:, 0] * casters.normal, axis=1)
    slack = (1e-7 * np.abs(points).max(initial=0.0)) * np.linalg.norm(casters.normal, axis=1)
    behind, ahead = np.empty(len(face), bool), np.empty(len(face), bool)
    for part in parts(len(face)):
        own_face, own_box = face[part], box[part]
        own = [n[own_face] for n in normal]
        start, near = offset[own_face], slack[own_face]
        low, high = np.full(len(own_face), np.inf), np.full(len(own_face), -np.inf)
        for corner in points:
            height = -start
            for axis in range(3):
                height += own[axis] * corner[axis][own_box]
            np.minimum(low, height, out=low)
            np.maximum(high, height, out=high)
        behind[part], ahead[part] = high <= near, low >= -near
    return behind, ahead


def lies_low(
    lamp: Lamp, casters: Casters, face: Numbers, points: Array, box: Numbers, body: Numbers,
    eye: Array,
) -> Flags:  # fmt: skip
    """Whether faces hide nothing that counts of a lamp, as they don't rise over the planes of
    receivers in boxes of points (4, 3, n), pair by pair: what bulges hides nothing of itself.

    Where a plane cuts the lamp, what is below it may still be lit by a smooth normal: that is
    hidden by none of a closed surface's own faces that are as low. ``body`` (n,): number of the
    receivers' surface, or -1 (of large ones); ``eye`` (3,): which sees them from above.
    """
    start = points[0]
    across, along = points[1] - start, points[2] - start
    normal = np.stack([
        across[1] * along[2] - across[2] * along[1],
        across[2] * along[0] - across[0] * along[2],
        across[0] * along[1] - across[1] * along[0],
    ])  # fmt: skip
    length = np.sqrt(products(normal, normal))
    normal /= np.where(length > 0.0, length, 1.0)
    reach = np.abs(products(normal, lamp.u)) + np.abs(products(normal, lamp.v))
    offset = products(normal, start)
    height = products(normal, lamp.centre) - (0.0 if lamp.far else 1.0) * offset
    whole = np.abs(height) > reach
    side = np.where(whole, np.sign(height), np.sign(products(normal, eye) - offset))
    side[length == 0.0] = 0.0
    normal *= side
    offset *= side
    own = body[box] == casters.body[face]
    result: Flags = (side != 0.0)[box] & (whole[box] | (own & ~casters.both_sides[face]))
    rows = np.flatnonzero(result)
    face, box, own = face[rows], box[rows], own[rows]
    places = np.ascontiguousarray(casters.points.T)
    low, high = np.full(len(rows), np.inf), np.full(len(rows), -np.inf)
    for part in parts(len(rows)):
        own_face, own_box = face[part], box[part]
        normals, before = [n[own_box] for n in normal], offset[own_box]
        for k in range(4):
            vertex = casters.faces[own_face, k]
            at = sum(n * axis[vertex] for n, axis in zip(normals, places, strict=True)) - before
            np.minimum(low[part], at, out=low[part])
            np.maximum(high[part], at, out=high[part])
    slack = 1e-7 * float(np.abs(start).max(initial=0.0))
    below = high <= slack
    some = np.flatnonzero(~below)
    face, box, own = face[some], box[some], own[some]
    size, away = _apart(casters, face, points, box)
    # beside the receiver's plane a face rises by the angle between both
    near = own & (low[some] <= slack) & (high[some] <= LOW * size)
    below[some] = near | (high[some] <= LOW * away)
    result[rows] = below
    return result


def _apart(casters: Casters, face: Numbers, points: Array, box: Numbers) -> tuple[Array, Array]:
    """How large faces (n,) are, and how far away from receivers in boxes at least."""
    used = np.zeros(len(casters.faces), bool)
    used[face] = True
    shown = np.flatnonzero(used)
    radius, middle = np.zeros(len(casters.faces)), np.zeros((3, len(casters.faces)))
    corners = casters.corners[shown]
    own = corners.mean(axis=1)
    middle[:, shown] = own.T
    radius[shown] = np.linalg.norm(corners - own[:, None], axis=2).max(axis=1, initial=0.0)
    centre = points.mean(axis=0)
    reach = np.sqrt(((points - centre) ** 2).sum(axis=1).max(axis=0, initial=0.0))
    gap = np.empty(len(face))
    for part in parts(len(face)):
        own_face, own_box = face[part], box[part]
        ways = [m[own_face] - c[own_box] for m, c in zip(middle, centre, strict=True)]
        gap[part] = np.sqrt(sum(way**2 for way in ways)) - radius[own_face] - reach[own_box]
    return 2.0 * radius[face], gap


def meets_middle(lamp: Lamp, at: Array, corners: Array, against: Flags) -> Flags:
    """Whether the way from points (n, 3) to the lamp's centre goes through faces (n, 4, 3).

    ``against`` (n,): the point lies in the face's plane, and counts as before it.
    """
    near = 0.0 if lamp.far else 1.0
    to = [lamp.centre[axis] - near * at[:, axis] for axis in range(3)]
    ways = [[corners[:, k, axis] - at[:, axis] for axis in range(3)] for k in range(4)]
    middle = [sum(way[axis] for way in ways) for axis in range(3)]
    size, turns = np.zeros(len(at)), []
    for (ax, ay, az), (bx, by, bz) in pairwise([*ways, ways[0]]):
        plane = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
        size += plane[0] * middle[0] + plane[1] * middle[1] + plane[2] * middle[2]
        turns.append(plane[0] * to[0] + plane[1] * to[1] + plane[2] * to[2])
    sign = np.sign(size)
    sign[against] = -1.0
    inside: Flags = sign != 0.0
    for turn in turns:
        inside &= sign * turn >= 0.0
    return inside
