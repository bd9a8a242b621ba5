"""The search for what may hide a lamp from each entry of receivers.

An occluder that is surely between all receivers of an entry and the lamp, turned one way, hides
*as a whole* with its neighbours that are, too: only the ends of that, its silhouette and where it
leaves the shaft, are listed, and nodes that lie wholly in the shaft have none. Other occluders are
listed *alone*. Without either an entry is lit or in the umbra, which a winding number tells.

Lists lie in chunks of a pool. Where that is used up, what is missing is counted and nothing that
comes after the search is done: see `gpusim.optics.shadow.lamp_visibility`.
"""

from __future__ import annotations

from typing import Any

from gpusim.gpu import Bound, Device, Recording
from gpusim.optics.shadow.receivers import DeviceReceivers

__all__ = ["HALF", "LIT", "UMBRA", "OccluderSearch"]

LIT, UMBRA, HALF = range(3)
"""What an entry sees of a lamp."""

COUNTERS = ("taken", "sifted", "refined", "penumbra", "mixed")

CHUNK = 128
"""Bytes of a chunk of the pool."""

COARSE = 4
"""Tiles, each way, that are looked at together first."""


class OccluderSearch:
    """Lists of entries, for one lamp after the other."""

    def __init__(self, device: Device, receivers: DeviceReceivers, capacity: int) -> None:
        self._receivers, self.capacity = receivers, capacity
        entries = 2 * receivers.most_groups
        self.groups_of = device.empty(48 * entries, "shadow.groups")
        self.pool = device.empty(CHUNK * capacity, "shadow.pool")
        self.heads = device.empty(16 * entries, "shadow.heads")
        # entries to sift, to refine, in penumbra by ends alone, and by single occluders, too
        self.work = device.empty(16 * entries, "shadow.work")
        # of all that there is room for: a band may be shorter than those that follow
        across, down = self._coarse_size(receivers.most_groups)
        self.coarse = device.empty(8 * across * down, "shadow.coarse")
        self.next_groups = device.empty(12, "shadow.next_groups")

    def _coarse_size(self, groups: int) -> tuple[int, int]:
        columns = self._receivers.columns
        return -(-columns // COARSE), max(-(-groups // columns // COARSE), 1)

    def bindings(self) -> dict[str, Any]:
        """By their WGSL names."""
        return {
            "pool": self.pool, "heads": self.heads, "work": self.work, "coarse": self.coarse,
            "next_groups": self.next_groups,
        }  # fmt: skip

    def record(self, recording: Recording, bound: Bound) -> None:
        """Fill the lists."""
        receivers = self._receivers
        name, constants = "optics/shadow/occluder_search", receivers.kind
        if receivers.listed:
            bound.run(recording, name, "listed_groups", constants, threads=(receivers.entries,))
        else:
            across, down = self._coarse_size(receivers.groups)
            bound.run(recording, name, "coarse_tiles", constants, threads=(2 * across * down,))
            rows = receivers.groups // receivers.columns
            groups = 2 * -(-receivers.columns // 8) * -(-rows // 8)
            bound.run(recording, name, "tiles_of_pixels", constants, groups=(groups,))

    def run_counted(
        self, recording: Recording, bound: Bound, name: str, what: str, entry: str = "main"
    ) -> None:
        """Run a kernel on the entries that one before it has counted: what is "sifted", "refined",
        in "penumbra" or "mixed"."""
        constants = self._receivers.constants
        bound.run(
            recording, "optics/shadow/occluder_search", f"count_{what}", constants, groups=(1,)
        )
        bound.run(recording, name, entry, constants, counted=self.next_groups)
