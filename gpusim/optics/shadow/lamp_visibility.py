"""What receivers see of lamps: all stages of one lamp after the other, in one submission.

*Search*: an occluder that is surely between all receivers of an entry and the lamp, turned one way,
hides *as a whole* with its neighbours that are, too: only the ends of that, its silhouette and
where it leaves the shaft, are listed, and nodes that lie wholly in the shaft have none. Other
occluders are listed *alone*. Without either an entry is lit or in the umbra, which a winding number
tells. Lists lie in chunks of a pool. Where that is used up, what is missing is counted and nothing
that comes after the search is done.

*Refinement*: drops occluders listed alone that hide nothing from any receiver of the entry. An
entry's box in light space is larger than what its receivers look from, and nearly all of an open
sheet that they lie on is listed. Most of it is below the planes that they see, or beside the way;
what is left is tested receiver by receiver.

*Mask*: the share of a lamp that receivers in penumbra see, on the mask of
`gpusim.optics.shadow.sample_mask`. Ends of what hides the lamp as a whole are wound round its
samples: as often as layers hide them, modulo 64. Those behind occluders that stand alone are taken
off besides.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from gpusim.arrays.array_types import Single
from gpusim.errors import InputError, OutOfDeviceMemory
from gpusim.gpu import Bound, Buffer, Device, Recording, Uniform
from gpusim.optics.shadow.light_space import LightSpace, lamp_numbers
from gpusim.optics.shadow.occluders import OccluderBVH, Occluders
from gpusim.optics.shadow.receiver_groups import entries_of, record_cells, record_groups
from gpusim.optics.shadow.receivers import (
    DeviceReceivers,
    PixelReceivers,
    Receivers,
    on_device,
)

STAGES = ("refit", "cells", "groups", "search", "refine", "mask")

CAPACITY = 1 << 14
"""Chunks that the pool begins with: 2 MiB."""

LIT, UMBRA, PENUMBRA = range(3)
"""What an entry sees of a lamp."""

COUNTERS = ("taken", "sifted", "refined", "ends", "mixed", "cut")

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
        in penumbra by "ends" alone or "mixed"."""
        constants = self._receivers.constants
        bound.run(
            recording, "optics/shadow/occluder_search", f"count_{what}", constants, groups=(1,)
        )
        bound.run(recording, name, entry, constants, counted=self.next_groups)


class VisibleShares:
    """What receivers see of lamps, found on a device; what is bound stays for the next band.

    ``states`` (L, E) uint32: of each lamp and entry, `LIT`, `UMBRA` or `PENUMBRA`;
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
        points: Single,
        spaces: Sequence[LightSpace],
        until: str = STAGES[-1],
    ) -> Single:
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
        InputError
            Loops over what may hide a lamp were cut short: software drivers allow so many turns.
        """
        self.trees.move(points)
        return self.found(spaces, until)

    def found(self, spaces: Sequence[LightSpace], until: str = STAGES[-1]) -> Single:
        """`find` where vertices are now."""
        self.record(spaces, until)
        while self.enlarged():
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
            result[there, column] = asks * np.where(state == PENUMBRA, found[there, column], plain)
        return result

    def states_of(self, number: int) -> npt.NDArray[np.uint32]:
        """(E,): what entries see of a lamp; waits for the device."""
        entries = self.receivers.entries
        states = self.states.read(np.uint32)[number * entries : (number + 1) * entries]
        return np.asarray(states, np.uint32)

    def enlarged(self) -> bool:
        """Whether the pool was too small for what was recorded, which is to be done again; waits
        for the device."""
        most = self._most_chunks()
        if any(numbers["cut"] for numbers in self.counts):
            raise InputError(
                "render shadows; got more triangles between a lamp and a few pixels than one "
                "thread of this device may look at; expected some thousand: take smaller or fewer "
                "lamps, a coarser mesh, shadows = False, or backend 'numpy'"
            )
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
        if [own.space for own in self._spaces] != list(spaces):
            self._spaces = [
                _SpaceOnDevice(self, place, space) for place, space in enumerate(spaces)
            ]
        if not spaces or not receivers.count:
            return
        with self.device.recording("optics.shadow") as recording:
            recording.clear(self.states)
            if receivers.listed:
                recording.clear(self.shares)
            recording.begin("optics.shadow.cells")
            self.trees.gather(recording)
            record_cells(recording, receivers, self._spaces[0].bound)
            for own in self._spaces:
                own.record(recording, self, stages)

    def make_room(self, spaces: Sequence[LightSpace]) -> None:
        """For `states` and `shares` of so many lamps."""
        lamps = max((space.number for space in spaces), default=-1) + 1
        if lamps > self._lamps:
            self._spaces.clear()
            self._lamps = lamps
            entries = 2 * self.receivers.most_groups
            self.states = self.device.empty(4 * lamps * entries, "shadow.states")
            self.shares = self.device.empty(4 * lamps * self.receivers.most, "shadow.shares")

    def _most_chunks(self) -> int:
        """That the search for any of the spaces has taken; waits for the device."""
        self.counts = []
        for own in self._spaces:
            numbers = own.counters.read(np.uint32)[: len(COUNTERS)].tolist()
            self.counts.append(dict(zip(COUNTERS, numbers, strict=True)))
        return max((numbers["taken"] for numbers in self.counts), default=0)


class _SpaceOnDevice:
    """A light space as the programs bind it; ``place`` among all."""

    def __init__(self, shares: VisibleShares, place: int, space: LightSpace) -> None:
        device, self._place, self.space = shares.device, place, space
        self.counters = device.empty(4 * len(COUNTERS), "shadow.counters")
        self.bound = Bound(
            device,
            {
                "light": Uniform(device, space.uniform(), "shadow.light"),
                "lamp": Uniform(device, space.face(), "shadow.lamp"), "states": shares.states,
                "shares": shares.shares, "groups_of": shares.search.groups_of,
                "counters": self.counters, **shares.trees.bindings(place),
                **shares.receivers.bindings(shares.search.capacity), **shares.search.bindings(),
            },
        )  # fmt: skip

    def record(self, recording: Recording, shares: VisibleShares, stages: Sequence[str]) -> None:
        """All of ``stages`` for this lamp."""
        receivers, search, bound = shares.receivers, shares.search, self.bound
        recording.clear(self.counters)
        recording.begin("optics.shadow.refit")
        shares.trees.fit(recording, self._place, self.space)
        if "groups" in stages:
            recording.begin("optics.shadow.groups")
            record_groups(recording, receivers, bound)
        if "search" in stages:
            recording.begin("optics.shadow.search")
            search.record(recording, bound)
        if "refine" in stages:
            recording.begin("optics.shadow.refine")
            name = "optics/shadow/occluder_refinement"
            search.run_counted(recording, bound, name, "sifted", "sift")
            search.run_counted(recording, bound, name, "refined")
        if "mask" in stages:
            recording.begin("optics.shadow.mask")
            name = "optics/shadow/penumbra_mask"
            search.run_counted(recording, bound, name, "ends")
            search.run_counted(recording, bound, name, "mixed", "mixed")
            if receivers.listed:  # the shares of all others, too
                bound.run(
                    recording, name, "plain", receivers.constants, threads=(receivers.groups,)
                )
