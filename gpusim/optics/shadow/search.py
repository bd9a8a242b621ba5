"""The search for what may hide a lamp from each entry of receivers.

An occluder that is surely between all receivers of an entry and the lamp, turned one way, hides
*as a whole* with its neighbours that are, too: only the ends of that, its silhouette and where it
leaves the shaft, are listed, and nodes that lie wholly in the shaft have none. Other occluders are
listed *alone*. Without either an entry is lit or in the umbra, which a winding number tells.

Lists lie in chunks of a pool. Where that is used up, what is missing is counted and nothing that
comes after the search is done: see `gpusim.optics.shadow.visible`.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from gpusim.gpu import Bound, Buffer, Device, Recording, compare, twin_check
from gpusim.optics.shadow.probe import probe_pieces, probe_pixels, probe_points
from gpusim.optics.shadow.receivers import DeviceReceivers, entries_of
from gpusim.optics.shadow.twin import shares_twin

__all__ = ["HALF", "LIT", "UMBRA", "Search"]

LIT, UMBRA, HALF = range(3)
"""What an entry sees of a lamp."""

COUNTERS = ("taken", "refined", "penumbra")

CHUNK = 128
"""Bytes of a chunk of the pool."""

COARSE = 4
"""Tiles, each way, that are looked at together first."""


class Search:
    """Lists of entries, for one lamp after the other."""

    def __init__(self, device: Device, receivers: DeviceReceivers, capacity: int) -> None:
        self._device, self._receivers = device, receivers
        self.capacity = capacity
        entries = max(receivers.entries, 1)
        self.pool = device.empty(CHUNK * capacity, "shadow.pool")
        self.heads = device.empty(16 * entries, "shadow.heads")
        # entries to refine, behind twice the groups those in penumbra
        self.work = device.empty(4 * (2 * receivers.groups + entries), "shadow.work")
        self.states = device.empty(4 * entries, "shadow.states")
        across, down = self._coarse_size
        self.coarse = device.empty(8 * across * down, "shadow.coarse")
        self.refine_groups = device.empty(12, "shadow.refine_groups")
        self.mask_groups = device.empty(12, "shadow.mask_groups")

    @property
    def _coarse_size(self) -> tuple[int, int]:
        own = self._receivers
        return -(-own.columns // COARSE), max(-(-own.groups // own.columns // COARSE), 1)

    def bindings(self, counters: Buffer) -> dict[str, Any]:
        """By their WGSL names; ``counters`` of one lamp."""
        return {
            "pool": self.pool, "heads": self.heads, "work": self.work, "states": self.states,
            "coarse": self.coarse, "refine_groups": self.refine_groups,
            "mask_groups": self.mask_groups, "counters": counters,
        }  # fmt: skip

    def record(self, recording: Recording, bound: Bound) -> None:
        """Fill the lists."""
        receivers = self._receivers
        name, constants = "optics/shadow/search", receivers.constants
        if receivers.listed:
            bound.run(recording, name, "pieces_alone", constants, threads=(receivers.groups,))
        else:
            across, down = self._coarse_size
            bound.run(recording, name, "coarse_tiles", constants, threads=(2 * across * down,))
            rows = receivers.groups // receivers.columns
            groups = 2 * -(-receivers.columns // 8) * -(-rows // 8)
            bound.run(recording, name, "tiles_of_pixels", constants, groups=(groups,))
        bound.run(recording, name, "count_refined", constants, groups=(1,))

    def count_penumbra(self, recording: Recording, bound: Bound) -> None:
        """Once it is known what is in penumbra, say so to the kernel that looks at it."""
        constants = self._receivers.constants
        bound.run(recording, "optics/shadow/search", "count_penumbra", constants, groups=(1,))


def states_twin(states: npt.NDArray[np.uint32], shares: Any, entry: Any) -> npt.NDArray[np.int64]:
    """(E,): what ``states`` of entries should be by the ``shares`` (n,) that the receivers in each
    ``entry`` (n,) see. Those may be looked at closely that needn't be."""
    least, most = np.ones(len(states)), np.zeros(len(states))
    np.minimum.at(least, entry, shares)
    np.maximum.at(most, entry, shares)
    used = np.isin(np.arange(len(states)), entry)
    # one sample of the 512 may lie on an outline
    sample = 1.5 / 512.0
    lit, dark = used & (least > 1.0 - sample), used & (most < sample)
    want = np.where(lit, LIT, np.where(dark, UMBRA, np.where(used, HALF, LIT)))
    careful = (states == HALF) & used
    return np.where(careful, HALF, want)


@twin_check("optics/shadow/search")
def _check(device: Device) -> None:
    from gpusim.optics.shadow.visible import VisibleShares

    points = probe_points()
    for occluders, spaces, receivers in (probe_pieces(), probe_pixels()):
        for space in spaces[::2]:
            shares = VisibleShares(device, occluders, receivers)
            shares.find(points, [space])
            _, own, entry, _ = entries_of(receivers, space)
            flat = shares_twin(occluders, points[:, :3].astype(np.float64), [space], own)[:, 0]
            got = shares.search.states.read(np.uint32)
            compare("optics/shadow/search", got, states_twin(got, flat, entry), "exact")
