"""Which edges may be contours to points, and which faces they may lie on or have on their way up.

Twin of ``shaders/optics/ambient/silhouette_search.wgsl``, where each point finds its own; here
points that lie together share lists, which takes less time in NumPy.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from gpusim.optics.ambient.bounding_hierarchy import (
    CLOSED,
    NONE,
    OPEN,
    BoundingSpheres,
    NormalCones,
    facing,
    in_order,
    traverse,
)
from gpusim.optics.ambient.hemisphere_mask import GROUP, SilhouetteLists
from gpusim.optics.ambient.sample_points import AGAINST, TILT, SamplePoints
from gpusim.optics.ambient.silhouette_bvh import LOW, SilhouetteBVH

__all__ = ["in_groups", "silhouettes_near"]

Array = npt.NDArray[np.float64]
Numbers = npt.NDArray[np.int64]
Bools = npt.NDArray[np.bool_]

UNKNOWN = 2


def silhouettes_near(
    contours: SilhouetteBVH, points: SamplePoints, size: int = GROUP
) -> SilhouetteLists:
    """Those that matter to every ``size`` of ``points`` in order."""
    groups = _Groups.of(points, size)
    count = len(groups.middle)

    def contour(level: int, group: Numbers, cluster: Numbers) -> Bools:
        return _contour(groups, contours, level, group, cluster)

    def upward(level: int, group: Numbers, cluster: Numbers) -> Bools:
        return _upward(groups, contours.spheres[level], group, cluster)

    start, edge = traverse([len(v.radius) for v in contours.balls], count, contour)
    first, face = traverse([len(v.radius) for v in contours.spheres], count, upward)
    return SilhouetteLists(contours.facets, start, edge, first, face)


def _contour(
    groups: _Groups, contours: SilhouetteBVH, level: int, group: Numbers, cluster: Numbers
) -> Bools:
    """Whether clusters (P,) may hold edges that are contours to groups (P,)."""
    balls = contours.balls[level]
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
        _hiding(groups, slopes, contours.rounding, group, cluster, span)
        for slopes in contours.slopes[level]
    )
    kept[left] = (one == UNKNOWN) | (one != two)
    return np.asarray(kept)


def _hiding(
    groups: _Groups,
    slopes: NormalCones,
    rounding: float,
    group: Numbers,
    cluster: Numbers,
    span: Array,
) -> Numbers:
    """How all faces of clusters (P,) hide from all of a group, as `hemisphere_mask` has it, or
    ``UNKNOWN``; ``span`` (P,): how far apart they are at most."""
    axis, spread = slopes.axis[cluster], slopes.spread[cluster]
    product = np.einsum("pa,pa->p", axis, groups.middle[group])
    facing = np.einsum("pa,pa->p", axis, groups.up[group])
    across = np.sqrt(np.maximum(1.0 - facing * facing, 0.0))
    extent = groups.thick[group] + across * groups.radius[group]
    extent = np.minimum(extent, groups.radius[group]) + spread * span + rounding
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
    def of(points: SamplePoints, size: int) -> _Groups:
        """Of every ``size`` points."""
        if not len(points.at):
            none = np.zeros(0)
            return _Groups(points.at, none, points.normal, none, none, np.zeros((0, 2)))
        first = np.arange(0, len(points.at), size)
        count = np.minimum(first + size, len(points.at)) - first
        middle = np.add.reduceat(points.at, first) / count[:, None]
        up = np.add.reduceat(points.normal, first)
        up /= np.maximum(np.linalg.norm(up, axis=1), 1e-300)[:, None]
        to = points.at - np.repeat(middle, count, axis=0)
        own = np.repeat(up, count, axis=0)
        return _Groups(
            middle, np.maximum.reduceat(np.linalg.norm(to, axis=1), first), up,
            np.maximum.reduceat(np.abs(np.einsum("na,na->n", to, own)), first),
            np.maximum.reduceat(np.linalg.norm(points.normal - own, axis=1), first),
            np.stack([np.minimum.reduceat(points.tolerance, first),
                      np.maximum.reduceat(points.tolerance, first)], axis=1),
        )  # fmt: skip


def _upward(groups: _Groups, spheres: BoundingSpheres, group: Numbers, cluster: Numbers) -> Bools:
    """Whether clusters (P,) may hold faces that points of groups (P,) lie on, or that are on the
    way up from them, as far aside as rows begin."""
    to = spheres.middle[cluster] - groups.middle[group]
    away = np.sqrt(np.einsum("pa,pa->p", to, to))
    height = np.einsum("pa,pa->p", to, groups.up[group])
    reach = spheres.radius[cluster] + groups.radius[group] + groups.tolerance[group, 1]
    beside = reach + groups.lean[group] * (away + reach)
    wide = beside + 1.01 * TILT * np.maximum(height + beside, 0.0)
    return np.asarray((height + beside > 0.0) & (away * away - height * height <= wide * wide))


def in_groups(points: SamplePoints) -> Numbers:
    """The order (N,) in which points that look the same way and lie together follow each other."""
    return in_order(points.at, facing(points.normal))
