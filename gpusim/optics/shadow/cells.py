"""What the receivers of each entry have in common, for all lamps.

A *cell* has all of what their samples look from: of a tile of pixels its place in the picture and
the depths, of a list a box. About a plane of it all of that lies within a distance.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from gpusim.gpu import Bound, Device, Recording, compare, twin_check
from gpusim.optics.shadow.light_space import UNLIMITED, LightSpace
from gpusim.optics.shadow.probe import probe_pieces, probe_pixels
from gpusim.optics.shadow.receivers import (
    APART,
    TILE,
    DeviceReceivers,
    PixelReceivers,
    Receivers,
)

__all__ = ["asking", "cells_twin", "entries_of", "record_cells"]

Array = npt.NDArray[np.float64]
Numbers = npt.NDArray[np.int64]


def record_cells(recording: Recording, receivers: DeviceReceivers, bound: Bound) -> None:
    """Find the cells, and which receivers are of farther halves."""
    bound.run(
        recording, "optics/shadow/cells", "main", receivers.constants, threads=(receivers.groups,)
    )


def entries_of(receivers: Receivers | PixelReceivers) -> tuple[Numbers, Receivers, Numbers, int]:
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
) -> tuple[Numbers, Receivers, Numbers]:
    """Number (n,), place and entry (n,) of the receivers that ask a lamp."""
    there, every, entry, _ = entries_of(receivers)
    asks = np.flatnonzero(space.asks(every.at, every.normal))
    return there[asks], every[asks], entry[asks]


def cells_twin(receivers: Receivers | PixelReceivers) -> Array:
    """(E, 12): cells as the shader has them."""
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
    return np.column_stack([low, lean, high, highest - lowest, plane])


def _in_picture(receivers: PixelReceivers, every: Receivers) -> tuple[Array, Array]:
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


@twin_check("optics/shadow/cells")
def _check(device: Device) -> None:
    for occluders, _, receivers in (probe_pieces(), probe_pixels()):
        own = DeviceReceivers.of(device, receivers, occluders)
        with device.recording("optics.shadow.cells") as recording:
            record_cells(recording, own, Bound(device, own.bindings(1)))
        got = own.cells.read(np.float32, (own.entries, 12))
        want = cells_twin(receivers)
        compare("optics/shadow/cells", got, want, atol=1e-5, rtol=2e-5)
