"""What receivers see of lamps: all stages of one lamp after the other, in one submission."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from gpusim.errors import OutOfDeviceMemory
from gpusim.gpu import Bound, Buffer, Device, Recording, Uniform
from gpusim.optics.shadow.groups import record_groups
from gpusim.optics.shadow.light_space import LightSpace, lamp_numbers
from gpusim.optics.shadow.mask import record_masks, record_plain
from gpusim.optics.shadow.occluders import DeviceOccluders, Occluders
from gpusim.optics.shadow.receivers import DeviceReceivers, PixelReceivers, Receivers
from gpusim.optics.shadow.refine import record_refinement
from gpusim.optics.shadow.refit import Refit
from gpusim.optics.shadow.search import CHUNK, COUNTERS, Search

__all__ = ["STAGES", "VisibleShares", "visible_shares"]

STAGES = ("refit", "groups", "search", "refine", "mask", "plain")

CAPACITY = 1 << 14
"""Chunks that the pool begins with: 2 MiB."""


class VisibleShares:
    """What receivers see of lamps, found on a device; what is bound stays for the next time."""

    def __init__(
        self,
        device: Device,
        occluders: Occluders | DeviceOccluders,
        receivers: Receivers | PixelReceivers | DeviceReceivers,
        capacity: int = CAPACITY,
    ) -> None:
        self.device = device
        if isinstance(occluders, Occluders):
            occluders = DeviceOccluders(device, occluders)
        if not isinstance(receivers, DeviceReceivers):
            receivers = DeviceReceivers(device, receivers, occluders.occluders)
        self.occluders, self.receivers = occluders, receivers
        self.refit = Refit(device, self.occluders)
        self.shares: Buffer | None = None
        self.counts: list[dict[str, int]] = []
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
        points : (V, 4) vertices relative to the eye (`relative_points`).
        spaces : of the lamps, in their order (`light_spaces`).
        until : the last stage to run, for tests.

        Raises
        ------
        OutOfDeviceMemory
            Lists too long for what one binding holds.
        """
        self.occluders.move(points)
        self.record(spaces, until)
        while self.enlarged(spaces):
            self.record(spaces, until)
        numbers = lamp_numbers(spaces)
        if self.shares is None:
            return np.zeros((self.receivers.count, 0), np.float32)
        found = self.shares.read(np.float32).reshape(-1, max(self.receivers.count, 1))
        return np.ascontiguousarray(found[numbers, : self.receivers.count].T)

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
        self.search = Search(self.device, self.receivers, capacity)
        self._spaces.clear()

    def record(self, spaces: Sequence[LightSpace], until: str = STAGES[-1]) -> None:
        """Let the device work; where a pool may be too small, `find` looks."""
        stages = STAGES[: STAGES.index(until) + 1]
        lamps = max((space.number for space in spaces), default=-1) + 1
        nbytes = 4 * lamps * max(self.receivers.count, 1)
        if lamps and (self.shares is None or self.shares.nbytes < nbytes):
            self._spaces.clear()
            self.shares = self.device.empty(nbytes, "shadow.shares")
        for place, space in enumerate(spaces):
            if place < len(self._spaces) and self._spaces[place].number == space.number:
                self._spaces[place].update(space)
            else:
                self._spaces[place:] = [_SpaceOnDevice(self, space)]
        with self.device.recording("optics.shadow") as recording:
            self.refit.gather(recording)
            if self.shares is not None:
                recording.clear(self.shares)
            for own in self._spaces[: len(spaces)]:
                own.record(recording, stages)

    def _most_chunks(self, count: int) -> int:
        """That the search for any of so many spaces has taken; waits for the device."""
        self.counts = []
        for own in self._spaces[:count]:
            numbers = own.counters.read(np.uint32)[: len(COUNTERS)].tolist()
            self.counts.append(dict(zip(COUNTERS, numbers, strict=True)))
        return max((numbers["taken"] for numbers in self.counts), default=0)


class _SpaceOnDevice:
    """A light space as the programs bind it."""

    def __init__(self, shares: VisibleShares, space: LightSpace) -> None:
        device, self._shares = shares.device, shares
        self.counters = device.empty(4 * len(COUNTERS), "shadow.counters")
        self._light = Uniform(device, space.uniform(), "shadow.light")
        self._lamp = Uniform(device, space.face(), "shadow.lamp")
        self.number = space.number
        self._trees = shares.refit.bound(device, self._light)
        self._bound = Bound(
            device,
            {
                "light": self._light, "lamp": self._lamp, "shares": shares.shares,
                "occluders": shares.occluders.records, "nodes": shares.occluders.nodes,
                "neighbours": shares.occluders.neighbours,
                **shares.receivers.bindings(shares.search.capacity),
                **shares.search.bindings(self.counters),
            },
        )  # fmt: skip

    def update(self, space: LightSpace) -> None:
        """The lamp may stand elsewhere now."""
        self._light.update(space.uniform())
        self._lamp.update(space.face())

    def record(self, recording: Recording, stages: Sequence[str]) -> None:
        """All of ``stages`` for this lamp."""
        receivers, search, bound = self._shares.receivers, self._shares.search, self._bound
        recording.clear(self.counters)
        recording.begin("optics.shadow.refit")
        self._shares.refit.record(recording, self._trees)
        if "groups" in stages:
            recording.begin("optics.shadow.groups")
            record_groups(recording, receivers, bound)
        if "search" in stages:
            recording.begin("optics.shadow.search")
            search.record(recording, bound)
        if "refine" in stages:
            recording.begin("optics.shadow.refine")
            record_refinement(recording, receivers, search, bound)
            search.count_penumbra(recording, bound)
        if "mask" in stages:
            recording.begin("optics.shadow.mask")
            record_masks(recording, receivers, search, bound)
        if "plain" in stages:
            recording.begin("optics.shadow.plain")
            record_plain(recording, receivers, bound)


def visible_shares(
    device: Device,
    occluders: Occluders,
    points: npt.NDArray[np.float32],
    spaces: Sequence[LightSpace],
    receivers: Receivers | PixelReceivers,
) -> npt.NDArray[np.float32]:
    """(n, L): see `VisibleShares.find`."""
    return VisibleShares(device, occluders, receivers).find(points, spaces)
