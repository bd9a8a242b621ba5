"""Where faces lie from receivers of light, by the planes of both, pair by pair."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from gpusim.optics.casters import Casters
from gpusim.optics.corners import parts, products
from gpusim.optics.emitters import Lamp

__all__ = ["Planes", "lies_low", "meets_middle", "sides_of_planes"]

Array = npt.NDArray[np.float64]
Numbers = npt.NDArray[np.int64]
Flags = npt.NDArray[np.bool_]

LOW = 5e-4
"""Sine of the elevation up to which what rises beside a receiver hides no light that counts: light
from there is no brighter than this, where from above it is 1."""

FLAT = 1e-9
"""Of the distance from the origin, by which receivers may lie off a face's plane and count as in
it: what float64 leaves of coordinates of a survey, and less than any body is thick."""


def sides_of_planes(
    casters: Casters, face: Numbers, points: Array, box: Numbers
) -> tuple[Flags, Flags]:
    """Whether boxes of points lie behind the planes of faces, or before them, pair by pair."""
    normal = [np.ascontiguousarray(casters.normal[:, axis]) for axis in range(3)]
    offset = np.sum(casters.corners[:, 0] * casters.normal, axis=1)
    slack = (FLAT * np.abs(points).max(initial=0.0)) * np.linalg.norm(casters.normal, axis=1)
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


@dataclass(frozen=True, eq=False)
class Planes:
    """What receivers are in the planes of: ``normal`` (3, n) unit, 0 where there is none; corners
    lie between its offsets ``low`` and ``high`` (n,); ``spread`` (n,): the most that a unit normal
    of one of several triangles differs from it."""

    normal: Array
    low: Array
    high: Array
    spread: Array

    def __getitem__(self, index: Numbers) -> Planes:
        every = self.normal, self.low, self.high, self.spread
        return Planes(*(np.take(v, index, axis=-1) for v in every))

    @staticmethod
    def of(points: Array) -> Planes:
        """Of single triangles, or of flat pieces: the first three of points (k, 3, n)."""
        start = points[0]
        across, along = points[1] - start, points[2] - start
        normal = np.stack([
            across[1] * along[2] - across[2] * along[1],
            across[2] * along[0] - across[0] * along[2],
            across[0] * along[1] - across[1] * along[0],
        ])  # fmt: skip
        length = np.sqrt(products(normal, normal))
        normal /= np.where(length > 0.0, length, 1.0)
        offset = products(normal, start)
        return Planes(normal, offset, offset, np.zeros(len(offset)))


def lies_low(
    lamp: Lamp, casters: Casters, face: Numbers, points: Array, planes: Planes, box: Numbers,
    body: Numbers, eye: Array,
) -> Flags:  # fmt: skip
    """Whether faces hide nothing that counts of a lamp, as they don't rise over the ``planes`` of
    receivers in boxes of points (k, 3, n), pair by pair: what bulges hides nothing of itself.

    Where a plane cuts the lamp, what is below it may still be lit by a smooth normal: that is
    hidden by none of a closed surface's own faces that are as low. ``body`` (n,): number of the
    receivers' surface, or -1 (of large ones); ``eye`` (3,): which sees them from above.
    """
    normal, spread = planes.normal.copy(), planes.spread
    centre, reach = _round(points)
    offset, half = 0.5 * (planes.low + planes.high), 0.5 * (planes.high - planes.low)
    turned = np.abs(products(normal, lamp.u)) + np.abs(products(normal, lamp.v))
    height = products(normal, lamp.centre) - (0.0 if lamp.far else 1.0) * offset
    # several triangles agree on which side of their planes something lies
    far = np.ones(len(offset)) if lamp.far else _far(lamp.centre, centre, reach)
    size = float(np.linalg.norm(lamp.u) + np.linalg.norm(lamp.v))
    whole = np.abs(height) > turned + half + spread * (far + size)
    seen = products(normal, eye) - offset
    sure = (np.abs(seen) > half + spread * _far(eye, centre, reach)) | (spread + half == 0.0)
    side = np.where(whole, np.sign(height), np.where(sure, np.sign(seen), 0.0))
    side[~normal.any(axis=0)] = 0.0
    normal *= side
    offset = offset * side
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
    low += half[box]
    high += half[box]
    slack = 1e-7 * float(np.abs(points[0]).max(initial=0.0))
    below = (high <= slack) & (spread[box] == 0.0)
    some = np.flatnonzero(~below)
    face, box, own, low, high = face[some], box[some], own[some], low[some], high[some]
    radius, away = _apart(casters, face, centre, box)
    # others' normals lean by so much over all that is between
    least, most = away - radius - reach[box], away + radius + reach[box]
    lean = spread[box] * most
    # beside the receiver's plane a face rises by the angle between both
    near = own & (low + lean <= slack) & (high + lean <= 2.0 * LOW * radius)
    below[some] = near | (high + lean <= np.maximum(LOW * least, np.where(lean > 0.0, slack, 0.0)))
    result[rows] = below
    return result


def _round(points: Array) -> tuple[Array, Array]:
    """Centres (3, n) and radii (n,) of boxes of points (k, 3, n)."""
    centre = points.mean(axis=0)
    square = np.zeros(points.shape[2])
    for point in points:
        way = point - centre
        np.maximum(square, products(way, way), out=square)
    return centre, np.sqrt(square)


def _far(place: Array, centre: Array, reach: Array) -> Array:
    """(n,): how far something within ``reach`` of centres (3, n) may be from a place."""
    way = centre - place[:, None]
    return np.asarray(np.sqrt(products(way, way)) + reach)


def _apart(casters: Casters, face: Numbers, centre: Array, box: Numbers) -> tuple[Array, Array]:
    """How large faces (n,) are, their radii, and how far their middles are from those (3, boxes) of
    receivers."""
    used = np.zeros(len(casters.faces), bool)
    used[face] = True
    shown = np.flatnonzero(used)
    radius, middle = np.zeros(len(casters.faces)), np.zeros((3, len(casters.faces)))
    corners = casters.corners[shown]
    own = corners.mean(axis=1)
    middle[:, shown] = own.T
    radius[shown] = np.linalg.norm(corners - own[:, None], axis=2).max(axis=1, initial=0.0)
    away = np.empty(len(face))
    for part in parts(len(face)):
        own_face, own_box = face[part], box[part]
        ways = [m[own_face] - c[own_box] for m, c in zip(middle, centre, strict=True)]
        away[part] = np.sqrt(sum(way**2 for way in ways))
    return radius[face], away


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
