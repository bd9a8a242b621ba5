"""What receivers see of lamps: all stages of one lamp after the other, in one submission."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from gpusim.errors import OutOfDeviceMemory
from gpusim.gpu import Buffer, Device, Uniform
from gpusim.optics.shadow.groups import record_groups
from gpusim.optics.shadow.light_space import LightSpace
from gpusim.optics.shadow.mask import record_masks, record_plain
from gpusim.optics.shadow.occluders import DeviceOccluders, Occluders
from gpusim.optics.shadow.receivers import DeviceReceivers, PixelReceivers, Receivers
from gpusim.optics.shadow.refine import record_refinement
from gpusim.optics.shadow.refit import Refit
from gpusim.optics.shadow.search import CHUNK, COUNTERS, Search
from gpusim.optics.shadow.twin import lamp_numbers

__all__ = ["STAGES", "VisibleShares", "visible_shares"]

STAGES = ("refit", "groups", "search", "refine", "mask", "plain")

CAPACITY = 1 << 14
"""Chunks that the pool begins with: 2 MiB."""


class VisibleShares:
    """What receivers see of lamps, found on a device; memory stays for the next time."""

    def __init__(
        self,
        device: Device,
        occluders: Occluders,
        receivers: Receivers | PixelReceivers,
        capacity: int = CAPACITY,
    ) -> None:
        self.device = device
        self.occluders = DeviceOccluders(device, occluders)
        self.refit = Refit(device, self.occluders)
        self.receivers = DeviceReceivers(device, receivers, occluders)
        self.search = Search(device, self.receivers, capacity)
        self.counts: list[dict[str, int]] = []

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
        shares: dict[int, Buffer] = {}
        counters = [self.device.empty(4 * len(COUNTERS), "shadow.counters") for _ in spaces]
        while True:
            self._record(spaces, counters, shares, until)
            self.counts = [
                dict(zip(COUNTERS, own.read(np.uint32)[: len(COUNTERS)].tolist(), strict=True))
                for own in counters
            ]
            most = max((count["taken"] for count in self.counts), default=0)
            if most < self.search.capacity - 1:
                break
            self.enlarge(most + most // 8 + 2)
        numbers = lamp_numbers(spaces)
        result = np.zeros((self.receivers.count, len(numbers)), np.float32)
        for column, number in enumerate(numbers):
            result[:, column] = shares[number].read(np.float32)[: self.receivers.count]
        return result

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

    def _record(
        self,
        spaces: Sequence[LightSpace],
        counters: Sequence[Buffer],
        shares: dict[int, Buffer],
        until: str,
    ) -> None:
        stages = STAGES[: STAGES.index(until) + 1]
        own = self.receivers.bindings(self.search.capacity)
        with self.device.recording("optics.shadow") as recording:
            self.refit.gather(recording)
            for space, counter in zip(spaces, counters, strict=True):
                recording.clear(counter)
                if space.number not in shares:
                    shares[space.number] = self.device.empty(
                        4 * max(self.receivers.count, 1), "shadow.shares"
                    )
                shared: dict[str, Any] = {
                    "light": Uniform(self.device, space.uniform(), "shadow.light"),
                    "lamp": Uniform(self.device, space.face(), "shadow.lamp"),
                    "occluders": self.occluders.records, "nodes": self.occluders.nodes,
                    "neighbours": self.occluders.neighbours, "shares": shares[space.number],
                    **own, **self.search.bindings(counter),
                }  # fmt: skip
                recording.begin("optics.shadow.refit")
                self.refit.record(recording, shared["light"])
                if "groups" in stages:
                    recording.begin("optics.shadow.groups")
                    record_groups(recording, self.receivers, shared)
                if "search" in stages:
                    recording.begin("optics.shadow.search")
                    self.search.record(recording, shared)
                if "refine" in stages:
                    recording.begin("optics.shadow.refine")
                    record_refinement(recording, self.receivers, self.search, shared)
                    self.search.count_penumbra(recording, shared)
                if "mask" in stages:
                    recording.begin("optics.shadow.mask")
                    record_masks(recording, self.receivers, self.search, shared)
                if "plain" in stages:
                    recording.begin("optics.shadow.plain")
                    record_plain(recording, self.receivers, shared)


def visible_shares(
    device: Device,
    occluders: Occluders,
    points: npt.NDArray[np.float32],
    spaces: Sequence[LightSpace],
    receivers: Receivers | PixelReceivers,
) -> npt.NDArray[np.float32]:
    """(n, L): see `VisibleShares.find`."""
    return VisibleShares(device, occluders, receivers).find(points, spaces)
