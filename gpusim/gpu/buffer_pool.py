"""Memory that one frame gives back and the next one takes.

Systems hand out new memory page by page when it is first touched, which takes longer than what is
written there then.
"""

from __future__ import annotations

from typing import Any

from gpusim.gpu.buffer import Buffer
from gpusim.gpu.context import DeviceContext
from gpusim.gpu.texture_array import TEXEL_WIDTH, Texels

__all__ = ["BufferPool"]

MOST_BYTES = 1 << 27
"""Enough for the largest frames; others go back to the system."""


class BufferPool:
    """Buffers of a device that wait for somebody who needs their size."""

    def __init__(self, device: DeviceContext) -> None:
        self.device = device
        self._free_buffers: list[Any] = []
        self._texels: dict[str, Texels] = {}
        self.notes: dict[str, object] = {}
        """What others keep on the device from one frame to the next, as long as there is room."""

    @property
    def nbytes(self) -> int:
        """What is waiting."""
        return sum(int(gpu.size) for gpu in self._free_buffers)

    def take(self, nbytes: int, label: str) -> Buffer:
        """A buffer whose content is anything."""
        for place, gpu in enumerate(self._free_buffers):
            if gpu.size - 16 < nbytes <= gpu.size:
                return Buffer(self.device, self._free_buffers.pop(place), nbytes, label)
        return Buffer(self.device, self.device.allocate(nbytes, label), nbytes, label)

    def give(self, buffer: Buffer) -> None:
        """Release a buffer; the oldest ones are freed where they become too many."""
        if buffer.gpu is None:
            return
        self._free_buffers.append(buffer.gpu)
        buffer.gpu = None
        while self.nbytes > MOST_BYTES:
            self.device.forget(self._free_buffers.pop(0))

    def texels(self, count: int, fmt: str, label: str) -> Texels:
        """At least ``count`` texels for one frame after the other: the last of that label if it
        suits.

        What they hold is good until the next ones of that label are asked for.
        """
        kept = self._texels.pop(label, None)
        if kept is None or kept.format != fmt or not count <= kept.count <= 4 * count + TEXEL_WIDTH:
            del kept
            kept = Texels(self.device, count, fmt, label)
        self._texels[label] = kept
        return kept

    def free(self) -> None:
        """Free all that waits."""
        self._texels.clear()
        self.notes.clear()
        while self._free_buffers:
            self.device.forget(self._free_buffers.pop())
