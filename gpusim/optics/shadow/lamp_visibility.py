"""What receivers see of lamps: all stages of one lamp after the other, in one submission."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from gpusim.errors import OutOfDeviceMemory
from gpusim.gpu import Bound, Buffer, Device, Recording, Uniform
from gpusim.optics.shadow.bvh_refit import OccluderBVH
from gpusim.optics.shadow.light_space import LightSpace, lamp_numbers
from gpusim.optics.shadow.occluder_refinement import record_refinement
from gpusim.optics.shadow.occluder_search import CHUNK, COUNTERS, HALF, UMBRA, OccluderSearch
from gpusim.optics.shadow.occluders import Occluders
from gpusim.optics.shadow.penumbra_mask import record_masks
from gpusim.optics.shadow.receiver_groups import entries_of, record_cells, record_groups
from gpusim.optics.shadow.receivers import (
    DeviceReceivers,
    PixelReceivers,
    Receivers,
    on_device,
)

__all__ = ["STAGES", "VisibleShares", "visible_shares"]

STAGES = ("refit", "cells", "groups", "search", "refine", "mask")

CAPACITY = 1 << 14
"""Chunks that the pool begins with: 2 MiB."""


class VisibleShares:
    """What receivers see of lamps, found on a device; what is bound stays for the next time.

    ``states`` (L, E) uint32: of each lamp and entry, see `gpusim.optics.shadow.occluder_search`;
    ``shares`` (L, n) float32: of receivers in entries that see a lamp in part, of those in a list
    all.
    """

    states: Buffer
    shares: Buffer

    def __init__(
        self,
        device: Device,
        occluders: Occluders | OccluderBVH,
        receivers: Receivers | PixelReceivers | DeviceReceivers,
        capacity: int = CAPACITY,
    ) -> None:
        self.device = device
        self.trees = (
            occluders if isinstance(occluders, OccluderBVH) else OccluderBVH(device, occluders)
        )
        if not isinstance(receivers, DeviceReceivers):
            receivers = on_device(device, receivers, self.trees.occluders)
        self.receivers = receivers
        self.counts: list[dict[str, int]] = []
        self._lamps = 0
        self._spaces: list[_SpaceOnDevice] = []
        self.enlarge(capacity)

    def find(
        self,
        points: npt.NDArray[np.float32],
        spaces: Sequence[LightSpace],
        until: str = STAGES[-1],
    ) -> npt.NDArray[np.float32]:
        """(n, L): the share of each lamp that every pixel, or listed receiver, sees; 0 where it is
        turned away from a lamp or behind it.

        Parameters
        ----------
        points : (V, 3) vertices relative to the eye (`relative_points`).
        spaces : of the lamps, in their order (`light_spaces`).
        until : the last stage to run, for tests.

        Raises
        ------
        OutOfDeviceMemory
            Lists too long for what one binding holds.
        """
        self.trees.move(points)
        return self.found(spaces, until)

    def found(
        self, spaces: Sequence[LightSpace], until: str = STAGES[-1]
    ) -> npt.NDArray[np.float32]:
        """`find` where vertices are now."""
        self.record(spaces, until)
        while self.enlarged(spaces):
            self.record(spaces, until)
        count, numbers = self.receivers.count, lamp_numbers(spaces)
        if not numbers or not count:
            return np.zeros((count, len(numbers)), np.float32)
        found = self.shares.read(np.float32)[: self._lamps * count].reshape(-1, count)[numbers].T
        pixels = self.receivers.source
        if not isinstance(pixels, PixelReceivers):
            return np.ascontiguousarray(found)
        there, every, entry, _ = entries_of(pixels)
        result = np.zeros((count, len(numbers)), np.float32)
        for column, number in enumerate(numbers):
            own = [space for space in spaces if space.number == number]
            asks = np.any([space.asks(every.at, every.normal) for space in own], axis=0)
            state = self.states_of(number)[entry]
            plain = np.where(state == UMBRA, 0.0, 1.0)
            result[there, column] = asks * np.where(state == HALF, found[there, column], plain)
        return result

    def states_of(self, number: int) -> npt.NDArray[np.uint32]:
        """(E,): what entries see of a lamp; waits for the device."""
        entries = self.receivers.entries
        states = self.states.read(np.uint32)[number * entries : (number + 1) * entries]
        return np.asarray(states, np.uint32)

    def enlarged(self, spaces: Sequence[LightSpace]) -> bool:
        """Whether the pool was too small for what was recorded, which is to be done again; waits
        for the device."""
        most = self._most_chunks(len(spaces))
        if most < self.search.capacity - 1:
            return False
        self.enlarge(most + most // 8 + 2)
        return True

    def enlarge(self, capacity: int) -> None:
        """Take a pool of so many chunks."""
        limit = self.device.limits["max-storage-buffer-binding-size"] // CHUNK
        if capacity > limit:
            raise OutOfDeviceMemory(
                f"render shadows; got {capacity} chunks of lists of what may hide a lamp; expected "
                f"at most {limit}: take smaller or fewer lamps, a coarser mesh, fewer pixels, "
                "shadows = False, or backend 'numpy'"
            )
        self.search = OccluderSearch(self.device, self.receivers, capacity)
        self._spaces.clear()

    def record(self, spaces: Sequence[LightSpace], until: str = STAGES[-1]) -> None:
        """Let the device work; where a pool may be too small, `find` looks."""
        stages = STAGES[: STAGES.index(until) + 1]
        receivers = self.receivers
        self.make_room(spaces)
        for place, space in enumerate(spaces):
            if place < len(self._spaces) and self._spaces[place].number == space.number:
                self._spaces[place].update(space)
            else:
                self._spaces[place:] = [_SpaceOnDevice(self, place, space)]
        if not spaces or not receivers.count:
            return
        with self.device.recording("optics.shadow") as recording:
            recording.clear(self.states)
            if receivers.listed:
                recording.clear(self.shares)
            recording.begin("optics.shadow.cells")
            self.trees.gather(recording)
            record_cells(recording, receivers, self._spaces[0].bound)
            for own in self._spaces[: len(spaces)]:
                own.record(recording, stages)

    def make_room(self, spaces: Sequence[LightSpace]) -> None:
        """For `states` and `shares` of so many lamps."""
        lamps = max((space.number for space in spaces), default=-1) + 1
        if lamps > self._lamps:
            self._spaces.clear()
            self._lamps = lamps
            entries = 2 * self.receivers.most_groups
            self.states = self.device.empty(4 * lamps * entries, "shadow.states")
            self.shares = self.device.empty(4 * lamps * self.receivers.most, "shadow.shares")

    def _most_chunks(self, count: int) -> int:
        """That the search for any of so many spaces has taken; waits for the device."""
        self.counts = []
        for own in self._spaces[:count]:
            numbers = own.counters.read(np.uint32)[: len(COUNTERS)].tolist()
            self.counts.append(dict(zip(COUNTERS, numbers, strict=True)))
        return max((numbers["taken"] for numbers in self.counts), default=0)


class _SpaceOnDevice:
    """A light space as the programs bind it; ``place`` among all."""

    def __init__(self, shares: VisibleShares, place: int, space: LightSpace) -> None:
        device, self._shares, self._place = shares.device, shares, place
        self.counters = device.empty(4 * len(COUNTERS), "shadow.counters")
        self._light = Uniform(device, space.uniform(), "shadow.light")
        self._lamp = Uniform(device, space.face(), "shadow.lamp")
        self._space, self.number = space, space.number
        self.bound = Bound(
            device,
            {
                "light": self._light, "lamp": self._lamp, "states": shares.states,
                "shares": shares.shares, "groups_of": shares.search.groups_of,
                "counters": self.counters, **shares.trees.bindings(place),
                **shares.receivers.bindings(shares.search.capacity), **shares.search.bindings(),
            },
        )  # fmt: skip

    def update(self, space: LightSpace) -> None:
        """The lamp may stand elsewhere now."""
        self._space = space
        self._light.update(space.uniform())
        self._lamp.update(space.face())

    def record(self, recording: Recording, stages: Sequence[str]) -> None:
        """All of ``stages`` for this lamp."""
        receivers, search, bound = self._shares.receivers, self._shares.search, self.bound
        recording.clear(self.counters)
        recording.begin("optics.shadow.refit")
        self._shares.trees.fit(recording, self._place, self._space)
        if "groups" in stages:
            recording.begin("optics.shadow.groups")
            record_groups(recording, receivers, bound)
        if "search" in stages:
            recording.begin("optics.shadow.search")
            search.record(recording, bound)
        if "refine" in stages:
            recording.begin("optics.shadow.refine")
            record_refinement(recording, search, bound)
        if "mask" in stages:
            recording.begin("optics.shadow.mask")
            record_masks(recording, receivers, search, bound)


def visible_shares(
    device: Device,
    occluders: Occluders,
    points: npt.NDArray[np.float32],
    spaces: Sequence[LightSpace],
    receivers: Receivers | PixelReceivers,
) -> npt.NDArray[np.float32]:
    """(n, L): see `VisibleShares.find`."""
    return VisibleShares(device, occluders, receivers).find(points, spaces)
