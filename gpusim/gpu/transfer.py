"""Bytes between the host and a device's buffers.

Where the adapter is the processor itself, buffers lie in the host's memory: they are mapped and
copied once. Queues would copy twice, once into memory that is touched for the first time, which
costs several times a copy.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from threading import Lock
from typing import Any

import numpy as np
import numpy.typing as npt
import wgpu

MAPPABLE = "mappable-primary-buffers"
"""The feature that lets the host map storage buffers."""

_STEP = 8
"""Mapped ranges begin at multiples of this."""


class Transfer:
    """Writes and reads the buffers of one wgpu device; ``direct`` maps them."""

    def __init__(self, gpu: Any, direct: bool) -> None:
        self.gpu, self.direct = gpu, direct
        # the queue keeps what is written until something is submitted; mapping doesn't wait for it
        self._written, self._sent = 0, 0
        self._counting = Lock()

    def create(
        self, label: str, size: int, data: npt.NDArray[Any] | None, uniform: bool = False
    ) -> Any:
        """A storage or ``uniform`` buffer of ``size`` bytes, a multiple of 16.

        It holds contiguous ``data``, then zeros.
        """
        usage = wgpu.BufferUsage
        flags = usage.UNIFORM if uniform else usage.STORAGE | usage.COPY_SRC | usage.INDIRECT
        flags |= usage.COPY_DST
        if self.direct:
            flags |= usage.MAP_READ | usage.MAP_WRITE
        at_once = self.direct and data is not None
        gpu = self.gpu.create_buffer(
            label=f"gpusim.{label}", size=size, usage=flags, mapped_at_creation=at_once
        )
        if data is None:
            return gpu
        if at_once:
            gpu.write_mapped(_words(data))
            gpu.unmap()
        else:
            self.write(gpu, data, 0)
        return gpu

    def write(self, gpu: Any, data: npt.NDArray[Any], offset: int) -> None:
        """Contiguous data into a buffer after all that was submitted before, whole words."""
        self.gpu.queue.write_buffer(gpu, offset, _words(data))
        with self._counting:
            self._written += 1

    def submit(self, commands: list[Any]) -> None:
        """Send command buffers, and what was written."""
        written = self._written
        self.gpu.queue.submit(commands)
        with self._counting:
            self._sent = max(self._sent, written)

    @contextmanager
    def seen(self, gpu: Any, offset: int, size: int) -> Iterator[memoryview]:
        """The bytes of a buffer (``offset`` and ``size`` multiples of 4) as long as the block runs.

        Waits until the device has finished. wgpu's own errors pass through.
        """
        if not self.direct:
            yield self.gpu.queue.read_buffer(gpu, offset, size)
            return
        if self._sent < self._written:
            self.submit([])
        first = offset - offset % _STEP
        gpu.map_async("READ_NOSYNC", first, offset + size - first).sync_wait()
        try:
            yield gpu.read_mapped(first, offset + size - first, copy=False)[offset - first :]
        finally:
            gpu.unmap()


def _words(data: npt.NDArray[Any]) -> npt.NDArray[np.uint8]:
    """The bytes of contiguous data, then zeros up to a multiple of 4."""
    found = data.reshape(-1).view(np.uint8)
    return found if len(found) % 4 == 0 else np.pad(found, (0, -len(found) % 4))
