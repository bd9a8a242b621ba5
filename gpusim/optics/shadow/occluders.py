"""Occluders: the triangles of all surfaces in Morton order, and what lies across their edges.

Both stay while vertices move, and so does the tree over them, whose boxes are fitted again for each
lamp (Karras, "Maximizing parallelism in the construction of BVHs, octrees, and k-d trees", 2012,
without his search for splits: the tree halves the order).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from gpusim.errors import InputError
from gpusim.gpu import Device, Texels
from gpusim.optics.geometry.triangle_corners import CHUNK, parts
from gpusim.surface.surface import Surface
from gpusim.surface.topology import Topology

__all__ = ["NO_OCCLUDER", "SHEETS", "DeviceOccluders", "Occluders", "relative_points"]

Array = npt.NDArray[np.float64]
Numbers = npt.NDArray[np.int64]

NO_OCCLUDER = 0xFFFFFFFF
"""What lies across an edge that isn't shared by two triangles, one each way."""

SHEETS = 32
"""Open surfaces that have a number."""

MORTON_BITS = 16


@dataclass(frozen=True, eq=False)
class Occluders:
    """Triangles of surfaces, one after the other in Morton order.

    ``triangles`` (T, 3): vertices, those of all surfaces in order. ``neighbours`` (T, 3) uint32:
    triangle across the edge from each corner to the next, or `NO_OCCLUDER`. ``sheet`` (T,): 0 of
    closed surfaces; of open ones, of which both sides hide, their number from 1 on, or
    `SHEETS` + 1.
    ``rank`` (T,): place in this order of each triangle of all surfaces.
    """

    triangles: Numbers
    neighbours: npt.NDArray[np.uint32]
    sheet: Numbers
    rank: Numbers

    @staticmethod
    def of(surfaces: Sequence[Surface]) -> Occluders:
        """In the order of where the triangles are now.

        Raises
        ------
        InputError
            No triangle at all.
        """
        triangles, neighbours, sheets = [], [], []
        vertex = first = 0
        for number, surface in enumerate(surfaces):
            topology = surface.topology
            count = len(topology.triangles)
            across = _across(topology)
            triangles.append(np.ascontiguousarray(topology.triangles) + vertex)
            neighbours.append(np.where(across >= 0, across + first, -1))
            sheets.append(np.full(count, 0 if topology.closed else min(number, SHEETS) + 1))
            vertex += len(surface.points)
            first += count
        if not first:
            raise InputError("shadows occluders; got no triangles; expected one at least")
        every = np.concatenate(triangles)
        points = np.concatenate([surface.points for surface in surfaces])
        order = np.argsort(_morton_codes(points[every].mean(axis=1)), kind="stable")
        rank = np.empty(first, np.int64)
        rank[order] = np.arange(first)
        beside = np.concatenate(neighbours)[order]
        return Occluders(
            every[order], np.where(beside >= 0, rank[beside], NO_OCCLUDER).astype(np.uint32),
            np.concatenate(sheets)[order], rank,
        )  # fmt: skip

    @property
    def count(self) -> int:
        """Number of triangles."""
        return len(self.triangles)

    @cached_property
    def open(self) -> npt.NDArray[np.bool_]:
        """(T,): whether they are of open surfaces."""
        return self.sheet > 0

    @cached_property
    def owner(self) -> npt.NDArray[np.int32]:
        """(T,): ``rank`` of triangles of open surfaces, -1 of closed ones."""
        return np.where(self.open[self.rank], self.rank, -1).astype(np.int32)

    @property
    def leaves(self) -> int:
        """Number of the tree's leaves, a power of two, 128 at least: seven levels are one step. The
        last one is empty: what follows it in depth-first order would be the root again."""
        return 1 << max(self.count.bit_length(), 7)


def relative_points(surfaces: Sequence[Surface], eye: Array) -> npt.NDArray[np.float32]:
    """(V, 3): vertices of all surfaces relative to the ``eye``, subtracted in float64."""
    result = np.empty(3 * sum(len(surface.points) for surface in surfaces), np.float32)
    eyes = np.tile(eye, CHUNK)
    first = 0
    for surface in surfaces:
        # in long rows: NumPy takes three times as long for those of three
        for part in parts(len(surface.points)):
            own = surface.points[part].reshape(-1)
            last = first + len(own)
            np.subtract(own, eyes[: len(own)], out=result[first:last], casting="same_kind")
            first = last
    return result.reshape(-1, 3)


def _across(topology: Topology) -> Numbers:
    """(T, 3): see `Occluders.neighbours`, -1 for none."""
    own = np.arange(len(topology.triangles))[:, None]
    edge = topology.edge
    first, second = topology.first[edge], topology.second[edge]
    # neighbours run along their edge opposite ways
    begin = np.asarray(topology.triangles)
    forth = np.empty(len(topology.first), np.int64)
    back = np.empty(len(topology.first), np.int64)
    is_first = first == own
    forth[edge[is_first]] = begin[is_first]
    back[edge[~is_first]] = begin[~is_first]
    shared = topology.manifold & (topology.first != topology.second)
    shared[shared] = forth[shared] != back[shared]
    return np.where(shared[edge], np.where(is_first, second, first), -1)


def _morton_codes(places: Array) -> npt.NDArray[np.uint64]:
    """(n,): bits of x, y and z of ``places`` (n, 3) in turn."""
    low = places.min(axis=0)
    size = max(float((places.max(axis=0) - low).max()), 1e-300)
    cell = ((places - low) / size * ((1 << MORTON_BITS) - 1)).astype(np.uint64)
    masks = (0x1F0000FF0000FF, 0x100F00F00F00F00F, 0x10C30C30C30C30C3, 0x1249249249249249)
    for shift, mask in zip((16, 8, 4, 2), masks, strict=True):
        cell = (cell | (cell << np.uint64(shift))) & np.uint64(mask)
    result: npt.NDArray[np.uint64] = (
        cell[:, 0] | cell[:, 1] << np.uint64(1) | cell[:, 2] << np.uint64(2)
    )
    return result


class DeviceOccluders:
    """`Occluders` on a device, and where their vertices are now."""

    def __init__(self, device: Device, occluders: Occluders) -> None:
        self.device, self.occluders = device, occluders
        count = occluders.count
        corners = np.zeros((count, 4), np.uint32)
        corners[:, :3], corners[:, 3] = occluders.triangles, occluders.sheet
        beside = np.full((count, 4), NO_OCCLUDER, np.uint32)
        beside[:, :3] = occluders.neighbours
        vertices = int(occluders.triangles.max()) + 1
        self.triangles = device.buffer(corners, "shadow.triangles")
        self.vertices = device.empty(12 * vertices, "shadow.vertices")
        self.neighbours = device.texels(count, "rgba32uint", "shadow.neighbours")
        self.neighbours.write(beside)
        self.records: Texels = device.texels(4 * count, "rgba32float", "shadow.occluders")

    def move(self, points: npt.NDArray[np.float32]) -> None:
        """Put the vertices at ``points`` (V, 3), relative to the eye."""
        used = self.vertices.nbytes // 12
        if len(points) < used or points.shape[1:] != (3,):
            raise InputError(
                f"shadows vertices; got shape {points.shape}; expected ({used}, 3) at least"
            )
        self.vertices.write(points[:used])
