"""Where surfaces cut through each other: lines in the image that no edge of a mesh runs along.

Triangles of two surfaces are paired by the cells of a grid over the space that both reach into;
the line in which two of them meet is the part of one's section with the other's plane that lies
inside the other (after Moeller, "A fast triangle-triangle intersection test", Journal of Graphics
Tools 2, 1997). Faces that only touch or coincide don't count.

A wall that stands in a floor parts it into two that see other surroundings, along a line that is no
edge of a mesh. What is interpolated on one side must not know of the other one: what lies behind an
open sheet that cuts a surface is neither seen there nor lit alike.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations, pairwise

import numpy as np

from gpusim.arrays.array_types import Bool, Float, Long
from gpusim.arrays.ragged import batches, expand
from gpusim.arrays.unique import distinct
from gpusim.mesh.polygons import unit_normals
from gpusim.optics.geometry.view import View
from gpusim.surface.surface import Surface

PLANE_TOLERANCE = 1e-9
"""Distance from a plane that counts as none, over the size of what is looked at."""

FINEST = 64
"""Cells of the grid a side, at most."""


def piercings(bodies: Sequence[Float]) -> Float:
    """Segments (S, 2, 3) in which triangles (T, 3, 3) of different ``bodies`` cut each other."""
    return pierced(bodies)[0]


def pierced(bodies: Sequence[Float]) -> tuple[Float, Long]:
    """`piercings`, and the two triangles (S, 2) of each, numbered through all bodies."""
    boxes = [
        (triangles.min(axis=(0, 1)), triangles.max(axis=(0, 1))) if len(triangles) else None
        for triangles in bodies
    ]
    first_of = np.cumsum([0, *(len(triangles) for triangles in bodies)])
    segments, numbers = [np.zeros((0, 2, 3))], [np.zeros((0, 2), np.int64)]
    for a, b in combinations(range(len(bodies)), 2):
        first, second = boxes[a], boxes[b]
        if first is None or second is None:
            continue
        low, high = np.maximum(first[0], second[0]), np.minimum(first[1], second[1])
        if not (low <= high).all():
            continue
        rows = [_inside(bodies[k], low, high) for k in (a, b)]
        triangles_a, triangles_b = (
            bodies[k][inside] for k, inside in zip((a, b), rows, strict=True)
        )
        i, j = _pairs(triangles_a, triangles_b, low, high)
        pair, sections = _sections(triangles_a[i], triangles_b[j])
        segments.append(sections)
        one, two = i[pair], j[pair]
        numbers.append(np.stack([first_of[a] + rows[0][one], first_of[b] + rows[1][two]], axis=1))
    return np.concatenate(segments), np.concatenate(numbers)


def _inside(triangles: Float, low: Float, high: Float) -> Long:
    """Numbers of those whose boxes reach into a box."""
    meets = (triangles.min(axis=1) <= high) & (triangles.max(axis=1) >= low)
    return np.flatnonzero(meets.all(axis=1))


def _pairs(triangles_a: Float, triangles_b: Float, low: Float, high: Float) -> tuple[Long, Long]:
    """Numbers of triangles whose boxes overlap."""
    side = int(np.clip(np.sqrt(len(triangles_a) + len(triangles_b)), 1, FINEST))
    size = np.maximum(high - low, 1e-300) / side
    listed = []
    for triangles in (triangles_a, triangles_b):
        start = np.clip(np.floor((triangles.min(axis=1) - low) / size), 0, side - 1)
        stop = np.clip(np.floor((triangles.max(axis=1) - low) / size), 0, side - 1)
        span = (stop - start + 1).astype(np.int64)
        number, step = expand(span.prod(axis=1))
        wide, tall = span[number, 0], span[number, 1]
        at = start[number].astype(np.int64)
        at += np.stack([step % wide, step // wide % tall, step // (wide * tall)], axis=1)
        cell = (at[:, 2] * side + at[:, 1]) * side + at[:, 0]
        order = np.argsort(cell, kind="stable")
        listed.append((cell[order], number[order]))
    (cell, number), (cells, numbers) = listed
    first = np.searchsorted(cells, cell)
    run, step = expand(np.searchsorted(cells, cell, side="right") - first)
    pair = distinct(number[run] * max(len(triangles_b), 1) + numbers[first[run] + step])
    i, j = np.divmod(pair, max(len(triangles_b), 1))
    meets = (triangles_a[i].min(axis=1) <= triangles_b[j].max(axis=1)).all(axis=1)
    meets &= (triangles_a[i].max(axis=1) >= triangles_b[j].min(axis=1)).all(axis=1)
    return i[meets], j[meets]


def _sections(cutters: Float, crossed: Float) -> tuple[Long, Float]:
    """Which pairs of triangles (n, 3, 3) cut each other, and the segments (S, 2, 3) in which they
    do."""
    normal = unit_normals(cutters)
    height = np.einsum("nvd,nd->nv", crossed - cutters[:, :1], normal)
    flat = PLANE_TOLERANCE * np.abs(np.concatenate([cutters, crossed], axis=1)).max(
        axis=(1, 2), initial=0.0
    )
    cuts = (height.min(axis=1) < -flat) & (height.max(axis=1) > flat)
    cutters, crossed, normal, height = cutters[cuts], crossed[cuts], normal[cuts], height[cuts]
    # the corner alone on its side, then the ways from it to the other two
    above = height > 0.0
    alone = np.where(above.sum(axis=1) == 1, above.argmax(axis=1), above.argmin(axis=1))
    rows = np.arange(len(cutters))
    ends = []
    for step in (1, 2):
        k = (alone + step) % 3
        h, g = height[rows, alone], height[rows, k]
        t = h / np.where(h != g, h - g, 1.0)
        ends.append(crossed[rows, alone] + t[:, None] * (crossed[rows, k] - crossed[rows, alone]))
    p, q = ends
    low, high = np.zeros(len(cutters)), np.ones(len(cutters))
    for k in range(3):
        a, b = cutters[:, k], cutters[:, (k + 1) % 3]
        inward = np.cross(normal, b - a)
        d, e = np.sum(inward * (p - a), axis=1), np.sum(inward * (q - a), axis=1)
        t = d / np.where(d != e, d - e, 1.0)
        low = np.where(d < 0.0, np.where(e < 0.0, 2.0, np.maximum(low, t)), low)
        high = np.where((e < 0.0) & (d >= 0.0), np.minimum(high, t), high)
    crossing = low < high
    p, way = p[crossing], (q - p)[crossing]
    ends = [p + low[crossing, None] * way, p + high[crossing, None] * way]
    return np.flatnonzero(cuts)[crossing], np.stack(ends, axis=1)


TOUCH = 1e-3
"""Of the size of triangles of sheets, by which these reach what they end at."""

NEAR = 0.02
"""Of the size of pieces, by which places before a sheet count as being on it: more than nodes are
moved by (`gpusim.optics.ambient.sky_visibility.INSIDE`)."""

TOGETHER = 1 << 18
"""Pieces and sheets that are looked at together."""


@dataclass(frozen=True, eq=False)
class Discontinuities:
    """Sections of triangles, in order: ``first`` (T + 1,) of each; their boxes ``low`` and ``high``
    (S, 3) relative to the eye, and the planes (S, 4) of what cuts there, the eye before them.

    ``along`` (S, 4): affine in a place, how far along the section it is from where the triangle
    that cuts begins; ``length`` (S,): where that ends.
    """

    first: Long
    low: Float
    high: Float
    planes: Float
    along: Float
    length: Float

    @staticmethod
    def of(view: View, surfaces: Sequence[Surface], corners: Float) -> Discontinuities | None:
        """Of triangles with ``corners`` (T, 3, 3) relative to the eye; None where no open surface
        cuts another one."""
        open_ = np.array([not surface.topology.closed for surface in surfaces])
        if not open_.any() or not view.count or view.body[0] == view.body[-1]:
            return None
        number = np.searchsorted(view.body, np.arange(len(surfaces) + 1))
        bodies = []
        for (a, b), sheet in zip(pairwise(number), open_, strict=True):
            triangles, middle = corners[a:b], corners[a:b].mean(axis=1, keepdims=True)
            # what only stands on another one parts it as well
            bodies.append(middle + (1.0 + TOUCH) * (triangles - middle) if sheet else triangles)
        segments, pair = pierced(bodies)
        parted = np.concatenate([pair[:, 0], pair[:, 1]])
        cutting = np.concatenate([pair[:, 1], pair[:, 0]])
        segments = np.concatenate([segments, segments])
        kept = np.flatnonzero(open_[view.body[cutting]])
        kept = kept[np.argsort(parted[kept], kind="stable")]
        if not len(kept):
            return None
        own = corners[cutting[kept]]
        normal = unit_normals(own)
        offset = -np.sum(normal * own[:, 0], axis=1)
        planes = np.column_stack([normal, offset]) * np.where(offset < 0.0, -1.0, 1.0)[:, None]
        first = np.searchsorted(parted[kept], np.arange(view.count + 1))
        ends = segments[kept]
        way = ends[:, 1] - ends[:, 0]
        way /= np.maximum(np.linalg.norm(way, axis=1), 1e-300)[:, None]
        place = np.stack([np.sum(own[:, k] * way, axis=1) for k in range(3)])
        return Discontinuities(
            first, ends.min(axis=1), ends.max(axis=1), planes,
            np.column_stack([way, -place.min(axis=0)]), np.ptp(place, axis=0),
        )  # fmt: skip

    def behind(self, triangle: Long, at: Float) -> Bool:
        """(P, N) which places ``at`` (P, N, 3) in pieces of triangles (P,) are behind something
        that cuts the piece, or on it; none of pieces of which all are."""
        result = np.zeros(at.shape[:2], bool)
        count = np.diff(self.first)[triangle]
        pieces = np.flatnonzero(count)
        low, high = at[pieces].min(axis=1), at[pieces].max(axis=1)
        size = (high - low).max(axis=1)
        for part in batches(count[pieces], TOGETHER):
            row, step = expand(count[pieces[part]])
            row += part.start
            section = self.first[triangle[pieces[row]]] + step
            slack = NEAR * size[row][:, None]
            meets = (self.low[section] <= high[row] + slack).all(axis=1)
            meets &= (self.high[section] >= low[row] - slack).all(axis=1)
            row, section, slack = row[meets], section[meets], slack[meets]
            places, plane = at[pieces[row]], self.planes[section]
            height = np.einsum("na,nka->nk", plane[:, :3], places) + plane[:, 3:]
            # where the way to the eye goes through the plane
            through = places * (plane[:, 3:] / np.maximum(plane[:, 3:] - height, 1e-300))[..., None]
            hidden = (height <= slack) & self._beside(section, through, slack)
            hidden |= (np.abs(height) <= slack) & self._beside(section, places, slack)
            np.logical_or.at(result, pieces[row], hidden)
        result[result.all(axis=1)] = False
        return result

    def _beside(self, section: Long, at: Float, slack: Float) -> Bool:
        """(n, k) which places ``at`` (n, k, 3) are between the ends of what cuts there, or up to
        ``slack`` (n, 1) beyond."""
        along = self.along[section]
        place = np.einsum("nka,na->nk", at, along[:, :3]) + along[:, 3:]
        return np.asarray((place >= -slack) & (place <= self.length[section][:, None] + slack))
