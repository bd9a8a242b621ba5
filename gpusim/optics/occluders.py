"""The faces that may hide surroundings, and which of them matter to points that lie together.

Flat parts are joined as for shadows (`gpusim.optics.merging`). Of the edges left, a group of points
needs those that may be contours: where faces on both sides are known to hide, or not to, from all
of its points, an edge changes nothing. Faces themselves count where they are on the way up.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from gpusim.optics.casters import Casters
from gpusim.optics.clusters import (
    CLOSED,
    NONE,
    OPEN,
    Balls,
    Slopes,
    facing,
    in_order,
    levels,
    walk,
)
from gpusim.optics.facets import Facets
from gpusim.optics.hemisphere import AGAINST, GROUP, TILT, Around, Receivers
from gpusim.optics.view import View
from gpusim.surface.surface import Surface

__all__ = ["Occluders", "in_groups"]

Array = npt.NDArray[np.float64]
Numbers = npt.NDArray[np.int64]
Bools = npt.NDArray[np.bool_]

FLATNESS = 0.05
"""px at the nearest surface, that joined faces may pass from the surface."""

LOW = 0.01
"""Sine of the height over the horizon below which no row has samples."""

ROUNDING = 2e-6
"""Of the scene's size: heights over planes are told apart by no less."""

UNKNOWN = 2


@dataclass(frozen=True, eq=False)
class Occluders:
    """``facets``, relative to the eye; edges and faces in clusters, from the largest.

    ``edge``, ``face``: in the order in which clusters have them. ``balls`` and ``slopes``: those of
    the edges' clusters, and of the planes on both sides; ``spheres``: those of the faces'.
    ``sag``: how far faces may pass from the surface. ``rounding``: of heights over planes.
    """

    facets: Facets
    edge: Numbers
    face: Numbers
    balls: list[Balls]
    slopes: list[tuple[Slopes, Slopes]]
    spheres: list[Balls]
    sag: float
    rounding: float

    @staticmethod
    def of(view: View, surfaces: Sequence[Surface]) -> Occluders:
        """Those of ``surfaces``, to what ``view`` can tell."""
        depth = 1.0 / max(float(view.inverse_depth().max(initial=0.0)), 1e-300)
        sag = FLATNESS * depth / float(np.abs(np.diag(view.camera.K)[:2]).max())
        casters = Casters.of(surfaces, lambda points: np.full(len(points), sag))
        points = casters.points - view.camera.eye
        facets = Facets.of(points, casters.faces, casters.both_sides)
        # planes of edges without a second face are of none
        planes = np.concatenate([facets.planes, np.zeros((1, 4))])[facets.beside]
        kind = np.where(np.append(facets.both_sides, False)[facets.beside], OPEN, CLOSED)
        kind = np.where(facets.beside < 0, NONE, kind)
        middle = facets.ends.mean(axis=1)
        edge = in_order(
            middle, kind[:, 0], kind[:, 1], *(facing(planes[:, k, :3]) for k in (0, 1))
        )  # fmt: skip
        middle, planes, kind = middle[edge], planes[edge], kind[edge]
        gap = planes[:, :, 3] - np.einsum("eka,ea->ek", planes[:, :, :3], middle)
        foot = middle[:, None] + gap[:, :, None] * planes[:, :, :3]
        reach = np.concatenate([facets.ends[edge], foot], axis=1)
        sizes = levels(len(edge)) if len(edge) else []
        corners = points[casters.faces]
        face = in_order(corners.mean(axis=1))
        return Occluders(
            facets, edge, face, [Balls.of(reach, size) for size in sizes],
            [
                (
                    Slopes.of(planes[:, 0, :3], foot[:, 0], kind[:, 0], size),
                    Slopes.of(planes[:, 1, :3], foot[:, 1], kind[:, 1], size),
                )
                for size in sizes
            ],
            [Balls.of(corners[face], size) for size in (levels(len(face)) if len(face) else [])],
            sag, ROUNDING * float(np.abs(points).max(initial=0.0)),
        )  # fmt: skip

    def around(self, points: Receivers) -> Around:
        """Those that matter to each `GROUP` of ``points`` in order."""
        groups = _Groups.of(points)
        count = len(groups.middle)

        def contour(level: int, group: Numbers, cluster: Numbers) -> Bools:
            return self._contour(groups, level, group, cluster)

        def upward(level: int, group: Numbers, cluster: Numbers) -> Bools:
            return _upward(groups, self.spheres[level], group, cluster)

        none = (np.zeros(count + 1, np.int64), np.zeros(0, np.int64))
        start, edge = none
        if self.balls:
            start, edge = walk([len(v.radius) for v in self.balls], count, contour)
        first, face = none
        if self.spheres:
            first, face = walk([len(v.radius) for v in self.spheres], count, upward)
        return Around(self.facets, start, self.edge[edge], first, self.face[face])

    def _contour(self, groups: _Groups, level: int, group: Numbers, cluster: Numbers) -> Bools:
        """Whether clusters (P,) may hold edges that are contours to groups (P,)."""
        balls = self.balls[level]
        r, thick = groups.radius[group], groups.thick[group]
        to = balls.middle[cluster] - groups.middle[group]
        away = np.sqrt(np.einsum("pa,pa->p", to, to))
        reach = balls.radius[cluster]
        height = np.einsum("pa,pa->p", to, groups.up[group])
        rise = height + reach + thick + groups.lean[group] * (away + reach + r)
        kept = rise > LOW * np.maximum(away - reach - r, 0.0)
        left = np.flatnonzero(kept)
        group, cluster, span = group[left], cluster[left], (away + reach + r)[left]
        one, two = (
            self._hiding(groups, slopes, group, cluster, span) for slopes in self.slopes[level]
        )
        kept[left] = (one == UNKNOWN) | (one != two)
        return np.asarray(kept)

    def _hiding(
        self, groups: _Groups, slopes: Slopes, group: Numbers, cluster: Numbers, span: Array
    ) -> Numbers:
        """How all faces of clusters (P,) hide from all of a group, as `hemisphere` has it, or
        ``UNKNOWN``; ``span`` (P,): how far apart they are at most."""
        axis, spread = slopes.axis[cluster], slopes.spread[cluster]
        product = np.einsum("pa,pa->p", axis, groups.middle[group])
        facing = np.einsum("pa,pa->p", axis, groups.up[group])
        across = np.sqrt(np.maximum(1.0 - facing * facing, 0.0))
        extent = groups.thick[group] + across * groups.radius[group]
        extent = np.minimum(extent, groups.radius[group]) + spread * span + self.rounding
        low, high = slopes.low[cluster] - product - extent, slopes.high[cluster] - product + extent
        near, far = groups.tolerance[group].T
        before, behind = high < -far, low > far
        against = facing - spread - groups.lean[group] < AGAINST
        kind = slopes.kind[cluster]
        result = np.full(len(group), UNKNOWN)
        closed = kind == CLOSED
        result[closed & (behind | (~against & (low > -near)))] = 0
        opened = kind == OPEN
        result[opened & behind] = 1
        result[opened & (low > -near) & (high < near)] = 0
        result[(closed | opened) & before] = -1
        result[kind == NONE] = 0
        return result


