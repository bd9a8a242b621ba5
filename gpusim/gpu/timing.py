"""Device time per stage from timestamp queries, resolved only when somebody asks."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable
from contextlib import AbstractContextManager
from typing import Any

import numpy as np
import wgpu

_PAIRS = 512


class StageTimer:
    """Collects begin/end timestamps of passes and sums them by stage, in seconds.

    The query set is read out when it is full. Passes of one single recording beyond its capacity
    aren't timed; `untimed` counts them.
    """

    def __init__(
        self, gpu: Any, guard: Callable[[str], AbstractContextManager[None]], enabled: bool
    ) -> None:
        self.enabled = enabled
        self.untimed = 0
        self._gpu, self._guard = gpu, guard
        self._stages: list[str] = []
        self._state: list[str] = []  # "open" while recording, "done" once submitted, else "void"
        self._total: dict[str, float] = defaultdict(float)
        if enabled:
            usage = wgpu.BufferUsage
            self._queries = self._gpu.create_query_set(type="timestamp", count=2 * _PAIRS)
            self._resolved = self._gpu.create_buffer(
                label="gpusim.timing",
                size=16 * _PAIRS,
                usage=usage.QUERY_RESOLVE | usage.COPY_SRC,
            )

    def writes(self, stage: str) -> tuple[int | None, dict[str, Any]]:
        """Slot and ``timestamp_writes`` argument of a new pass of ``stage`` (empty if untimed)."""
        if not self.enabled:
            return None, {}
        if len(self._stages) >= _PAIRS:
            self.seconds()
        if len(self._stages) >= _PAIRS:
            self.untimed += 1
            return None, {}
        slot = len(self._stages)
        self._stages.append(stage)
        self._state.append("open")
        return slot, {
            "timestamp_writes": {
                "query_set": self._queries,
                "beginning_of_pass_write_index": 2 * slot,
                "end_of_pass_write_index": 2 * slot + 1,
            }
        }

    def submitted(self, slots: list[int]) -> None:
        """The passes of these slots are on their way to the device."""
        for slot in slots:
            self._state[slot] = "done"

    def drop(self, slots: list[int]) -> None:
        """The passes of these slots will never run (reading their queries could wait for ever)."""
        for slot in slots:
            self._state[slot] = "void"

    def seconds(self) -> dict[str, float]:
        """Device seconds per stage since the device was opened; waits for the device."""
        done = [slot for slot, state in enumerate(self._state) if state == "done"]
        if done:
            with self._guard("reading the timestamps"):
                for first, last in _runs(done):
                    self._add(first, last)
            self.drop(done)
        if "open" not in self._state:
            self._stages, self._state = [], []
        return dict(self._total)

    def _add(self, first: int, last: int) -> None:
        encoder = self._gpu.create_command_encoder()
        encoder.resolve_query_set(self._queries, 2 * first, 2 * (last - first), self._resolved, 0)
        self._gpu.queue.submit([encoder.finish()])
        data = self._gpu.queue.read_buffer(self._resolved, 0, 16 * (last - first))
        ticks = np.frombuffer(data, np.uint64).astype(np.float64).reshape(-1, 2)
        for stage, (begin, end) in zip(self._stages[first:last], ticks, strict=True):
            self._total[stage] += max(0.0, float(end - begin)) * 1e-9


def _runs(slots: list[int]) -> list[tuple[int, int]]:
    """Sorted numbers as half-open ranges of neighbours."""
    runs: list[tuple[int, int]] = []
    for slot in slots:
        if runs and runs[-1][1] == slot:
            runs[-1] = (runs[-1][0], slot + 1)
        else:
            runs.append((slot, slot + 1))
    return runs
