"""What the receivers of each entry have in common.

For all lamps a *cell*, which has all of what their samples look from: of a tile of pixels its place
in the picture and the depths, of a list a box; about a plane of it all of that lies within a
distance. In a lamp's light space a box of that, and a *ground*: a plane at or below which nothing
hides the lamp from any of them. That is the cell's plane, below all of it, where all of the lamp is
above the highest.
"""

from __future__ import annotations

import numpy as np

from gpusim.arrays.array_types import Float, Long
from gpusim.gpu import Bound, Recording
from gpusim.optics.shadow.light_space import ANGLE, TOLERANCE, UNLIMITED, LightSpace
from gpusim.optics.shadow.receivers import (
    APART,
    TILE,
    DeviceReceivers,
    PixelReceivers,
    Receivers,
)

NAME = "optics/shadow/receiver_groups"


def record_cells(recording: Recording, receivers: DeviceReceivers, bound: Bound) -> None:
    """Find the cells, and which receivers are of farther halves."""
    bound.run(recording, NAME, "find_cells", receivers.kind, threads=(receivers.groups,))


def record_groups(recording: Recording, receivers: DeviceReceivers, bound: Bound) -> None:
    """Find what cells are to a lamp."""
    bound.run(recording, NAME, "find_groups", receivers.kind, threads=(receivers.entries,))


