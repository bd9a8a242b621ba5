"""Which directions over a point the faces around it hide: intervals of bits along great circles.

A matte face receives from a direction by the cosine of its angle to the normal, so that equal
areas of the hemisphere's shadow on the face's plane count alike. 64 great circles run from near
the normal to the horizon, turned by equal angles; along each of them lie 32 samples, at equal
steps of the squared sine. Seen from the point, a face's edge is a plane, and a plane cuts a great
circle once: a convex face covers one interval of each row, whatever its size (as
`gpusim.optics.occlusion` has it for lamps). The circles pass the normal at `TILT`, and their
samples are shifted from row to row, so that neither upright nor level edges take many samples at a
time.

Of closed bodies only faces whose outside looks at the point hide anything, so that no surface
hides itself; a face in the point's plane that looks against it lies on it and hides all. Twin of
``shaders/optics/hemisphere.wgsl``.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from gpusim.gpu import Device, compare, twin_check
from gpusim.gpu.texels import Texels

__all__ = [
    "COLUMNS",
    "GROUP",
    "ROWS",
    "Around",
    "Receivers",
    "Seen",
    "directions",
    "seen",
    "seen_twin",
    "tangent",
]

Array = npt.NDArray[np.float64]
ROWS, COLUMNS = 64, 32
TILT, TURN = 0.1, 0.1
"""Directions of a row are n - TILT e + t (d + TURN e), t from 0 up; d, e level, e left of d."""

ABOVE = 1.0
"""Tolerances that a face's highest corner must rise over the horizon by."""

AGAINST = -0.5
"""Cosine between the normals of face and point below which they may lie against each other."""

TOUCHES = 1 << 16
"""What a face that the point lies on counts, among the ways out of a body."""

PARTS = 8
"""Invocations per point."""

GROUP = 16
"""Points that share a list of faces."""

POINTS = 1 << 15
FACES = 1 << 12
"""Points and faces of one dispatch."""

PAIRS = 1 << 12
"""Pairs of points and faces at a time in NumPy."""


@dataclass(frozen=True, eq=False)
class Receivers:
    """Points to look from.

    ``at`` (N, 3) and the unit ``normal`` (N, 3); ``tolerance`` (N,): distance from a face's plane
    within which it hides nothing; ``thickness`` (N,): that a way up leaves a body nearer than this
    doesn't tell that the point lies inside.
    """

    at: Array
    normal: Array
    tolerance: Array
    thickness: Array

    def part(self, rows: slice | npt.NDArray[np.int64]) -> Receivers:
        """Some of them."""
        return Receivers(
            self.at[rows], self.normal[rows], self.tolerance[rows], self.thickness[rows]
        )


@dataclass(frozen=True, eq=False)
class Seen:
    """``hidden`` (N, 64) words: bit c of row r is set where something hides that sample.

    ``inside`` (N,): points that lie in a closed body, or on a face that goes another way.
    """

    hidden: npt.NDArray[np.uint32]
    inside: npt.NDArray[np.bool_]

    @property
    def open_share(self) -> Array:
        """(N,) of the light of even surroundings."""
        hidden = np.bitwise_count(self.hidden).sum(axis=1)
        result: Array = 1.0 - hidden / (ROWS * COLUMNS)
        return result


def _rows() -> tuple[Array, Array, Array]:
    """Cosine and sine of each row's azimuth, and where its samples begin, (64,) each."""
    number = np.arange(ROWS)
    azimuth = 2.0 * np.pi * number / ROWS
    bits = (number[:, None] >> np.arange(6)) & 1
    start = (bits * 0.5 ** np.arange(1, 7)).sum(axis=1) + 0.5 / ROWS
    return np.cos(azimuth), np.sin(azimuth), start


def directions() -> Array:
    """(64, 32, 3) unit vectors (along the tangent, across, along the normal) of the samples."""
    cosine, sine, start = _rows()
    square = (np.arange(COLUMNS) + start[:, None]) / COLUMNS
    # 1 - 1 / |n - TILT e + t (d + TURN e)|^2 is the squared sine
    a, b, c = 1.0 + TURN**2, -TILT * TURN, 1.0 + TILT**2 - 1.0 / (1.0 - square)
    t = (-b + np.sqrt(np.maximum(b * b - a * c, 0.0))) / a
    t = np.where(c < 0.0, t, 0.0)
    along, across = t, TURN * t - TILT
    x = along * cosine[:, None] - across * sine[:, None]
    y = along * sine[:, None] + across * cosine[:, None]
    result = np.stack([x, y, np.ones_like(x)], axis=2)
    return np.asarray(result / np.linalg.norm(result, axis=2)[:, :, None])


