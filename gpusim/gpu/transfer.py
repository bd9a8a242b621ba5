"""Bytes between the host and a device's buffers.

Where the adapter is the processor itself, buffers lie in the host's memory: they are mapped and
copied once. Queues would copy twice, once into memory that is touched for the first time, which
costs several times a copy.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import numpy.typing as npt
import wgpu

__all__ = ["MAPPABLE", "Transfer"]

MAPPABLE = "mappable-primary-buffers"
"""The feature that lets the host map storage buffers."""

_STEP = 8
"""Mapped ranges begin at multiples of this."""


class Transfer:
    """Writes and reads the buffers of one wgpu device; ``direct`` maps them."""

    def __init__(self, gpu: Any, direct: bool) -> None:
        self.gpu, self.direct = gpu, direct
        # the queue keeps what is written until something is submitted; mapping doesn't wait for it
        self._kept_back = False

    def create(self, label: str, size: int, data: npt.NDArray[Any] | None) -> Any:
        """A storage buffer of ``size`` bytes, a multiple of 16: contiguous ``data``, then zeros."""
        usage = wgpu.BufferUsage
        flags = usage.STORAGE | usage.COPY_SRC | usage.COPY_DST | usage.INDIRECT
        if self.direct:
            flags |= usage.MAP_READ | usage.MAP_WRITE
        at_once = self.direct and data is not None
        gpu = self.gpu.create_buffer(
            label=f"gpusim.{label}", size=size, usage=flags, mapped_at_creation=at_once
        )
        if data is not None:
            words = data.reshape(-1).view(np.uint8)
            if len(words) % 4:
                words = np.pad(words, (0, -len(words) % 4))
            if at_once:
                gpu.write_mapped(words)
                gpu.unmap()
            else:
                self.write(gpu, words, 0)
        return gpu

    def write(self, gpu: Any, data: npt.NDArray[Any], offset: int) -> None:
        """Whole words into a buffer, after all that was submitted before."""
        self._kept_back = True
        self.gpu.queue.write_buffer(gpu, offset, data)

    def submit(self, commands: list[Any]) -> None:
        """Send command buffers, and what was written."""
        self._kept_back = False
        self.gpu.queue.submit(commands)

    @contextmanager
    def seen(self, gpu: Any, offset: int, size: int) -> Iterator[memoryview]:
        """The bytes of a buffer (``offset`` and ``size`` multiples of 4) as long as the block runs.

        Waits until the device has finished. wgpu's own errors pass through.
        """
        if not self.direct:
            self._kept_back = False
            yield self.gpu.queue.read_buffer(gpu, offset, size)
            return
        if self._kept_back:
            self.submit([])
        first = offset - offset % _STEP
        gpu.map_async("READ_NOSYNC", first, offset + size - first).sync_wait()
        try:
            yield gpu.read_mapped(first, offset + size - first, copy=False)[offset - first :]
        finally:
            gpu.unmap()
