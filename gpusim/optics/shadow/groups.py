"""What the receivers of an entry have in common, in a lamp's light space.

A box around all that their samples look from, and a *ground*: a plane at or below which nothing
hides the lamp from any of them. That is the plane of one receiver, moved down to the lowest, where
all of the lamp is above the highest.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from gpusim.gpu import Bound, Device, Recording, Uniform, compare, twin_check
from gpusim.optics.occlusion import TOLERANCE
from gpusim.optics.shadow.light_space import ANGLE, UNLIMITED, LightSpace
from gpusim.optics.shadow.probe import probe_pieces, probe_pixels
from gpusim.optics.shadow.receivers import (
    TILE,
    DeviceReceivers,
    PixelReceivers,
    Receivers,
    entries_of,
)

__all__ = ["groups_twin", "record_groups"]

Array = npt.NDArray[np.float64]


def record_groups(recording: Recording, receivers: DeviceReceivers, bound: Bound) -> None:
    """Find what entries have in common."""
    bound.run(
        recording, "optics/shadow/groups", receivers.entry(), receivers.constants,
        threads=(receivers.groups,),
    )  # fmt: skip


def groups_twin(receivers: Receivers | PixelReceivers, space: LightSpace) -> Array:
    """(E, 11): box, tolerance and ground of every entry, as the shader has them but for the depth
    that divides a tile."""
    index, every, entry, count = entries_of(receivers, space)
    low, high = np.full((count, 3), UNLIMITED), np.full((count, 3), -UNLIMITED)
    for x in (-0.5, 0.5):
        for y in (-0.5, 0.5):
            place = space.place(every.at + x * every.across + y * every.down)
            slack = space.rounding_at(place)
            np.minimum.at(low, entry, place - slack)
            np.maximum.at(high, entry, place + slack)
    first = np.full(count, len(entry), np.int64)
    np.minimum.at(first, entry, np.arange(len(entry)))
    if isinstance(receivers, PixelReceivers):
        # that in a tile's middle, where it asks
        row, column = np.divmod(index, receivers.camera.width)
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
    lowest, highest, away = np.full(count, UNLIMITED), np.full(count, -UNLIMITED), np.zeros(count)
    np.minimum.at(lowest, entry, height - wide)
    np.maximum.at(highest, entry, height + wide)
    np.maximum.at(away, entry, np.linalg.norm(every.at, axis=1))
    lamp = space.planes(plane)
    slack = np.full(count, ANGLE) if space.lamp.far else space.rounding + highest
    sure = (lamp[:, 2] - space.extent(lamp) > slack) & np.any(plane[:, :3] != 0.0, axis=1)
    ground = np.where(sure[:, None], plane, 0.0)
    ground[:, 3] += np.where(sure, lowest, 0.0)
    box = np.stack([low[:, 0], high[:, 0], low[:, 1], high[:, 1], low[:, 2], high[:, 2]], axis=1)
    return np.column_stack([box, TOLERANCE * away, ground])


@twin_check("optics/shadow/groups")
def _check(device: Device) -> None:
    for occluders, spaces, receivers in (probe_pieces(), probe_pixels()):
        own = DeviceReceivers(device, receivers, occluders)
        for space in spaces:
            light = Uniform(device, space.uniform(), "shadow.light")
            bound = Bound(device, {"light": light, **own.bindings(1)})
            with device.recording("optics.shadow.groups") as recording:
                record_groups(recording, own, bound)
            got = own.groups_of.read(np.float32, (own.entries, 12))
            want = groups_twin(receivers, space)
            compare("optics/shadow/groups", np.delete(got, 6, axis=1), want, atol=1e-5, rtol=2e-5)
