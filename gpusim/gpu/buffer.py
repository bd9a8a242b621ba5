"""Device buffers: plain bytes, float64 values stored as ``real``, a pool."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from gpusim.arrays.array_types import Float
from gpusim.errors import DeviceError, InputError
from gpusim.gpu.context import DeviceContext
from gpusim.gpu.texture_array import TEXEL_WIDTH, Texels

MOST_BYTES = 1 << 27
"""Enough for the largest frames; others go back to the system."""

F32_MAX = float(np.finfo(np.float32).max)


def to_real(values: npt.ArrayLike, real: str, where: str) -> npt.NDArray[Any]:
    """float64 values as the bytes of WGSL ``real``: float64, or (…, 2) float32 (high, low).

    Raises
    ------
    InputError
        A value is NaN or infinite, or too large for float32 where ``real`` is double-single.
    """
    array = np.ascontiguousarray(values, dtype=np.float64)
    largest = float(np.max(np.abs(array), initial=0.0))
    if not np.isfinite(largest):
        bad = np.argwhere(~np.isfinite(array))[0]
        raise InputError(
            f"{where}: not finite at index {tuple(int(i) for i in bad)}; "
            f"got {array[tuple(bad)]}; expected finite numbers"
        )
    if real == "f64":
        return array
    if not largest <= F32_MAX:
        raise InputError(
            f"{where}: too large for a device without 64-bit floats; "
            f"got {largest:.6g}; expected at most {F32_MAX:.6g} (scale the input)"
        )
    high = array.astype(np.float32)
    return np.stack([high, (array - high).astype(np.float32)], axis=-1)


def from_real(data: npt.NDArray[Any], real: str) -> Float:
    """The inverse of `to_real`."""
    if real == "f64":
        return data.astype(np.float64, copy=False)
    return data[..., 0].astype(np.float64) + data[..., 1].astype(np.float64)


@dataclass(eq=False)
class Buffer:
    """A storage buffer on the device."""

    device: DeviceContext
    gpu: Any
    nbytes: int
    label: str

    def read(
        self, dtype: npt.DTypeLike, shape: tuple[int, ...] | None = None, offset: int = 0
    ) -> npt.NDArray[Any]:
        """Copy back to the host (waits for the device); ``offset`` in bytes."""
        with self.seen(dtype, shape, offset) as values:
            return values.copy()

    @contextmanager
    def seen(
        self, dtype: npt.DTypeLike, shape: tuple[int, ...] | None = None, offset: int = 0
    ) -> Iterator[npt.NDArray[Any]]:
        """The same without a copy, to be used only inside the ``with`` block."""
        kind = np.dtype(dtype)
        size = self.nbytes - offset
        if shape is not None:
            if any(n < 0 for n in shape):
                raise InputError(f"reading {self.label}; got shape {shape}; expected sizes >= 0")
            size = int(np.prod(shape, dtype=np.int64)) * kind.itemsize
        if offset < 0 or size < 0 or offset + size > self.nbytes or size % kind.itemsize:
            raise InputError(
                f"reading {self.label}; got {size} bytes at {offset}; "
                f"expected at most {self.nbytes}, a multiple of {kind.itemsize}"
            )
        gpu = self.live("reading")
        if size == 0:
            yield np.zeros(shape if shape is not None else 0, kind)
            return
        first, last = offset - offset % 4, -(-(offset + size) // 4) * 4
        with self.device.seen_bytes(gpu, self.label, first, last - first) as raw:
            data = np.frombuffer(raw, np.uint8)[offset - first : offset - first + size]
            array = (data if offset == first else data.copy()).view(kind)
            yield array if shape is None else array.reshape(shape)

    def write(self, array: npt.NDArray[Any], offset: int = 0) -> None:
        """Copy from the host; ``offset`` in bytes."""
        data = np.ascontiguousarray(array)
        if offset < 0 or offset + data.nbytes > self.nbytes:
            raise InputError(
                f"writing {self.label}; got {data.nbytes} bytes at {offset}; "
                f"expected at most {self.nbytes}"
            )
        gpu = self.live("writing")
        if not data.nbytes:
            return
        end = offset + data.nbytes
        first, last = offset - offset % 4, -(-end // 4) * 4
        if first != offset or last != end:  # the device takes whole words: partial ones are merged
            words = np.zeros(last - first, np.uint8)
            for start in {first, last - 4}:
                # nothing worth keeping lies before the start or behind the end of the buffer
                if start < offset or start + 4 > end < self.nbytes:
                    with self.device.seen_bytes(gpu, self.label, start, 4) as word:
                        words[start - first : start - first + 4] = word
            words[offset - first : end - first] = data.reshape(-1).view(np.uint8)
            data, offset = words, first
        with self.device.guard(f"writing {self.label}"):
            self.device.transfer.write(gpu, data, offset)

    def live(self, what: str) -> Any:
        """The wgpu buffer; raises `InputError` if the buffer was released."""
        if self.gpu is None:
            raise InputError(f"{what} {self.label}; got a released buffer; expected a live one")
        return self.gpu

    def release(self) -> None:
        """Free the device memory as soon as submitted work is done; no use afterwards.

        A buffer that Python drops is freed too, once no `Bindings` hold it any more.
        """
        if self.gpu is not None:
            self.device.forget(self.gpu)
            self.gpu = None


@dataclass(eq=False)
class RealBuffer(Buffer):
    """float64 values stored in the device's ``real``; ``shape`` is that of the values."""

    shape: tuple[int, ...] = ()

    def read(
        self,
        dtype: npt.DTypeLike = np.float64,
        shape: tuple[int, ...] | None = None,
        offset: int = 0,
    ) -> Float:
        """The values as float64, in the buffer's own shape; ``offset`` counts values."""
        if np.dtype(dtype) != np.float64:
            raise DeviceError(f"{self.label} holds real values; got {dtype}; expected float64")
        wanted = self.shape if shape is None else shape
        if self.device.real == "f64":
            return super().read(np.float64, wanted, offset * 8)
        return from_real(super().read(np.float32, (*wanted, 2), offset * 8), self.device.real)

    def write(self, array: npt.NDArray[Any], offset: int = 0) -> None:
        """Copy float64 values in; ``offset`` counts values."""
        super().write(to_real(array, self.device.real, self.label), offset * 8)


class BufferPool:
    """Buffers of a device that one frame gives back and the next one takes.

    Systems hand out new memory page by page when it is first touched, which takes longer than what
    is written there then.
    """

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
