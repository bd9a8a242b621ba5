"""Which edges may be contours to points, and which faces they may lie on or have on their way up.

On the device each point finds its own in a hierarchy
(``shaders/optics/ambient/silhouette_search.wgsl``); the twins look at all of them one by one.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from gpusim.arrays.array_types import Bool, Long
from gpusim.gpu import Device
from gpusim.gpu.buffer import Buffer
from gpusim.gpu.texture_array import Texels
from gpusim.optics.ambient.silhouette_bvh import (
    AGAINST,
    LOW,
    MEMBERS,
    MIXED,
    NONE,
    OPEN,
    TILT,
    BoundingSpheres,
    EdgeAdjacency,
    SamplePoints,
    SilhouetteBVH,
    direction_cells,
    in_order,
    tangent,
)


def hiding(points: SamplePoints, facets: EdgeAdjacency) -> Long:
    """(N, F + 1): -1 where faces hide by their outside, 1 by their inside, 0 where they don't, as
    where there is no face, in the last column."""
    normal = facets.planes[:, :3].T
    height, facing = facets.planes[:, 3] - points.at @ normal, points.normal @ normal
    near, closed = points.tolerance[:, None], ~facets.both_sides
    against = closed & (np.abs(height) <= near) & (facing < AGAINST)
    behind = ~closed & (height > near)
    result = np.zeros((len(points.at), len(facets.planes) + 1), np.int64)
    result[:, :-1] = np.where(against | (height < -near), -1, behind)
    return result


def contour_edges(points: SamplePoints, facets: EdgeAdjacency) -> Long:
    """(N, E): by how much edges' faces on the left hide more than those on the right; 0 where an
    edge is no contour to a point."""
    hides = hiding(points, facets)
    return np.asarray(hides[:, facets.beside[:, 0]] - hides[:, facets.beside[:, 1]])


def faces_upward(points: SamplePoints, facets: EdgeAdjacency) -> Bool:
    """(N, F): whether points may lie on a face, or have it on their way up, as far aside as rows
    begin."""
    to = facets.balls[:, :3] - points.at[:, None]
    height = np.einsum("nfa,na->nf", to, points.normal)
    reach = facets.balls[:, 3] + points.tolerance[:, None]
    wide = reach + 1.01 * TILT * np.maximum(height + reach, 0.0)
    aside = np.einsum("nfa,nfa->nf", to, to) - height * height
    return np.asarray((height + reach > 0.0) & (aside <= wide * wide))


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
