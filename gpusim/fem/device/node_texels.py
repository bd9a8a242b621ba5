"""Device memory of one solve, and nodal vectors in it as texels.

A vector has a texel (x, y, z, 0) per node, each load case followed by one texel of zeros. The zero
texel is a node that doesn't move: a neighbour that carries what a row of blocks lacks to a sum of
zero (see ``block_texels``).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

from gpusim.arrays.array_types import Float, Real, Single
from gpusim.gpu import Device
from gpusim.gpu.buffer import Buffer, RealBuffer
from gpusim.gpu.texture_array import Texels

# workgroups of the kernels that go by ``row_and_case``
_GROUP = 64


Memory = TypeVar("Memory", bound=Buffer | Texels)


class Arena:
    """A device whose buffers are freed together at the end of a ``with`` block."""

    def __init__(self, device: Device) -> None:
        self.device, self.limits, self.real = device, device.limits, device.real
        self.kernel, self.recording = device.kernel, device.recording
        self._buffers: list[Buffer | Texels] = []

    def __enter__(self) -> Arena:
        return self

    def __exit__(self, *_: object) -> None:
        while self._buffers:
            self._buffers.pop().release()

    def buffer(self, array: npt.NDArray[Any], label: str) -> Buffer:
        """See ``Device.buffer``."""
        return self._kept(self.device.buffer(array, label))

    def real_buffer(self, array: Float, label: str) -> RealBuffer:
        """See ``Device.real_buffer``."""
        return self._kept(self.device.real_buffer(array, label))

    def texels(self, count: int, fmt: str, label: str) -> Texels:
        """See ``Device.texels``."""
        return self._kept(self.device.texels(count, fmt, label))

    def _kept(self, memory: Memory) -> Memory:
        self._buffers.append(memory)
        return memory


Allocator = Device | Arena


@dataclass(frozen=True, eq=False)
class Pair:
    """A vector as the sum of two float32 ones: ``high`` the nearest, ``low`` what that leaves.

    ``low`` None: a vector that is float32 itself, which takes less time to read.
    """

    high: Texels
    low: Texels | None

    def write(self, values: Float) -> None:
        """Copy float64 values (L,N,3) in, to 48 bits, or to 24."""
        high = values.astype(np.float32)
        self.high.write(node_texels(high))
        if self.low is not None:
            self.low.write(node_texels(values - high))

    def read(self, cases: int) -> Float:
        """The (L,N,3) values."""
        result = read_nodes(self.high, cases).astype(np.float64)
        if self.low is not None:
            result += read_nodes(self.low, cases)
        return np.asarray(result)

    @property
    def rounded(self) -> bool:
        return self.low is None

    @property
    def second(self) -> Texels:
        """What is bound where a kernel takes the low half, and doesn't read of a rounded one."""
        return self.high if self.low is None else self.low


def vector_texels(device: Allocator, cases: int, nodes: int, label: str) -> Texels:
    """A vector of zeros."""
    return device.texels(cases * (nodes + 1), "rgba32float", label)


def node_texels(values: Real) -> Single:
    """(L,N,3) as (L (N+1), 4) float32."""
    cases, nodes = values.shape[:2]
    result = np.zeros((cases, nodes + 1, 4), dtype=np.float32)
    result[:, :nodes, :3] = values
    return result.reshape(-1, 4)


def pair(device: Allocator, cases: int, nodes: int, label: str, *, rounded: bool = False) -> Pair:
    """A vector of zeros."""
    high = vector_texels(device, cases, nodes, f"{label}.high")
    return Pair(high, None if rounded else vector_texels(device, cases, nodes, f"{label}.low"))


def read_nodes(texels: Texels, cases: int) -> Single:
    """The (L,N,3) values of a vector."""
    return texels.read().reshape(cases, -1, 4)[:, :-1, :3]


def row_threads(rows: int, cases: int) -> int:
    """Threads of a kernel whose workgroups take the load cases of the same rows one after the other
    (``row_and_case`` of ``shaders/lib/numeric/index.wgsl``)."""
    return -(-rows // _GROUP) * _GROUP * cases
