"""Device memory of one solve: everything allocated through an arena is freed together."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from gpusim.gpu import Device, Kernel, Recording, Texels
from gpusim.gpu.buffer import Buffer, RealBuffer

__all__ = ["Allocator", "Arena"]


class Arena:
    """A device whose buffers are remembered; ``release`` frees them. Use as a context manager."""

    def __init__(self, device: Device) -> None:
        self.device = device
        self._buffers: list[Buffer | Texels] = []

    def __enter__(self) -> Arena:
        return self

    def __exit__(self, *_: object) -> None:
        self.release()

    @property
    def limits(self) -> dict[str, int]:
        return self.device.limits

    @property
    def real(self) -> str:
        return self.device.real

    def buffer(self, array: npt.NDArray[Any], label: str) -> Buffer:
        """See ``Device.buffer``."""
        result = self.device.buffer(array, label=label)
        self._buffers.append(result)
        return result

    def real_buffer(self, array: npt.NDArray[np.float64], label: str) -> RealBuffer:
        """See ``Device.real_buffer``."""
        result = self.device.real_buffer(array, label=label)
        self._buffers.append(result)
        return result

    def texels(self, count: int, fmt: str, label: str) -> Texels:
        """See ``Device.texels``."""
        result = self.device.texels(count, fmt, label)
        self._buffers.append(result)
        return result

    def kernel(self, name: str, entry: str, constants: dict[str, float] | None = None) -> Kernel:
        """See ``Device.kernel``."""
        return self.device.kernel(name, entry=entry, constants=constants)

    def recording(self, stage: str) -> Recording:
        """See ``Device.recording``."""
        return self.device.recording(stage)

    def release(self) -> None:
        """Free everything allocated so far."""
        while self._buffers:
            self._buffers.pop().release()


Allocator = Device | Arena
