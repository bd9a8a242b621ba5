"""A lamp's tree: boxes in its light space around occluders, and which way these face it.

Nodes are numbered from the root, 1; node i has the children 2 i and 2 i + 1, so that what follows
in depth-first order is found without a stack. A node is *uniform* where all in it, and all that
lies across its edges, is turned the same way to all of the lamp.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from gpusim.gpu import Bound, Device, Recording, Uniform, compare, twin_check
from gpusim.optics.shadow.light_space import ANGLE, UNLIMITED, LightSpace
from gpusim.optics.shadow.occluders import NOBODY, DeviceOccluders, Occluders
from gpusim.optics.shadow.probe import probe_spaces

__all__ = ["Refit", "box_ends", "facing", "planes_of", "refit_twin"]

Array = npt.NDArray[np.float64]
Numbers = npt.NDArray[np.int64]

HIDES_NOTHING, AWAY, TOWARDS, SPLIT, SPLIT_OPEN, AWAY_OPEN, CROSSING, KIND = range(8)
UNIFORM, OPEN, CLOSED = 8, 16, 32
"""Words of nodes, as in ``shaders/optics/shadow/light_space.wgsl``."""

LEVELS = 7
"""Of a tree that one dispatch joins."""


class Refit:
    """The tree of some occluders, fitted to one lamp after the other."""

    def __init__(self, device: Device, occluders: DeviceOccluders) -> None:
        self._occluders = occluders
        self._count, self._leaves = occluders.occluders.count, occluders.occluders.leaves
        self._trees = []
        first = self._leaves
        while first > 1:
            numbers = {"count": self._count, "leaves": self._leaves, "first": first}
            self._trees.append((first, Uniform(device, numbers, "shadow.tree")))
            first >>= LEVELS
        self._gathering = Bound(
            device,
            {
                "tree": self._trees[0][1], "vertices": occluders.vertices,
                "triangles": occluders.triangles, "gathered": occluders.records,
            },
        )  # fmt: skip

    def gather(self, recording: Recording) -> None:
        """Take over where vertices are, if they have moved."""
        if self._occluders.moved:
            self._occluders.moved = False
            self._gathering.run(recording, "optics/shadow/refit", "gather", threads=(self._count,))

    def bound(self, device: Device, light: Uniform) -> list[Bound]:
        """What a lamp's `LightSpace.uniform` is bound to, for every step from the leaves up."""
        own = self._occluders
        shared = {
            "light": light, "occluders": own.records, "neighbours": own.neighbours,
            "boxes": own.boxes, "nodes": own.nodes,
        }  # fmt: skip
        return [Bound(device, {**shared, "tree": tree}) for _, tree in self._trees]

    def record(self, recording: Recording, bound: list[Bound]) -> None:
        """Fit the tree to a lamp."""
        name = "optics/shadow/refit"
        bound[0].run(recording, name, "leaves", threads=(self._leaves,))
        for (first, _), own in zip(self._trees, bound, strict=True):
            own.run(recording, name, "levels", groups=(max(first >> LEVELS, 1),))


def planes_of(corners: Array) -> Array:
    """(T, 4): unit normals, zero of what has no area, and offsets of triangles (T, 3, 3)."""
    a, b, c = (corners[:, k] for k in range(3))
    normal = np.cross(b - a, c - a)
    size = np.linalg.norm(normal, axis=1)
    normal /= np.where(size > 0.0, size, 1.0)[:, None]
    return np.column_stack([normal, np.sum(normal * corners.mean(axis=1), axis=1)])


def facing(space: LightSpace, corners: Array, is_open: npt.NDArray[np.bool_]) -> Numbers:
    """(T,): the way that triangles (T, 3, 3) face a lamp."""
    planes = space.planes(planes_of(corners))
    slack = ANGLE if space.lamp.far else 4.0 * space.rounding
    reach = space.extent(planes) + slack
    away, towards = planes[:, 2] + reach < 0.0, planes[:, 2] - reach > 0.0
    result = np.where(is_open, SPLIT_OPEN, SPLIT)
    result = np.where(away, np.where(is_open, AWAY_OPEN, AWAY), result)
    result = np.where(towards, np.where(is_open, TOWARDS, HIDES_NOTHING), result)
    if space.lamp.far:
        return result
    behind = space.ahead(corners.reshape(-1, 3)).reshape(-1, 3) < space.begin
    crossing = np.where(behind.all(axis=1), HIDES_NOTHING, CROSSING)
    return np.where(behind.any(axis=1) & (result != HIDES_NOTHING), crossing, result)


def box_ends(space: LightSpace, corners: Array) -> tuple[Array, Array]:
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


def refit_twin(
    occluders: Occluders, points: Array, space: LightSpace
) -> tuple[Array, npt.NDArray[np.int64]]:
    """Boxes (2 L, 7), low and high ends of p, q and s and the lowest s with its neighbours', and
    words (2 L,) of the nodes over L leaves; ``points`` (V, 3) relative to the eye."""
    corners, leaves = points[occluders.triangles], occluders.leaves
    kind = facing(space, corners, occluders.open)
    low, high = box_ends(space, corners)
    beside = np.where(occluders.neighbours == NOBODY, 0, occluders.neighbours)
    alone = occluders.neighbours == NOBODY
    same = np.isin(kind, (AWAY, TOWARDS, AWAY_OPEN)) & ~alone.any(axis=1)
    same &= (kind[beside] == kind[:, None]).all(axis=1)
    ring = np.minimum(low[:, 2], np.where(alone, UNLIMITED, low[beside, 2]).min(axis=1))
    word = kind + UNIFORM * same + np.where(occluders.open, OPEN * same, CLOSED)
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
        words[first : 2 * first] = np.where(joined & UNIFORM, joined, mixed)
    return boxes, words


@twin_check("optics/shadow/refit")
def _check(device: Device) -> None:
    for occluders, points, space in probe_spaces():
        own = DeviceOccluders(device, occluders)
        own.move(points)
        refit = Refit(device, own)
        light = Uniform(device, space.uniform(), "shadow.light")
        with device.recording("optics.shadow.refit") as recording:
            refit.gather(recording)
            refit.record(recording, refit.bound(device, light))
        nodes = own.nodes.read().reshape(-1, 8)[1:]
        boxes, words = refit_twin(occluders, points[:, :3].astype(np.float64), space)
        compare("optics/shadow/refit", nodes[:, 7], words[1:], "exact")
        got = nodes[:, [0, 2, 4, 1, 3, 5, 6]]
        compare("optics/shadow/refit", got, boxes[1:], atol=1e-5 * space.scale, rtol=1e-5)
