"""Which edges may be contours to points, and which faces they may lie on or have on their way up.

On the device each point finds its own (``shaders/optics/ambient/silhouette_search.wgsl``); in the
twin points that lie together share lists, which takes less time in NumPy.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from gpusim.arrays.array_types import Bool, Float, Long
from gpusim.gpu import Device
from gpusim.gpu.buffer import Buffer
from gpusim.gpu.texture_array import Texels
from gpusim.optics.ambient.silhouette_bvh import (
    AGAINST,
    CLOSED,
    LOW,
    MEMBERS,
    MIXED,
    NONE,
    OPEN,
    TILT,
    BoundingSpheres,
    EdgeAdjacency,
    NormalCones,
    SamplePoints,
    SilhouetteBVH,
    direction_cells,
    in_order,
    tangent,
    traverse,
)

GROUP = 16
"""Points that share lists of edges and faces."""

UNKNOWN = 2


@dataclass(frozen=True, eq=False)
class SilhouetteLists:
    """Which edges and faces of ``facets`` each `GROUP` of points in order may need.

    ``edge``: those that may be contours; ``face``: those that a point may lie on, and those on the
    way along the normal or at the start of a row. ``edge_start``, ``face_start`` (G + 1,): where a
    group's lists begin.
    """

    facets: EdgeAdjacency
    edge_start: Long
    edge: Long
    face_start: Long
    face: Long

    @staticmethod
    def everywhere(facets: EdgeAdjacency, points: int) -> SilhouetteLists:
        """All for all of so many points."""
        edges, faces = len(facets.ends), len(facets.planes)
        group = np.arange(-(-points // GROUP) + 1)
        return SilhouetteLists(
            facets, edges * group, np.tile(np.arange(edges), len(group) - 1),
            faces * group, np.tile(np.arange(faces), len(group) - 1),
        )  # fmt: skip


def silhouettes_near(
    contours: SilhouetteBVH, points: SamplePoints, size: int = GROUP
) -> SilhouetteLists:
    """Those that matter to every ``size`` of ``points`` in order."""
    groups = _Groups.of(points, size)
    count = len(groups.middle)

    def contour(level: int, group: Long, cluster: Long) -> Bool:
        return _contour(groups, contours, level, group, cluster)

    def upward(level: int, group: Long, cluster: Long) -> Bool:
        return _upward(groups, contours.spheres[level], group, cluster)

    start, edge = traverse([len(v.radius) for v in contours.balls], count, contour)
    first, face = traverse([len(v.radius) for v in contours.spheres], count, upward)
    return SilhouetteLists(contours.facets, start, edge, first, face)


def _contour(
    groups: _Groups, contours: SilhouetteBVH, level: int, group: Long, cluster: Long
) -> Bool:
    """Whether clusters (P,) may hold edges that are contours to groups (P,)."""
    balls = contours.balls[level]
    r, thick = groups.radius[group], groups.thick[group]
    to = balls.middle[cluster] - groups.middle[group]
    away = np.sqrt(np.einsum("pa,pa->p", to, to))
    reach = balls.radius[cluster]
    height = np.einsum("pa,pa->p", to, groups.up[group])
    rise = height + reach + thick + groups.lean[group] * (away + reach + r)
    kept = rise > LOW * np.maximum(away - reach - r, 0.0)
    undecided = np.flatnonzero(kept)
    group, cluster, span = group[undecided], cluster[undecided], (away + reach + r)[undecided]
    one, two = (
        _hiding(groups, slopes, contours.rounding, group, cluster, span)
        for slopes in contours.slopes[level]
    )
    kept[undecided] = (one == UNKNOWN) | (one != two)
    return np.asarray(kept)


def _hiding(
    groups: _Groups,
    slopes: NormalCones,
    rounding: float,
    group: Long,
    cluster: Long,
    span: Float,
) -> Long:
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

    middle: Float
    radius: Float
    up: Float
    thick: Float
    lean: Float
    tolerance: Float

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
        axes = np.repeat(up, count, axis=0)
        return _Groups(
            middle, np.maximum.reduceat(np.linalg.norm(to, axis=1), first), up,
            np.maximum.reduceat(np.abs(np.einsum("na,na->n", to, axes)), first),
            np.maximum.reduceat(np.linalg.norm(points.normal - axes, axis=1), first),
            np.stack([np.minimum.reduceat(points.tolerance, first),
                      np.maximum.reduceat(points.tolerance, first)], axis=1),
        )  # fmt: skip


def _upward(groups: _Groups, spheres: BoundingSpheres, group: Long, cluster: Long) -> Bool:
    """Whether clusters (P,) may hold faces that points of groups (P,) lie on, or that are on the
    way up from them, as far aside as rows begin."""
    to = spheres.middle[cluster] - groups.middle[group]
    away = np.sqrt(np.einsum("pa,pa->p", to, to))
    height = np.einsum("pa,pa->p", to, groups.up[group])
    reach = spheres.radius[cluster] + groups.radius[group] + groups.tolerance[group, 1]
    beside = reach + groups.lean[group] * (away + reach)
    wide = beside + 1.01 * TILT * np.maximum(height + beside, 0.0)
    return np.asarray((height + beside > 0.0) & (away * away - height * height <= wide * wide))


def in_groups(points: SamplePoints) -> Long:
    """The order (N,) in which points that look the same way and lie together follow each other."""
    return in_order(points.at, direction_cells(points.normal))


NOTHING = 0xFFFFFFFF
"""No face, no edge."""

BEYOND = 1e30
"""Farther than any plane."""

MOST_LEVELS = 12
"""Of clusters."""

WALK_LEVEL, WALKED = 6, MEMBERS
"""Clusters of this level at a time, so many: looked at one by one, with what is in them, these are
22,000 turns of a loop, and as many for faces; see `gpusim.optics.paint.feature_grid.LOOP_TURNS`."""

POINTS = 1 << 13
"""At a time, at most."""

ENTRIES = 1 << 23
"""Of the lists of these."""

MOST = (512, 384)
"""Edges and faces that there is room for per point, before more is known."""


@dataclass(frozen=True, eq=False)
class DeviceSilhouetteLists:
    """``count`` points on the device, and which edges and faces they need: ``counts`` (N, 2) of
    them, in lists of ``most`` per point."""

    count: int
    points: Buffer
    counts: Buffer
    edges: Buffer
    faces: Buffer
    most: tuple[int, int]

    def release(self) -> None:
        """Free the buffers."""
        for buffer in (self.points, self.counts, self.edges, self.faces):
            buffer.release()


class SilhouetteBuffers:
    """Edges, planes, the faces' edges, and clusters of both."""

    def __init__(self, device: Device, contours: SilhouetteBVH) -> None:
        self.device, self._most = device, MOST
        facets = contours.facets
        tables = _tables(contours)
        self.edges, self.borders, self.planes, self._clusters, self._spheres = (
            device.texels(max(len(tables[name]), 1), "rgba32uint", f"hemisphere.{name}")
            for name in ("edges", "borders", "planes", "clusters", "spheres")
        )
        for texels, table in zip(self._texels, tables.values(), strict=True):
            if len(table):
                texels.write(table)
        levels = [len(contours.balls), len(contours.spheres)]
        top = [min(WALK_LEVEL, max(count - 1, 0)) for count in levels]
        count = -(-max(len(facets.ends), len(facets.planes)) // (WALKED * MEMBERS**WALK_LEVEL))
        self._stretches = [
            {
                "edge_level": top[0], "face_level": top[1],
                "first": WALKED * k, "last": WALKED * (k + 1),
            }
            for k in range(count)
        ]  # fmt: skip
        self._params = {
            "tilt": TILT, "low": LOW, "rounding": contours.rounding,
            "edge_levels": _levels(contours.balls), "face_levels": _levels(contours.spheres),
        }  # fmt: skip

    @property
    def _texels(self) -> tuple[Texels, ...]:
        return self.edges, self.borders, self.planes, self._clusters, self._spheres

    def batches(self, points: SamplePoints) -> Iterator[DeviceSilhouetteLists]:
        """Some of ``points`` after the other. Whoever asks releases them."""
        begin = 0
        while begin < len(points.at):
            count = min(POINTS, max(ENTRIES // max(self._most), 1), len(points.at) - begin)
            near = self._near(points.part(slice(begin, begin + count)), self._most)
            needed = near.counts.read(np.uint32, (count, 2)).max(axis=0)
            if (needed > self._most).any():
                near.release()
                # those that come next may need some more
                edges, faces = (
                    int(1.25 * n) if n > m else m for n, m in zip(needed, self._most, strict=True)
                )
                self._most = (edges, faces)
                continue
            yield near
            begin += count

    def _near(self, points: SamplePoints, most: tuple[int, int]) -> DeviceSilhouetteLists:
        device, count = self.device, len(points.at)
        table = np.zeros((count, 3, 4), np.float32)
        table[:, 0, :3], table[:, 0, 3] = points.at, points.tolerance
        table[:, 1, :3], table[:, 1, 3] = points.normal, points.thickness
        table[:, 2, :3] = tangent(points.normal)
        near = DeviceSilhouetteLists(
            count,
            device.buffer(table, "hemisphere.points"),
            device.buffer(np.zeros((count, 2), np.uint32), "hemisphere.counts"),
            device.empty(4 * most[0] * count, "hemisphere.needed"),
            device.empty(4 * most[1] * count, "hemisphere.faces"),
            most,
        )
        kernel = device.kernel("optics/ambient/silhouette_search")
        params = {"count": count, "most_edges": most[0], "most_faces": most[1], **self._params}
        with device.recording("optics.around") as recording:
            for stretch in self._stretches:
                bindings = kernel.bind(
                    params=params, stretch=stretch, points=near.points, clusters=self._clusters,
                    spheres=self._spheres, counts=near.counts, edges=near.edges, faces=near.faces,
                )  # fmt: skip
                recording.dispatch(kernel, bindings, threads=(count,))
        return near

    def release(self) -> None:
        """Free the textures."""
        for texels in self._texels:
            texels.release()


def _levels(clusters: Sequence[BoundingSpheres]) -> npt.NDArray[np.uint32]:
    """(12, 4): first cluster and number of clusters, from single things up."""
    counts = [len(level.radius) for level in clusters]
    result = np.zeros((MOST_LEVELS, 4), np.uint32)
    result[: len(counts), 0] = np.cumsum([0, *counts])[:-1][::-1]
    result[: len(counts), 1] = counts[::-1]
    return result


def _tables(contours: SilhouetteBVH) -> dict[str, npt.NDArray[np.uint32]]:
    """Edges (2 E, 4), planes (F, 4), the faces' edges (F, 4), and clusters as the shader reads
    them: four texels for those of edges, one for those of faces."""
    facets = contours.facets
    edges = np.zeros((len(facets.ends), 2, 4), np.uint32)
    edges[:, :, :3] = facets.ends.astype(np.float32).view(np.uint32)
    code = 2 * facets.beside + facets.both_sides[facets.beside]
    edges[:, :, 3] = np.where(facets.beside >= 0, code, NOTHING)
    borders = np.where(facets.edges >= 0, facets.edges, NOTHING).astype(np.uint32)
    clusters, spheres = [np.zeros((0, 4, 4))], [np.zeros((0, 4))]
    for balls, slopes in zip(contours.balls, contours.slopes, strict=True):
        one = np.zeros((len(balls.radius), 4, 4))
        one[:, 0, :3], one[:, 0, 3] = balls.middle, balls.radius
        for k, slope in enumerate(slopes):
            one[:, 1 + k, :3] = slope.axis
            # open surfaces by the sign
            one[:, 1 + k, 3] = np.where(slope.kind == OPEN, -1.0 - slope.spread, slope.spread)
            # without faces nothing hides, with several kinds anything may
            end = np.where(slope.kind == NONE, BEYOND, slope.low)
            one[:, 3, 2 * k] = np.where(slope.kind == MIXED, -BEYOND, end)
            end = np.where(slope.kind == NONE, BEYOND, slope.high)
            one[:, 3, 2 * k + 1] = np.where(slope.kind == MIXED, BEYOND, end)
        clusters.append(one)
    for balls in contours.spheres:
        spheres.append(np.concatenate([balls.middle, balls.radius[:, None]], axis=1))
    numbers = {
        "planes": facets.planes,
        "clusters": np.concatenate(clusters),
        "spheres": np.concatenate(spheres),
    }
    return {"edges": edges.reshape(-1, 4), "borders": borders} | {
        name: table.astype(np.float32).reshape(-1, 4).view(np.uint32)
        for name, table in numbers.items()
    }
