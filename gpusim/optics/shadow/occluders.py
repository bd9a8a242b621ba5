"""Occluders: the triangles of all surfaces in Morton order, and a tree over them for each lamp.

Their order and what lies across their edges stay while vertices move, and so does the tree, whose
boxes are fitted again for each lamp (Karras, "Maximizing parallelism in the construction of BVHs,
octrees, and k-d trees", 2012, without his search for splits: the tree halves the order).

Of a lamp's tree boxes in its light space around occluders are known, and which way these face it.
Nodes are numbered from the root, 1; node i has the children 2 i and 2 i + 1, so that what follows
in depth-first order is found without a stack. A node is *uniform* where all in it, and all that
lies across its edges, is turned the same way to all of the lamp.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from gpusim.arrays.array_types import Bool, Float, Int, Long, Single
from gpusim.arrays.z_order import z_order
from gpusim.gpu import Bound, Device, Recording, Texels, Uniform
from gpusim.mesh.polygons import unit_normals
from gpusim.optics.geometry.triangle_corners import CHUNK, parts
from gpusim.optics.shadow.light_space import ANGLE, UNLIMITED, LightSpace
from gpusim.surface.surface import Surface
from gpusim.surface.topology import Topology
from gpusim.validation import require

NO_OCCLUDER = 0xFFFFFFFF
"""What lies across an edge that isn't shared by two triangles, one each way."""

SHEETS = 32
"""Open surfaces that have a number."""


@dataclass(frozen=True, eq=False)
class Occluders:
    """Triangles of surfaces, one after the other in Morton order.

    ``triangles`` (T, 3): vertices, those of all surfaces in order. ``neighbours`` (T, 3) uint32:
    triangle across the edge from each corner to the next, or `NO_OCCLUDER`. ``sheet`` (T,): 0 of
    closed surfaces; of open ones, of which both sides hide, their number from 1 on, or
    `SHEETS` + 1.
    ``rank`` (T,): place in this order of each triangle of all surfaces.
    """

    triangles: Long
    neighbours: npt.NDArray[np.uint32]
    sheet: Long
    rank: Long

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
        require(first > 0, "shadows occluders", "no triangles", "one at least")
        every = np.concatenate(triangles)
        points = np.concatenate([surface.points for surface in surfaces])
        order = np.argsort(z_order(points[every].mean(axis=1)), kind="stable")
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
    def open(self) -> Bool:
        """(T,): whether they are of open surfaces."""
        return self.sheet > 0

    @cached_property
    def owner(self) -> Int:
        """(T,): ``rank`` of triangles of open surfaces, -1 of closed ones."""
        return np.where(self.open[self.rank], self.rank, -1).astype(np.int32)

    @property
    def leaves(self) -> int:
        """Number of the tree's leaves, a power of two, 128 at least: seven levels are one step. The
        last one is empty: what follows it in depth-first order would be the root again."""
        return 1 << max(self.count.bit_length(), 7)


def relative_points(surfaces: Sequence[Surface], eye: Float) -> Single:
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


def _across(topology: Topology) -> Long:
    """(T, 3): see `Occluders.neighbours`, -1 for none."""
    own, edge = np.arange(len(topology.triangles))[:, None], topology.edge
    shared = topology.opposed & (topology.first != topology.second)
    first, second = topology.first[edge], topology.second[edge]
    return np.where(shared[edge], np.where(first == own, second, first), -1)


HIDES_NOTHING, AWAY, TOWARDS, SPLIT, SPLIT_OPEN, AWAY_OPEN, CROSSING, KIND = range(8)
UNIFORM, OPEN, CLOSED, SHEET = 8, 16, 32, 64
"""Words of nodes, as in ``shaders/optics/shadow/light_space.wgsl``."""

LEVELS = 7
"""Of a tree that one dispatch joins."""

NAME = "optics/shadow/bvh_refit"