def tangent(normal: Array) -> Array:
    """(N, 3) unit vectors square to unit normals, steady but where these point along -z."""
    x, y, z = normal.T
    below = z < -0.9999
    s = 1.0 / (1.0 + np.where(below, 0.0, z))
    result = np.stack([1.0 - x * x * s, -x * y * s, -x], axis=1)
    result[below] = np.stack([np.ones_like(x), 0.0 * x, -x / np.where(below, z, -1.0)], axis=1)[
        below
    ]
    length: Array = np.linalg.norm(result, axis=1)[:, None]
    return result / length


@dataclass(frozen=True, eq=False)
class Around:
    """Faces, and which of them each `GROUP` points in order may see.

    ``corners`` (F, 4, 3), counter-clockwise from outside; ``both_sides`` (F,): of surfaces that
    aren't closed; ``start`` (G + 1,): where the lists in ``face`` begin.
    """

    corners: Array
    both_sides: npt.NDArray[np.bool_]
    start: npt.NDArray[np.int64]
    face: npt.NDArray[np.int64]

    @staticmethod
    def everywhere(corners: Array, both_sides: npt.NDArray[np.bool_], points: int) -> Around:
        """All faces for all points."""
        groups = -(-points // GROUP)
        start = len(corners) * np.arange(groups + 1)
        return Around(corners, both_sides, start, np.tile(np.arange(len(corners)), groups))


def seen(device: Device, points: Receivers, around: Around) -> Seen:
    """What ``points`` see past the faces ``around``."""
    corners = around.corners
    texels = np.zeros((max(len(corners), 1), 4, 4), np.float32)
    texels[: len(corners), :, :3] = corners
    texels[: len(corners), 0, 3] = around.both_sides
    faces = Texels(device, texels.size // 4, "rgba32float", "hemisphere.around")
    faces.write(texels.reshape(-1, 4))
    kernel = device.kernel("optics/hemisphere")
    cosine, sine, start = (v.reshape(-1, 4) for v in _rows())
    rows = {"cosine": cosine, "sine": sine, "start": start, "tilt": TILT, "turn": TURN}
    hidden, inside = [np.zeros((0, ROWS), np.uint32)], [np.zeros(0, bool)]
    for begin in range(0, len(points.at), POINTS):
        own = points.part(slice(begin, begin + POINTS))
        count = len(own.at)
        table = np.zeros((count, 3, 4), np.float32)
        table[:, 0, :3], table[:, 0, 3] = own.at, own.tolerance
        table[:, 1, :3], table[:, 1, 3] = own.normal, own.thickness
        table[:, 2, :3] = tangent(own.normal)
        group = slice(begin // GROUP, begin // GROUP + -(-count // GROUP) + 1)
        first, last = around.start[group][[0, -1]]
        heads = around.start[group] - first
        lists = np.concatenate([heads + len(heads), around.face[first:last]]).astype(np.uint32)
        buffers = {
            "points": device.buffer(table, "hemisphere.points"),
            "lists": device.buffer(lists, "hemisphere.lists"),
            "masks": device.buffer(np.zeros((count, ROWS), np.uint32), "hemisphere.masks"),
            "leaves": device.buffer(np.zeros(count, np.int32), "hemisphere.leaves"),
        }
        with device.recording("optics.hemisphere") as recording:
            for done in range(0, int(np.diff(heads).max(initial=0)), FACES):
                params = {
                    "count": count, "first": done, "faces": FACES, "group": GROUP, "above": ABOVE,
                    "rows": rows,
                }  # fmt: skip
                bindings = kernel.bind(params=params, around=faces, **buffers)
                recording.dispatch(kernel, bindings, threads=(count * PARTS,))
        hidden.append(buffers["masks"].read(np.uint32, (count, ROWS)))
        inside.append(buffers["leaves"].read(np.int32, (count,)) > 0)
        for used in buffers.values():
            used.release()
    faces.release()
    return Seen(np.concatenate(hidden), np.concatenate(inside))


def seen_twin(points: Receivers, around: Around) -> Seen:
    """`seen` in float64."""
    count = len(points.at)
    hidden, leaves = np.zeros((count, ROWS), np.uint32), np.zeros(count, np.int64)
    for number, (start, stop) in enumerate(itertools.pairwise(around.start)):
        part = slice(number * GROUP, (number + 1) * GROUP)
        own = points.part(part)
        for first in range(start, stop, PAIRS // GROUP):
            face = around.face[first : min(first + PAIRS // GROUP, stop)]
            bits, crossed = _hidden(own, around.corners[face], around.both_sides[face])
            hidden[part] |= bits
            leaves[part] += crossed
    return Seen(hidden, leaves > 0)


def _hidden(
    points: Receivers, corners: Array, both_sides: npt.NDArray[np.bool_]
) -> tuple[npt.NDArray[np.uint32], npt.NDArray[np.int64]]:
    """Masks (N, 64) of what a few faces hide, and how often the way up leaves a body (N,)."""
    normal_of = points.normal[:, None]
    D = corners[None] - points.at[:, None, None]
    planes = np.cross(D, np.roll(D, -1, axis=2))
    normal = planes.sum(axis=2)
    size = np.linalg.norm(normal, axis=2)
    height = np.sum(normal * D.mean(axis=2), axis=2)
    closed, near = ~both_sides[None], points.tolerance[:, None] * size
    level = np.abs(height) <= near
    facing = np.sum(normal * normal_of, axis=2)
    against = closed & level & (facing < AGAINST * size)
    faces_it = np.where(closed, -height, np.abs(height)) > near
    axes = np.stack([tangent(points.normal), np.zeros_like(points.normal), points.normal], axis=1)
    axes[:, 1] = np.cross(axes[:, 2], axes[:, 0])
    local = np.einsum("nfka,nba->nfkb", planes, axes)
    highest = np.einsum("nfka,na->nfk", D, points.normal).max(axis=2)
    pierced = (local[..., 2] >= 0.0).all(axis=2) | (local[..., 2] <= 0.0).all(axis=2)
    rise = height / np.where(facing != 0.0, facing, 1.0)
    # a wall close above may be the point's own, but one that it would enter by isn't
    pierced &= closed & ~level & (rise > np.where(height > 0.0, points.thickness[:, None], 0.0))
    crossed = np.where(pierced, np.where(height > 0.0, 1, -1), 0).sum(axis=1)
    edges = np.linalg.norm(np.roll(D, -1, axis=2) - D, axis=3)
    on = np.einsum("nfka,nfa->nfk", planes, normal) >= -2.0 * near[:, :, None] * edges
    touches = level & (facing < 0.5 * size) & on.all(axis=2)
    crossed += TOUCHES * touches.sum(axis=1)
    point, face = np.nonzero(against | (faces_it & (highest > ABOVE * points.tolerance[:, None])))
    side = np.where((height > 0.0) & ~against, 1.0, -1.0)[point, face]
    bits = _bits(side[:, None, None] * local[point, face])
    result = np.zeros((len(points.at), ROWS), np.uint32)
    np.bitwise_or.at(result, point, bits)
    return result, crossed


def _bits(planes: Array) -> npt.NDArray[np.uint32]:
    """(P, 64) words: the samples inside four planes (P, 4, 3) through the point."""
    cosine, sine, start = _rows()
    low, high = np.zeros((len(planes), ROWS)), np.full((len(planes), ROWS), np.inf)
    for edge in range(4):
        x, y, up = planes[:, edge].T[:, :, None]
        across = y * cosine - x * sine
        value = up - TILT * across
        slope = x * cosine + y * sine + TURN * across
        # an edge along a row has all of it on one side
        cut = -value * np.where(slope != 0.0, 1.0 / np.where(slope != 0.0, slope, 1.0), 1e30)
        low = np.where(slope >= 0.0, np.maximum(low, cut), low)
        high = np.where(slope < 0.0, np.minimum(high, cut), high)
    begin, end = _sample(low, start), _sample(high, start)
    one = np.uint64(1)
    bits = ((one << end) - one) & ~((one << begin) - one)
    return np.where(low < high, bits, 0).astype(np.uint32)


def _sample(t: Array, start: Array) -> npt.NDArray[np.uint64]:
    """The first sample (…, 64) of rows at or beyond the direction of parameter t."""
    t = np.minimum(t, 1e9)
    square = 1.0 + TILT**2 + t * (t * (1.0 + TURN**2) - 2.0 * TURN * TILT)
    place = np.where(t <= 0.0, 0.0, COLUMNS * (1.0 - 1.0 / square) - start)
    return np.asarray(np.ceil(np.clip(place, 0.0, COLUMNS)).astype(np.uint64))


@twin_check("optics/hemisphere")
def _check(device: Device) -> None:
    from gpusim.optics.shadow_probe import block

    box = block((0.1, 0.3, 0.25), (0.35, 0.2, 0.25), 0.5)
    plate = np.array([[-0.9, -0.4, 0.5], [-0.2, -0.5, 0.6], [-0.3, 0.2, 0.5], [-0.9, 0.1, 0.45]])
    corners = np.concatenate([box.points[box.faces], plate[None]])
    both = np.arange(len(corners)) == len(corners) - 1
    random = np.random.default_rng(3)
    at = np.c_[random.uniform(-1.0, 1.0, (301, 2)), np.zeros(301)]
    normal = np.c_[random.uniform(-0.4, 0.4, (301, 2)), np.ones(301)]
    normal[:150] = [0.0, 0.0, 1.0]
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    points = Receivers(at, normal, np.full(301, 2e-6), np.full(301, 1e-3))
    around = Around.everywhere(corners, both, len(at))
    got, want = seen(device, points, around), seen_twin(points, around)
    # a few of 2048 samples may fall to the other side of an edge
    compare(
        "optics/hemisphere", got.open_share, want.open_share, "single",
        atol=3.5 / (ROWS * COLUMNS),
    )  # fmt: skip
    compare("optics/hemisphere", got.inside, want.inside, "exact")