def entries_of(receivers: Receivers | PixelReceivers) -> tuple[Long, Receivers, Long, int]:
    """Number (n,) and place of the receivers that are there, the entry (n,) of each, and the number
    of entries."""
    if isinstance(receivers, Receivers):
        starts = receivers.starts
        groups = len(starts) - 1
        there = np.flatnonzero(np.any(receivers.normal != 0.0, axis=1))
        every = receivers[there]
        group = np.searchsorted(starts, there, side="right") - 1
        depth = np.linalg.norm(every.at, axis=1)
        alike = np.zeros(groups, bool)
    else:
        camera = receivers.camera
        there, every = receivers.receivers()
        columns = -(-camera.width // TILE)
        groups = columns * -(-camera.height // TILE)
        number = np.arange(receivers.ids.size)
        tile = number // camera.width // TILE * columns + number % camera.width // TILE
        group = tile[there]
        depth = every.at @ camera.camera_from_world[2, :3]
        # a tile within one triangle is one
        least, most = np.full(groups, 1 << 60), np.full(groups, -1)
        np.minimum.at(least, tile, receivers.ids.reshape(-1))
        np.maximum.at(most, tile, receivers.ids.reshape(-1))
        alike = (least == most) & (np.bincount(tile, minlength=groups) == TILE * TILE)
        alike &= camera.lens is None
    near, far = np.full(groups, np.inf), np.zeros(groups)
    np.minimum.at(near, group, depth)
    np.maximum.at(far, group, depth)
    split = np.where((far > APART * near) & ~alike, 0.5 * (near + far), np.inf)
    return there, every, group + groups * (depth > split[group]), 2 * groups


def asking(
    receivers: Receivers | PixelReceivers, space: LightSpace
) -> tuple[Long, Receivers, Long]:
    """Number (n,), place and entry (n,) of the receivers that ask a lamp."""
    there, every, entry, _ = entries_of(receivers)
    asks = np.flatnonzero(space.asks(every.at, every.normal))
    return there[asks], every[asks], entry[asks]


def cells_twin(receivers: Receivers | PixelReceivers, sheets: Long) -> Float:
    """(E, 13): cells as the shader has them; ``sheets`` (T,) of occluders."""
    there, every, entry, count = entries_of(receivers)
    at, reach = every.at, 0.5 * (np.abs(every.across) + np.abs(every.down))
    first = np.full(count, len(entry), np.int64)
    np.minimum.at(first, entry, np.arange(len(entry)))
    if isinstance(receivers, PixelReceivers):
        at, reach = _in_picture(receivers, every)
        # the plane of the pixel in a tile's middle, where there is one
        row, column = np.divmod(there, receivers.camera.width)
        middle = np.flatnonzero((row % TILE == TILE // 2) & (column % TILE == TILE // 2))
        first[entry[middle]] = middle
    some = np.flatnonzero(first < len(entry))
    plane = np.zeros((count, 4))
    plane[some, :3] = every.upright()[first[some]]
    plane[some, 3] = np.sum(plane[some, :3] * every.at[first[some]], axis=1)
    own = plane[entry, :3]
    height = np.sum(own * every.at, axis=1) - plane[entry, 3]
    wide = 0.5 * np.abs(np.sum(own * every.across, axis=1))
    wide += 0.5 * np.abs(np.sum(own * every.down, axis=1))
    low, high = np.full((count, 3), UNLIMITED), np.full((count, 3), -UNLIMITED)
    np.minimum.at(low, entry, at - reach)
    np.maximum.at(high, entry, at + reach)
    lowest, highest, lean = np.full(count, UNLIMITED), np.full(count, -UNLIMITED), np.zeros(count)
    np.minimum.at(lowest, entry, height - wide)
    np.maximum.at(highest, entry, height + wide)
    np.maximum.at(lean, entry, np.linalg.norm(own - every.normal, axis=1))
    plane[:, 3] += lowest
    own = np.where(every.on >= 0, sheets[every.on], 0)
    least, most = np.full(count, 1 << 60), np.zeros(count, np.int64)
    np.minimum.at(least, entry, own)
    np.maximum.at(most, entry, own)
    sheet = np.where(least == most, most, 0)
    return np.column_stack([low, lean, high, highest - lowest, plane, sheet])


def _in_picture(receivers: PixelReceivers, every: Receivers) -> tuple[Float, Float]:
    """Places (n, 3), in the picture and in depth, and how far samples go on about these."""
    camera = receivers.camera
    back = np.linalg.inv(camera.camera_from_world[:3, :3].T @ camera.ray_matrix()).T
    x, across, down = (v @ back for v in (every.at, every.across, every.down))
    depth = x[:, 2:]
    at = x[:, :2] / depth
    sides = [(v[:, :2] - at * v[:, 2:]) / depth for v in (across, down)]
    rise = 0.5 * (np.abs(across[:, 2:]) + np.abs(down[:, 2:]))
    reach = 0.5 * (np.abs(sides[0]) + np.abs(sides[1])) / (1.0 - np.minimum(rise / depth, 0.9))
    return np.column_stack([at, depth]), np.column_stack([reach, rise])


def groups_twin(
    receivers: Receivers | PixelReceivers, space: LightSpace, sheets: Long, single: Long
) -> Float:
    """(E, 12): box, sheet, tolerance and ground of every entry, as the shader has them; ``single``
    (T,): `single_sheets`."""
    cells = cells_twin(receivers, sheets)
    low, high, plane, thick = cells[:, :3], cells[:, 4:7], cells[:, 8:12], cells[:, 7]
    rays = None
    if isinstance(receivers, PixelReceivers):
        camera = receivers.camera
        rays = camera.camera_from_world[:3, :3].T @ camera.ray_matrix()
    ends = [np.where([k & 1, k & 2, k & 4], high, low) for k in range(8)]
    used = cells[:, 2] <= cells[:, 6]
    ends = [np.where(used[:, None], end, 1.0) for end in ends]
    x = np.stack(ends)
    if rays is not None:
        x = x[..., 2:] * (x[..., :2] @ rays[:, :2].T + rays[:, 2])
    least, most = _ends(space, x)
    ahead = np.stack([space.ahead(v) for v in x])
    if rays is not None:
        ray = np.stack([end[:, :2] @ rays[:, :2].T + rays[:, 2] for end in ends])
        rate = np.einsum("kea,ea->ke", ray, plane[:, :3])
        offset = plane[:, 3] + np.where(np.arange(8) >= 4, 1.0, 0.0)[:, None] * thick
        way = np.where(rate * offset > 0.0, offset / np.where(rate != 0.0, rate, 1.0), 1.0)
        sure = (rate * offset > 0.0).all(axis=0)
        if not space.lamp.far:
            before = np.stack([space.ahead(v) for v in way[..., None] * ray])
            sure &= (before > space.begin).all(axis=0)
        narrow, wide = _ends(space, way[..., None] * ray)
        least = np.where(sure[:, None], np.maximum(least, narrow), least)
        most = np.where(sure[:, None], np.minimum(most, wide), most)
    if not space.lamp.far:
        through = np.flatnonzero(ahead.min(axis=0) < space.begin)
        least[through], most[through] = _unlimited(space, x[:, through])
    lamp = space.planes(plane)
    extent, reach = space.extent(lamp), np.ones(len(cells))
    if not space.lamp.far:
        y = np.abs((x - space.centre) @ np.stack([space.across, space.along, space.axis], axis=1))
        reach = np.linalg.norm(y.max(axis=0), axis=1)
        used &= ahead.max(axis=0) > 0.0
    lean = (cells[:, 3] + space.terminator) * (reach + sum(space.half))
    used &= lamp[:, 2] + extent + lean > 0.0
    least = np.where(used[:, None], least, UNLIMITED)
    most = np.where(used[:, None], most, -UNLIMITED)
    slack = np.full(len(cells), ANGLE) if space.lamp.far else space.rounding + thick
    ground = np.where((lamp[:, 2] - extent > slack)[:, None], plane, 0.0)
    box = np.stack([least, most], axis=2).reshape(-1, 6)
    sheet = np.where(np.isin(cells[:, 12], single), cells[:, 12], 0.0)
    sheet *= lamp[:, 2] - extent - lean > 0.0
    tolerance = TOLERANCE * np.linalg.norm(x, axis=2).max(axis=0)
    return np.column_stack([box, sheet, tolerance, ground])


def _ends(space: LightSpace, x: Float) -> tuple[Float, Float]:
    """Low and high ends (E, 3) of boxes around places (8, E, 3)."""
    place = np.stack([space.place(v) for v in x])
    slack = np.stack([space.rounding_at(v) for v in place])
    return (place - slack).min(axis=0), (place + slack).max(axis=0)


def _unlimited(space: LightSpace, x: Float) -> tuple[Float, Float]:
    """Ends of what of cells with corners (8, E, 3) is before the lamp's plane, which passes
    through these."""
    y = x - space.centre
    beside = np.stack([y @ space.across, y @ space.along], axis=-1)
    low, high = beside.min(axis=0) - space.rounding, beside.max(axis=0) + space.rounding
    most = np.maximum((y @ space.axis).max(axis=0) + space.rounding, 1e-300)[:, None]
    low, high = (
        np.where(low < 0.0, -UNLIMITED, low / most),
        np.where(high > 0.0, UNLIMITED, high / most),
    )
    return np.column_stack([low, 1.0 / most]), np.column_stack([high, 0.0 * most + UNLIMITED])