class OccluderBVH:
    """Occluders on a device, where their vertices are now, and the tree of each light space, which
    stays until they move."""

    def __init__(self, device: Device, occluders: Occluders) -> None:
        self.device, self.occluders = device, occluders
        count = occluders.count
        corners = np.zeros((count, 4), np.uint32)
        corners[:, :3], corners[:, 3] = occluders.triangles, occluders.sheet
        beside = np.full((count, 4), NO_OCCLUDER, np.uint32)
        beside[:, :3] = occluders.neighbours
        vertices = int(occluders.triangles.max()) + 1
        self._vertices = device.empty(12 * vertices, "shadow.vertices")
        self._neighbours = device.texels(count, "rgba32uint", "shadow.neighbours")
        self._neighbours.write(beside)
        self._records: Texels = device.texels(4 * count, "rgba32float", "shadow.occluders")
        self._boxes = device.empty(64 * occluders.leaves, "shadow.boxes")
        self._levels = []
        first = occluders.leaves
        while first > 1:
            numbers = {"count": occluders.count, "leaves": occluders.leaves, "first": first}
            self._levels.append((first, Uniform(device, numbers, "shadow.tree")))
            first >>= LEVELS
        self._gathering = Bound(
            device,
            {
                "tree": self._levels[0][1], "vertices": self._vertices,
                "triangles": device.buffer(corners, "shadow.triangles"), "gathered": self._records,
            },
        )  # fmt: skip
        self._gathered = True
        self._trees: list[_Tree] = []

    def move(self, points: Single) -> None:
        """Put the vertices at ``points`` (V, 3), relative to the eye."""
        used = self._vertices.nbytes // 12
        fits = len(points) >= used and points.shape[1:] == (3,)
        require(fits, "shadows vertices", f"shape {points.shape}", f"({used}, 3) at least")
        self._vertices.write(points[:used])
        self._gathered = False
        for tree in self._trees:
            tree.space = None

    def bindings(self, place: int) -> dict[str, Any]:
        """By their WGSL names; of the space with this number among all."""
        while place >= len(self._trees):
            self._trees.append(_Tree(self.device, self.occluders.leaves))
        tree = self._trees[place]
        return {
            "occluders": self._records, "neighbours": self._neighbours, "nodes": tree.nodes,
            "sides": tree.sides,
        }  # fmt: skip

    def gather(self, recording: Recording) -> None:
        """Put corners of occluders side by side, where vertices have moved."""
        if not self._gathered:
            self._gathered = True
            self._gathering.run(recording, NAME, "gather", threads=(self.occluders.count,))

    def fit(self, recording: Recording, place: int, space: LightSpace) -> None:
        """Let the tree with this number be that of a space."""
        self.gather(recording)
        shared = {**self.bindings(place), "boxes": self._boxes}
        tree = self._trees[place]
        if tree.suits(space):
            return
        tree.space = space
        if tree.bound:
            tree.light.update(space.uniform())
        else:
            tree.light = Uniform(self.device, space.uniform(), "shadow.light")
            shared["light"] = tree.light
            tree.bound = [Bound(self.device, {**shared, "tree": own}) for _, own in self._levels]
        recording.clear(tree.sides)
        tree.bound[0].run(recording, NAME, "leaves", threads=(self.occluders.leaves,))
        for (first, _), bound in zip(self._levels, tree.bound, strict=True):
            bound.run(recording, NAME, "levels", groups=(max(first >> LEVELS, 1),))


class _Tree:
    """Nodes, and the space that they are of."""

    light: Uniform

    def __init__(self, device: Device, leaves: int) -> None:
        self.nodes: Texels = device.texels(4 * leaves, "rgba32float", "shadow.nodes")
        self.sides = device.empty(4 * SHEETS, "shadow.sides")
        self.space: LightSpace | None = None
        self.bound: list[Bound] = []

    def suits(self, space: LightSpace) -> bool:
        """Whether nothing that the nodes depend on differs."""
        own = self.space
        return own is not None and own.lamp is space.lamp and bool((own.axis == space.axis).all())


def planes_of(corners: Float) -> Float:
    """(T, 4): unit normals, zero of what has no area, and offsets of triangles (T, 3, 3)."""
    normal = unit_normals(corners)
    return np.column_stack([normal, np.sum(normal * corners.mean(axis=1), axis=1)])


def facing(space: LightSpace, corners: Float, is_open: Bool) -> Long:
    """(T,): the way that triangles (T, 3, 3) face a lamp."""
    planes = space.planes(planes_of(corners))
    slack = ANGLE if space.lamp.far else space.on_face
    extent = space.extent(planes)
    reach = extent + slack
    away, towards = planes[:, 2] + reach < 0.0, planes[:, 2] - reach > 0.0
    result = np.where(is_open, SPLIT_OPEN, SPLIT)
    result = np.where(away, np.where(is_open, AWAY_OPEN, AWAY), result)
    result = np.where(towards, np.where(is_open, TOWARDS, HIDES_NOTHING), result)
    if space.lamp.far:
        return result
    result[~is_open & (planes[:, 2] - extent > -slack)] = HIDES_NOTHING
    behind = space.ahead(corners.reshape(-1, 3)).reshape(-1, 3) < space.begin
    crossing = np.where(behind.all(axis=1), HIDES_NOTHING, CROSSING)
    return np.where(behind.any(axis=1) & (result != HIDES_NOTHING), crossing, result)


