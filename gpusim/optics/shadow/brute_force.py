"""What is seen of lamps, receiver by receiver and occluder by occluder, without a tree.

With ``backend="numpy"`` every picture is lit by this; the stages on the device are compared with
it. It says what is true, not how it is found: a sample of a lamp is hidden by an occluder that the
way to it enters from outside (of closed bodies) or passes through (of open surfaces). Where an
occluder's plane passes through the pixel itself, `gpusim.optics.shadow.sample_mask` says what
counts.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from gpusim.arrays.array_types import Bool, Float, Long
from gpusim.optics.light.quadrature import Lamp
from gpusim.optics.shadow.light_space import TOLERANCE, LightSpace, lamp_numbers
from gpusim.optics.shadow.occluders import Occluders, planes_of, single_sheets
from gpusim.optics.shadow.receivers import Receivers
from gpusim.optics.shadow.sample_mask import COLUMNS, ROWS, STEP_A, STEP_B, lamp_masks, lattice

AGAINST = -0.5
"""Cosine between the normals of face and receiver below which they may lie against each other."""

BESIDE = 0.5
"""Cosine between the normals of face and receiver, up to their signs, above which the receiver may
be part of a sheet that goes on with the face. What stands on it or cuts it is steeper."""

BEYOND = 1e-5
"""Sine by which what lies beyond an edge may overlap it from rounding."""

PAIRS = 1 << 16
"""Of receivers and occluders at a time."""


def shares_twin(
    occluders: Occluders, points: Float, spaces: Sequence[LightSpace], receivers: Receivers
) -> Float:
    """(n, L): what receivers see of each lamp that ``spaces`` are of, 0 where they don't ask;
    ``points`` (V, 3) relative to the eye."""
    corners = points[occluders.triangles]
    planes = planes_of(corners)
    numbers = lamp_numbers(spaces)
    result = np.zeros((len(receivers.at), len(numbers)))
    for column, number in enumerate(numbers):
        own = [space for space in spaces if space.number == number]
        asks = np.any([v.asks(receivers.at, receivers.normal) for v in own], axis=0)
        step = max(PAIRS // occluders.count, 1)
        single = single_sheets(own[0], occluders, corners)
        asking = np.flatnonzero(asks)
        for start in range(0, len(asking), step):
            rows = asking[start : start + step]
            result[rows, column] = shares_of(
                own[0], occluders, corners, planes, receivers[rows], np.arange(occluders.count),
                single,
            )  # fmt: skip
    return result


def shares_of(
    space: LightSpace,
    occluders: Occluders,
    corners: Float,
    planes: Float,
    receivers: Receivers,
    faces: Long,
    single: Long,
) -> Float:
    """(n,): what ``receivers`` see of a lamp past some occluders, of which all have ``corners``,
    ``planes`` and ``single`` (`single_sheets`)."""
    lamp, masks = space.lamp, lamp_masks(space.lamp)
    row, face = (
        np.repeat(np.arange(len(receivers.at)), len(faces)),
        np.tile(faces, len(receivers.at)),
    )
    # what hides nothing of itself, on the side that the lamp lights
    upright = receivers.upright()
    own = space.planes(np.column_stack([upright, np.sum(upright * receivers.at, axis=1)]))
    lit = (receivers.on >= 0) & (own[:, 2] > space.extent(own))
    sheet = np.where(lit, single[receivers.on], 0)
    other = (sheet[row] == 0) | (single[face] != sheet[row])
    row, face = row[other], face[other]
    pairs = receivers[row]
    seen = edge_functions(
        space, pairs, corners[face], planes[face], occluders.open[face],
        visible_footprint(lamp, occluders, corners, planes, pairs, face),
    )  # fmt: skip
    some = np.flatnonzero(seen.may_hide)
    covered = np.zeros((len(receivers.at), ROWS), np.uint32)
    np.bitwise_or.at(covered, row[some], seen.hidden(lamp, some))
    above = masks & above_horizon(lamp, receivers)
    above = np.where(above.any(axis=1, keepdims=True), above, masks)
    return np.asarray(
        np.bitwise_count(above & ~covered).sum(axis=1) / np.bitwise_count(above).sum(axis=1)
    )


def above_horizon(lamp: Lamp, receivers: Receivers) -> npt.NDArray[np.uint32]:
    """(n, 16) words: the samples above the planes of ``receivers``, which alone light them."""
    over, near = receivers.upright(), 0.0 if lamp.far else 1.0
    none = np.zeros(len(over))
    height = _dot(over, lamp.centre - near * receivers.at)
    horizon = np.stack([height, over @ lamp.u, over @ lamp.v, none, none])[None]
    return EdgeFunctions(horizon, none > 0.0).hidden(lamp, np.arange(len(over)))


def visible_footprint(
    lamp: Lamp,
    occluders: Occluders,
    corners: Float,
    planes: Float,
    receivers: Receivers,
    face: Long,
) -> Float:
    """(P,): how much of their pixels ``receivers`` look from past occluders ``face`` (P,);
    ``corners`` (T, 3, 3) and ``planes`` (T, 4) of all.

    All of it (1), but for open occluders where a receiver is part of an open triangle. What the
    receiver's plane goes on to beyond that is no part of the sheet, and may lie behind these. An
    occluder before whose plane the triangle lies, as all of the lamp does, hides nothing of it
    (-1), nor does one that touches it on the other side of an edge, seen from all of the lamp. Past
    others that touch it a receiver looks from what lies within its triangle; that is too little
    where the pixel alone makes a penumbra, of lamps without size. Past one of its own surface whose
    plane passes through the pixel, as that of a sheet that is bent there, it looks from the middle.
    """
    on = np.maximum(receivers.on, 0)
    result = np.ones(len(face))
    rows = np.flatnonzero((receivers.on >= 0) & occluders.open[on] & occluders.open[face])
    near = 0.0 if lamp.far else 1.0
    bent = rows[occluders.sheet[on[rows]] == occluders.sheet[face[rows]]]
    normal, pixel = planes[face[bent], :3], receivers[bent]
    bent = bent[
        (np.abs(_dot(normal, pixel.normal)) > BESIDE)
        & _passes(planes[face[bent], 3] - _dot(normal, pixel.at), normal, pixel)
    ]
    normal, offset = planes[face[rows], :3], planes[face[rows], 3]
    height = normal @ lamp.centre - near * offset
    before = np.abs(height) > np.abs(normal @ lamp.u) + np.abs(normal @ lamp.v)
    triangle = corners[on[rows]]
    above = np.sign(height)[:, None] * (np.einsum("pka,pa->pk", triangle, normal) - offset[:, None])
    before &= above.min(axis=1) >= -TOLERANCE * np.linalg.norm(triangle[:, 0], axis=1)
    result[rows[before]] = -1.0
    own, other = occluders.triangles[on[rows]], occluders.triangles[face[rows]]
    rows = rows[~before & (own[:, :, None] == other[:, None]).any(axis=(1, 2))]
    triangle, places = corners[on[rows]], corners[face[rows]]

    def over_lamp(normal: Float, to: Float) -> tuple[Float, Float]:
        return _dot(normal, to), np.abs(normal @ lamp.u) + np.abs(normal @ lamp.v)

    normal = np.cross(triangle[:, 1] - triangle[:, 0], triangle[:, 2] - triangle[:, 0])
    height, extent = over_lamp(normal, lamp.centre - near * triangle[:, 0])
    facing = np.where(np.abs(height) > extent, np.sign(height), 0.0)
    apart, within = np.zeros(len(rows), bool), np.ones(len(rows))
    for k in range(3):
        a, b = triangle[:, k], triangle[:, (k + 1) % 3]
        to = lamp.centre - near * a
        size = BEYOND * np.linalg.norm(b - a, axis=1) * np.linalg.norm(to, axis=1)
        beyond = facing != 0.0
        for j in range(3):
            way = places[:, j] - a
            value, extent = over_lamp(facing[:, None] * np.cross(b - a, way), to)
            beyond &= value + extent <= size * np.linalg.norm(way, axis=1)
        apart |= beyond
        inwards = np.cross(normal, b - a)
        reach = np.abs(_dot(receivers.across[rows], inwards))
        reach = 0.5 * (reach + np.abs(_dot(receivers.down[rows], inwards)))
        inside = _dot(receivers.at[rows] - a, inwards)
        within = np.minimum(within, np.clip(inside / np.maximum(reach, 1e-30), 0.0, 1.0))
    result[rows] = np.where(apart, -1.0, within if lamp.extended else 1.0)
    result[bent] = np.minimum(result[bent], 0.0)
    return result


def _passes(height: Float, normal: Float, receivers: Receivers) -> Bool:
    """Whether planes with ``normal`` (P, 3) at a ``height`` (P,) over the middle of a pixel pass
    through it, or close by."""
    wide = np.abs(_dot(normal, receivers.across)) + np.abs(_dot(normal, receivers.down))
    return np.asarray(np.abs(height) < wide)


@dataclass(frozen=True, eq=False)
class EdgeFunctions:
    """Pairs of receivers and occluders: ``edges`` (E, 5, P): the functions of the lamp that have to
    be positive, their value in its middle and what they change by per a, b, and pixel in x and y;
    ``may_hide`` (P,): whether some samples may be behind the occluder."""

    edges: Float
    may_hide: Bool

    def hidden(self, lamp: Lamp, some: Long) -> npt.NDArray[np.uint32]:
        """(n, 16) words: the samples that occluders hide, of pairs ``some`` (n,)."""
        rows = lattice().T
        result = np.full((len(some), ROWS), 0xFFFFFFFF, np.uint32)
        for value, a, b, gx, gy in self.edges[:, :, some]:
            if not lamp.extended:
                # the whole lattice is for the pixel
                a, b, gx, gy = 0.5 * gx, 0.5 * gy, np.zeros_like(gx), np.zeros_like(gy)
            sign = rows[3] if lamp.extended else np.ones(ROWS)
            along = sign * a[:, None] + 0.5 * gy[:, None]
            first = value[:, None] + rows[0] * along + rows[1] * b[:, None] + rows[2] * gx[:, None]
            slope = STEP_A * along + STEP_B * b[:, None]
            cut = np.where(slope != 0.0, -first / np.where(slope != 0.0, slope, 1.0), 0.0)
            # before the cut all are outside of an edge that rises
            count = np.ceil(np.clip(cut, 0.0, COLUMNS)).astype(np.uint64)
            before = ((np.uint64(1) << count) - np.uint64(1)).astype(np.uint32)
            inside = np.where(slope > 0.0, ~before, before)
            level = np.where(first >= 0.0, np.uint32(0xFFFFFFFF), np.uint32(0))
            result &= np.where(slope == 0.0, level, inside)
        return result


def edge_functions(
    space: LightSpace,
    receivers: Receivers,
    corners: Float,
    planes: Float,
    is_open: Bool,
    looks_from: Float,
) -> EdgeFunctions:
    """How ``receivers`` see occluders, pair by pair: ``corners`` (P, 3, 3), their ``planes``
    (P, 4), and how much of the pixel each ``looks_from`` (P,) past them, by `visible_footprint`."""
    lamp = space.lamp
    near = 0.0 if lamp.far else 1.0
    at, across, down, looks = receivers.at, receivers.across, receivers.down, receivers.normal
    to = lamp.centre - near * at
    tolerance = TOLERANCE * np.linalg.norm(at, axis=1)
    normal = planes[:, :3]
    height = planes[:, 3] - _dot(normal, at)
    turned = _dot(normal, looks)
    against = ~is_open & (np.abs(height) <= tolerance) & (turned < AGAINST)
    passes = _passes(height, normal, receivers)
    change_x, change_y = looks_from * _dot(normal, across), looks_from * _dot(normal, down)
    over_plane = _dot(normal, to) - near * height
    extent = np.abs(normal @ lamp.u) + np.abs(normal @ lamp.v)
    over = np.cross(across, down)
    over *= np.where(_dot(over, looks) > 0.0, 1.0, -1.0)[:, None]
    slack = tolerance * np.linalg.norm(over, axis=1)
    whole = _dot(over, to) > np.abs(over @ lamp.u) + np.abs(over @ lamp.v)
    D = corners - at[:, None]
    above = np.einsum("pka,pa->pk", D, over)
    # of a pixel that the plane of what is above it parts, what is on the other side than the lamp
    parted = passes & (above.min(axis=1) > slack) & (looks_from > 0.0)
    parted &= np.abs(over_plane) > extent + near * space.on_face
    side = np.where((height > 0.0) & ~against, 1.0, -1.0)
    side = np.where(parted, np.sign(over_plane), side)
    apart = side * over_plane
    most_beyond = side * height + 0.5 * parted * (np.abs(change_x) + np.abs(change_y))
    counts = ((most_beyond > tolerance) & (is_open | (side < 0.0))) | against
    counts &= apart + extent > near * space.on_face
    towards = (np.einsum("pka,pa->pk", D, to) > 0.0).any(axis=1)
    counts &= against | parted | ~passes | towards
    counts &= against | ~whole | (above.max(axis=1) > slack)
    counts &= looks_from >= 0.0
    edges = np.zeros((4, 5, len(at)))
    most = np.full(len(at), np.inf)
    for k in range(3):
        begin, end = D[:, k], D[:, (k + 1) % 3]
        plane = side[:, None] * np.cross(begin, end)
        change = np.cross(to, side[:, None] * (end - begin)) - near * plane
        edges[k] = (
            _dot(plane, to), plane @ lamp.u, plane @ lamp.v,
            looks_from * _dot(change, across), looks_from * _dot(change, down),
        )  # fmt: skip
        extent = np.abs(edges[k, 1:3]).sum(axis=0) + 0.5 * np.abs(edges[k, 3:]).sum(axis=0)
        most = np.minimum(most, edges[k, 0] + extent)
    # only samples beyond the occluder's plane: it may go on behind the lamp
    edges[3, :3] = apart, side * (normal @ lamp.u), side * (normal @ lamp.v)
    beyond = side * np.stack([height, 0.0 * height, 0.0 * height, -change_x, -change_y])
    edges[3] = np.where(parted, beyond, edges[3])
    return EdgeFunctions(edges, counts & (most >= 0.0))


def _dot(a: Float, b: Float) -> Float:
    return np.asarray(np.einsum("pa,pa->p", a, b))
