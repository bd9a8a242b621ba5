"""Shares of lamps by rays in float64, and scenes to ask them of: what shadows are judged by."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

import gpusim as gs
from gpusim.gpu import Device
from gpusim.optics.light.lights import Light
from gpusim.optics.light.quadrature import Lamp, lamps_of
from gpusim.optics.shadow.lamp_visibility import VisibleShares
from gpusim.optics.shadow.light_space import light_spaces
from gpusim.optics.shadow.occluders import Occluders, relative_points
from gpusim.optics.shadow.receivers import Receivers
from tests.support.optics_rays import may_meet

Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]

GRAIN = 20
"""Rays each way over the lamp and over the receiver."""

FAR = 1e3
"""Length of ways to a far lamp."""


def triangles_of(surfaces: Sequence[gs.Surface]) -> tuple[Array, Flags]:
    """Corners (T, 3, 3) of all triangles, and which are of open surfaces."""
    corners = [surface.points[surface.topology.triangles] for surface in surfaces]
    is_open = [
        np.full(len(c), not s.topology.closed) for c, s in zip(corners, surfaces, strict=True)
    ]
    return np.concatenate(corners), np.concatenate(is_open)


def blocked(
    start: Array, stop: Array, looks: Array, corners: Array, is_open: Flags, slack: float
) -> Flags:
    """(n,): whether ways from ``start`` to ``stop`` (n, 3) enter a body from outside, or pass
    through an open surface, farther than ``slack`` from its plane. What lies against a body, as the
    direction ``looks`` (3,) tells, is hidden by it."""
    ends = np.concatenate([start, stop])
    close = (corners.min(axis=1) <= ends.max(axis=0) + slack).all(axis=1)
    close &= (corners.max(axis=1) >= ends.min(axis=0) - slack).all(axis=1)
    corners, is_open = corners[close], is_open[close]
    a, b, c = (corners[:, k] for k in range(3))
    normal = np.cross(b - a, c - a)
    size = np.linalg.norm(normal, axis=1)
    kept = np.flatnonzero(size > 0.0)
    normal = normal[kept] / size[kept, None]
    corner, both = corners[kept], is_open[kept]
    offset = np.sum(normal * corner[:, 0], axis=1)
    first, last = start @ normal.T - offset, stop @ normal.T - offset
    against = ~both & (normal @ looks < -0.5) & (np.abs(first) <= slack)
    meets = (((first > slack) | against) & (last < 0.0)) | (both & (first < -slack) & (last > 0.0))
    ray, face = np.nonzero(meets)
    step = first[ray, face] - last[ray, face]
    share = np.clip(first[ray, face] / np.where(step != 0.0, step, 1.0), 0.0, 1.0)
    at = start[ray] + share[:, None] * (stop - start)[ray]
    inside = np.ones(len(ray), bool)
    for k in range(3):
        p, q = corner[:, k], corner[:, (k + 1) % 3]
        inwards = np.cross(normal, q - p)[face]
        inside &= np.sum((at - p[face]) * inwards, axis=1) >= 0.0
    result = np.zeros(len(start), bool)
    result[ray[inside]] = True
    return result


def ray_shares(
    lamp: Lamp, corners: Array, is_open: Flags, own: Receivers, slack: float, grain: int = GRAIN
) -> Array:
    """(n,): the share of a lamp, as far as it is above their planes, that receivers see, by
    stratified rays from all over each."""
    random = np.random.default_rng(7)
    cell = np.stack(np.meshgrid(*2 * [np.arange(grain)], indexing="ij"), axis=-1).reshape(-1, 2)
    result = np.zeros(len(own.at))
    reach = 0.5 * (np.linalg.norm(own.across, axis=1) + np.linalg.norm(own.down, axis=1))
    near = may_meet(lamp, own.at, reach + slack, corners)
    for row in range(len(own.at)):
        on_lamp = 2.0 * (cell + random.random(cell.shape)) / grain - 1.0
        if lamp.round:
            radius, turn = np.sqrt(0.5 * (on_lamp[:, :1] + 1.0)), np.pi * on_lamp[:, 1:]
            on_lamp = radius * np.column_stack([np.cos(turn), np.sin(turn)])
        on_piece = random.permutation((cell + random.random(cell.shape)) / grain - 0.5)
        start = own.at[row] + on_piece @ np.stack([own.across[row], own.down[row]])
        stop = lamp.centre + on_lamp @ np.stack([lamp.u, lamp.v])
        if lamp.far:
            stop = start + FAR * stop
        some = near[row]
        hidden = blocked(start, stop, own.normal[row], corners[some], is_open[some], slack)
        above = (stop - start) @ np.cross(own.across[row], own.down[row])
        above *= np.sign(np.cross(own.across[row], own.down[row]) @ own.normal[row])
        result[row] = 1.0 - hidden[above > 0.0].mean() if (above > 0.0).any() else 0.0
    return result


def on_plane(
    count: int, low: Sequence[float], high: Sequence[float], size: float = 0.01
) -> Receivers:
    """Receivers that look up from z = 0, at random places between two corners (2,)."""
    random = np.random.default_rng(3)
    at = np.column_stack([random.uniform(low, high, (count, 2)), np.zeros(count)])
    turn = random.uniform(0.0, 2.0 * np.pi, count)
    across = np.column_stack([np.cos(turn), np.sin(turn), 0.0 * turn])
    down = np.column_stack([-np.sin(turn), np.cos(turn), 0.0 * turn])
    normal = np.broadcast_to([0.0, 0.0, 1.0], at.shape)
    return Receivers(at, normal, size * across, size * down, np.full(count, -1))


def found(
    device: Device,
    surfaces: Sequence[gs.Surface],
    lights: Sequence[Light],
    own: Receivers,
    eye: Sequence[float] = (0.0, 0.0, 0.0),
) -> Array:
    """(n, L): what the device finds for receivers in the world."""
    origin = np.asarray(eye, np.float64)
    points = relative_points(surfaces, origin)
    spaces = light_spaces(lamps_of(lights), points, origin)
    moved = Receivers(own.at - origin, own.normal, own.across, own.down, own.on)
    return (
        VisibleShares(device, Occluders.of(surfaces), moved).find(points, spaces).astype(np.float64)
    )


def by_rays(
    surfaces: Sequence[gs.Surface], lights: Sequence[Light], own: Receivers, slack: float = 1e-6
) -> Array:
    """(n, L): the same by rays; 0 where a receiver is turned away from a lamp."""
    corners, is_open = triangles_of(surfaces)
    columns = []
    for lamp in lamps_of(lights):
        share = ray_shares(lamp, corners, is_open, own, slack)
        to = lamp.centre - (0.0 if lamp.far else 1.0) * own.at
        reach = np.abs(own.normal @ lamp.u) + np.abs(own.normal @ lamp.v)
        asks = np.sum(own.normal * to, axis=1) + reach > 0.0
        if not lamp.far and np.any(lamp.axis):
            asks &= np.sum(lamp.axis * to, axis=1) < 0.0
        columns.append(np.where(asks, share, 0.0))
    return np.stack(columns, axis=1)


def box(
    centre: Sequence[float], half: Sequence[float], cut: int = 1, open_top: bool = False
) -> gs.Surface:
    """A box, each side in ``cut`` x ``cut`` quads; closed, or without its top."""
    line = np.linspace(-1.0, 1.0, cut + 1)
    a, b = (v.reshape(-1) for v in np.meshgrid(line, line, indexing="ij"))
    number = np.arange((cut + 1) ** 2).reshape(cut + 1, cut + 1)
    quad = np.stack([number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]], -1)
    points, quads = [], []
    for axis in range(3):
        for sign in (-1.0, 1.0):
            if open_top and axis == 2 and sign > 0.0:
                continue
            side = np.full((len(a), 3), sign)
            side[:, (axis + 1) % 3], side[:, (axis + 2) % 3] = a, b
            way = quad.reshape(-1, 4)[:, :: 1 if sign > 0.0 else -1]
            quads.append(way + sum(len(p) for p in points))
            points.append(side)
    corners, same = np.unique(np.round(np.concatenate(points), 9), axis=0, return_inverse=True)
    faces = same.reshape(-1)[np.concatenate(quads)].astype(np.int32)
    return gs.Surface(np.array(centre) + corners * half, faces, gs.paint.Plain(0.5))


def sheet(
    low: Sequence[float], high: Sequence[float], height: float, cut: int = 1, wave: float = 0.0
) -> gs.Surface:
    """An open sheet over a rectangle between two corners (2,), in ``cut`` x ``cut`` quads."""
    x, y = np.meshgrid(
        np.linspace(low[0], high[0], cut + 1), np.linspace(low[1], high[1], cut + 1), indexing="ij"
    )
    z = height + wave * np.sin(9.0 * x) * np.cos(7.0 * y)
    number = np.arange(x.size).reshape(x.shape)
    quads = np.stack([number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]], -1)
    points = np.stack([x, y, z], axis=-1).reshape(-1, 3)
    return gs.Surface(points, quads.reshape(-1, 4).astype(np.int32), gs.paint.Plain(0.5))