def box_ends(space: LightSpace, corners: Float) -> tuple[Float, Float]:
    """Low and high ends (T, 3) of boxes around triangles (T, 3, 3)."""
    low = np.full((len(corners), 3), UNLIMITED)
    high = -low
    for k in range(3):
        a, b = corners[:, k], corners[:, (k + 1) % 3]
        start, stop = space.ahead(a), space.ahead(b)
        here = np.ones(len(a), bool) if space.lamp.far else start >= space.begin
        place = space.place(a)
        slack = space.rounding_at(place)
        low[here] = np.minimum(low, place - slack)[here]
        high[here] = np.maximum(high, place + slack)[here]
        if space.lamp.far:
            continue
        cuts = np.flatnonzero((start < space.begin) != (stop < space.begin))
        share = ((space.begin - start) / np.where(stop != start, stop - start, 1.0))[cuts, None]
        y = a[cuts] + np.clip(share, 0.0, 1.0) * (b - a)[cuts] - space.centre
        beside = np.stack([y @ space.across, y @ space.along], axis=1)
        least = np.where(beside < space.begin, -UNLIMITED, beside / space.begin)
        most = np.where(beside > -space.begin, UNLIMITED, beside / space.begin)
        low[cuts, :2] = np.minimum(low[cuts, :2], least)
        high[cuts, :2] = np.maximum(high[cuts, :2], most)
        high[cuts, 2] = UNLIMITED
    return low, high


def single_sheets(space: LightSpace, occluders: Occluders, corners: Float) -> Long:
    """(T,): ``sheet`` of occluders with ``corners`` (T, 3, 3) where it hides nothing of itself on
    the side that a lamp lights, else 0: all of it turns one side to all of the lamp."""
    kind = facing(space, corners, occluders.open)
    result = np.zeros_like(occluders.sheet)
    for number in range(1, SHEETS + 1):
        if space.sheets >> (number - 1) & 1:
            own = occluders.sheet == number
            if (kind[own] == TOWARDS).all() or (kind[own] == AWAY_OPEN).all():
                result[own] = number
    return result


def refit_twin(occluders: Occluders, points: Float, space: LightSpace) -> tuple[Float, Long]:
    """Boxes (2 L, 7), low and high ends of p, q and s and the lowest s with its neighbours', and
    words (2 L,) of the nodes over L leaves; ``points`` (V, 3) relative to the eye."""
    corners, leaves = points[occluders.triangles], occluders.leaves
    kind = facing(space, corners, occluders.open)
    low, high = box_ends(space, corners)
    beside = np.where(occluders.neighbours == NO_OCCLUDER, 0, occluders.neighbours)
    alone = occluders.neighbours == NO_OCCLUDER
    same = np.isin(kind, (AWAY, TOWARDS, AWAY_OPEN)) & ~alone.any(axis=1)
    same &= (kind[beside] == kind[:, None]).all(axis=1)
    ring = np.minimum(low[:, 2], np.where(alone, UNLIMITED, low[beside, 2]).min(axis=1))
    word = kind + UNIFORM * same + np.where(occluders.open, OPEN * same, CLOSED)
    word += SHEET * np.where(occluders.sheet <= SHEETS, occluders.sheet, 0)
    boxes = np.full((2 * leaves, 7), UNLIMITED)
    boxes[:, 3:6] = -UNLIMITED
    words = np.zeros(2 * leaves, np.int64)
    used = np.flatnonzero(kind != HIDES_NOTHING)
    boxes[leaves + used] = np.column_stack([low, high, ring])[used]
    words[leaves + used] = word[used]
    first = leaves
    while first > 1:
        one, other = boxes[first : 2 * first : 2], boxes[first + 1 : 2 * first : 2]
        a, b = words[first : 2 * first : 2], words[first + 1 : 2 * first : 2]
        first //= 2
        boxes[first : 2 * first] = np.minimum(one, other)
        boxes[first : 2 * first, 3:6] = np.maximum(one[:, 3:6], other[:, 3:6])
        joined = np.where(a == 0, b, np.where((b == 0) | (a == b), a, 0))
        mixed = (a | b) & CLOSED
        mixed = np.where((mixed == 0) & ((a | b) != 0), KIND, mixed)
        same = (a == 0) | (b == 0) | (a // SHEET == b // SHEET)
        mixed += SHEET * np.where(same, (a | b) // SHEET, 0)
        words[first : 2 * first] = np.where(joined & UNIFORM, joined, mixed)
    return boxes, words
