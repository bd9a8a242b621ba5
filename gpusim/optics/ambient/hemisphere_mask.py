"""Which directions over a point the faces around it hide: bits along great circles.

A matte face receives from a direction by the cosine of its angle to the normal, so that equal
areas of the hemisphere's shadow on the face's plane count alike. 64 great circles run from near
the normal to the horizon, turned by equal angles; along each of them lie 32 samples, at equal
steps of the squared sine. The circles pass the normal at `TILT`, and their samples are shifted from
row to row, so that neither upright nor level edges take many samples at a time.

How many faces lie before a sample is how many do at the start of its row, plus or minus one for
each contour edge (`gpusim.optics.ambient.silhouette_bvh`) that the row crosses before it. An edge
is crossed where its ends lie on different sides of the row's circle, whatever edges they belong to:
what encloses an area is crossed as often inward as outward, and rounding can't open it.

Of closed bodies only faces whose outside looks at the point hide anything, so that no surface
hides itself; a face in the point's plane that looks against it lies on it and hides all. Twin of
``shaders/optics/ambient/hemisphere_mask.wgsl``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from gpusim.arrays.array_types import Bool, Float, Long
from gpusim.optics.ambient.silhouette_bvh import AGAINST, TILT, EdgeAdjacency, SamplePoints, tangent
from gpusim.optics.ambient.silhouette_search import (
    SilhouetteBuffers,
    contour_edges,
    faces_upward,
    hiding,
)

ROWS, COLUMNS = 64, 32
TURN = 0.1
"""Directions of a row are n - TILT e + t (d + TURN e), t from 0 up; d, e level, e left of d."""

FAR = 1e9
"""A parameter beyond the horizon."""

TOUCHES = 1 << 16
"""What a face that the point lies on counts, among the ways out of a body."""

PAIRS = 1 << 17
"""Pairs of points and edges at a time in NumPy."""


@dataclass(frozen=True, eq=False)
class HemisphereMasks:
    """``hidden`` (N, 64) words: bit c of row r is set where something hides that sample.

    ``inside`` (N,): points that lie in a closed body, or on a face that goes another way.
    """

    hidden: npt.NDArray[np.uint32]
    inside: Bool

    @property
    def open_share(self) -> Float:
        """(N,) of the light of even surroundings."""
        hidden = np.bitwise_count(self.hidden).sum(axis=1)
        result: Float = 1.0 - hidden / (ROWS * COLUMNS)
        return result


def _rows() -> tuple[Float, Float, Float]:
    """Cosine and sine of each row's azimuth, and where its samples begin, (64,) each."""
    number = np.arange(ROWS)
    azimuth = 2.0 * np.pi * number / ROWS
    bits = (number[:, None] >> np.arange(6)) & 1
    start = (bits * 0.5 ** np.arange(1, 7)).sum(axis=1) + 0.5 / ROWS
    return np.cos(azimuth), np.sin(azimuth), start


def directions() -> Float:
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


def hemisphere_masks(tables: SilhouetteBuffers, points: SamplePoints) -> HemisphereMasks:
    """What ``points`` see past the faces in ``tables``."""
    device = tables.device
    kernel = device.kernel("optics/ambient/hemisphere_mask")
    rows = np.zeros((ROWS, 4))
    rows[:, :3] = np.stack(_rows(), axis=1)
    hidden, inside = [np.zeros((0, ROWS), np.uint32)], [np.zeros(0, bool)]
    for near in tables.batches(points):
        count = near.count
        masks = device.buffer(np.zeros((count, ROWS), np.uint32), "hemisphere.masks")
        leaves = device.buffer(np.zeros(count, np.int32), "hemisphere.leaves")
        with device.recording("optics.hemisphere") as recording:
            params = {
                "count": count, "most_edges": near.most[0], "most_faces": near.most[1],
                "tilt": TILT, "turn": TURN, "rows": rows,
            }  # fmt: skip
            bindings = kernel.bind(
                params=params, points=near.points, edges=tables.edges, planes=tables.planes,
                borders=tables.borders, counts=near.counts, needed=near.edges, faces=near.faces,
                masks=masks, leaves=leaves,
            )  # fmt: skip
            recording.dispatch(kernel, bindings, threads=(count * ROWS,))
        hidden.append(masks.read(np.uint32, (count, ROWS)))
        inside.append(leaves.read(np.int32, (count,)) > 0)
        for used in (masks, leaves):
            used.release()
        near.release()
    return HemisphereMasks(np.concatenate(hidden), np.concatenate(inside))