@dataclass(frozen=True, eq=False)
class _Groups:
    """What encloses groups of points: ``middle`` (G, 3) and ``radius`` (G,), at most ``thick`` from
    the plane square to ``up``, from which their normals pass by ``lean``; their least and greatest
    ``tolerance`` (G, 2)."""

    middle: Array
    radius: Array
    up: Array
    thick: Array
    lean: Array
    tolerance: Array

    @staticmethod
    def of(points: Receivers) -> _Groups:
        """Of every `GROUP` points."""
        if not len(points.at):
            none = np.zeros(0)
            return _Groups(points.at, none, points.normal, none, none, np.zeros((0, 2)))
        first = np.arange(0, len(points.at), GROUP)
        size = np.minimum(first + GROUP, len(points.at)) - first
        middle = np.add.reduceat(points.at, first) / size[:, None]
        up = np.add.reduceat(points.normal, first)
        up /= np.maximum(np.linalg.norm(up, axis=1), 1e-300)[:, None]
        to = points.at - np.repeat(middle, size, axis=0)
        own = np.repeat(up, size, axis=0)
        return _Groups(
            middle, np.maximum.reduceat(np.linalg.norm(to, axis=1), first), up,
            np.maximum.reduceat(np.abs(np.einsum("na,na->n", to, own)), first),
            np.maximum.reduceat(np.linalg.norm(points.normal - own, axis=1), first),
            np.stack([np.minimum.reduceat(points.tolerance, first),
                      np.maximum.reduceat(points.tolerance, first)], axis=1),
        )  # fmt: skip


def _upward(groups: _Groups, spheres: Balls, group: Numbers, cluster: Numbers) -> Bools:
    """Whether clusters (P,) may hold faces that points of groups (P,) lie on, or that are on the
    way up from them, as far aside as rows begin."""
    to = spheres.middle[cluster] - groups.middle[group]
    away = np.sqrt(np.einsum("pa,pa->p", to, to))
    height = np.einsum("pa,pa->p", to, groups.up[group])
    reach = spheres.radius[cluster] + groups.radius[group] + groups.tolerance[group, 1]
    beside = reach + groups.lean[group] * (away + reach)
    wide = beside + 1.01 * TILT * np.maximum(height + beside, 0.0)
    return np.asarray((height + beside > 0.0) & (away * away - height * height <= wide * wide))


def in_groups(points: Receivers) -> Numbers:
    """The order (N,) in which points that look the same way and lie together follow each other."""
    return in_order(points.at, facing(points.normal))