def hemisphere_masks_twin(points: SamplePoints, facets: EdgeAdjacency) -> HemisphereMasks:
    """`hemisphere_masks` in float64, past all of ``facets``."""
    hidden = np.zeros((len(points.at), ROWS), np.uint32)
    leaves = np.zeros(len(points.at), np.int64)
    step = max(PAIRS // max(len(facets.ends), 1), 1)
    for first in range(0, len(points.at), step):
        part = slice(first, first + step)
        chunk = points.part(part)
        change = np.zeros((len(chunk.at), ROWS, COLUMNS + 1), np.int64)
        change[:, :, 0], leaves[part] = _along_normal(chunk, facets)
        _cross(change, chunk, facets)
        before = np.cumsum(change, axis=2)[:, :, :COLUMNS] > 0
        hidden[part] = (before << np.arange(COLUMNS, dtype=np.uint32)).sum(axis=2, dtype=np.uint32)
    return HemisphereMasks(hidden, leaves > 0)


def _axes(normal: Float) -> Float:
    """(N, 3, 3): tangent, the direction across it, and unit normal."""
    u = tangent(normal)
    return np.stack([u, np.cross(normal, u), normal], axis=1)


def _local(points: SamplePoints, ends: Float) -> Float:
    """(P, …, 3): places (P, …, 3) along each point's tangent, across, and along its normal."""
    lead = (slice(None), *[None] * (ends.ndim - 2))
    axes = _axes(points.normal)
    return np.asarray(np.einsum("p...a,pba->p...b", ends - points.at[lead], axes))


def _crossed(ends: Float) -> tuple[Bool, Bool, Float, Float]:
    """Whether half circles through the rows cross edges (P, 2, 3), and whether they leave the side
    that the edges have on their left; (P, 64). With the edges' planes at the rows' starts and
    along them."""
    cosine, sine, _ = _rows()
    x, y, z = ends[..., None, 0], ends[..., None, 1], ends[..., None, 2]
    side = cosine * (y - TURN * x) - sine * (x + TURN * y) + TILT * z
    rises = (side[:, 0] < 0.0) & (side[:, 1] >= 0.0)
    falls = (side[:, 0] >= 0.0) & (side[:, 1] < 0.0)
    x, y, up = np.cross(ends[:, 0], ends[:, 1]).T[:, :, None]
    across = y * cosine - x * sine
    value = up - TILT * across
    slope = x * cosine + y * sine + TURN * across
    leaves = value >= 0.0
    return np.where(leaves, rises, falls), leaves, value, slope


def _cross(change: Long, points: SamplePoints, facets: EdgeAdjacency) -> None:
    """Add to ``change`` (N, 64, 33) what crossing edges changes, sample by sample."""
    weight = contour_edges(points, facets)
    point, edge = np.nonzero(weight)
    crossed, leaves, value, slope = _crossed(_local(points.part(point), facets.ends[edge]))
    # what is beyond the horizon doesn't count
    pair, row = np.nonzero(crossed & np.where(leaves, slope < 0.0, slope > 0.0))
    t = -value[pair, row] / slope[pair, row]
    sample = _sample(t, _rows()[2][row])
    sign = np.where(leaves[pair, row], -1, 1) * weight[point, edge][pair]
    np.add.at(change, (point[pair], row, sample), sign)


def _along_normal(points: SamplePoints, facets: EdgeAdjacency) -> tuple[Long, Long]:
    """How many faces lie before the rows' starts (N, 64), and how often the way up leaves a body
    (N,)."""
    count = len(points.at)
    point, face = np.nonzero(faces_upward(points, facets))
    hides, points = hiding(points, facets)[point, face], points.part(point)
    plane, closed = facets.planes[face], ~facets.both_sides[face]
    height = plane[:, 3] - np.einsum("pa,pa->p", plane[:, :3], points.at)
    facing = np.einsum("pa,pa->p", plane[:, :3], points.normal)
    number = facets.edges[face]
    sign = np.where(number < 0, 0, 1 - 2 * (number % 2))
    ends = facets.ends[np.maximum(number, 0) // 2]
    length = np.linalg.norm(ends[:, :, 1] - ends[:, :, 0], axis=2)
    local = _local(points, ends)
    planes = sign[:, :, None] * np.cross(local[:, :, 0], local[:, :, 1])
    up, level = planes[..., 2], np.abs(height) <= points.tolerance
    pierced = (up >= 0.0).all(axis=1) | (up <= 0.0).all(axis=1)
    rise = height / np.where(facing != 0.0, facing, 1.0)
    # a wall close above may be the point's own, but one that it would enter by isn't
    pierced &= closed & ~level & (rise > np.where(height > 0.0, points.thickness, 0.0))
    ways = np.where(pierced, np.where(height > 0.0, 1, -1), 0)
    normal = np.einsum("pa,pba->pb", plane[:, :3], _axes(points.normal))
    inwards = np.einsum("pka,pa->pk", planes, normal)
    on = (inwards >= -2.0 * points.tolerance[:, None] * length).all(axis=1)
    # a sheet that looks the other way is the point's own, from its other side
    across = (facing < 0.5) & (closed | (facing > AGAINST))
    ways += TOUCHES * (level & across & on)
    leaves = np.zeros(count, np.int64)
    np.add.at(leaves, point, ways)
    start = np.zeros((count, ROWS), np.int64)
    some = np.flatnonzero(hides)
    crossed, leaving, _, _ = _crossed(local[some].reshape(-1, 2, 3))
    turn = (hides[some, None] * sign[some]).reshape(-1, 1) * np.where(leaving, -1, 1)
    gone = np.where(crossed, turn, 0).reshape(-1, 4, ROWS).sum(axis=1)
    np.add.at(start, point[some], (gone < 0).astype(np.int64))
    return start, leaves


def _sample(t: Float, start: Float) -> Long:
    """The first sample, of rows that begin at ``start``, at or beyond directions of parameter t."""
    t = np.minimum(t, FAR)
    square = 1.0 + TILT**2 + t * (t * (1.0 + TURN**2) - 2.0 * TURN * TILT)
    place = np.where(t <= 0.0, 0.0, COLUMNS * (1.0 - 1.0 / square) - start)
    return np.asarray(np.ceil(np.clip(place, 0.0, COLUMNS)).astype(np.int64))
