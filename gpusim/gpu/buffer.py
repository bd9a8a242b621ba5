"""Device buffers: plain bytes, float64 values stored as ``real``."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from gpusim.arrays.array_types import Float
from gpusim.errors import DeviceError, InputError
from gpusim.gpu.context import DeviceContext, DeviceMemory
from gpusim.validation import require

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
        bad = tuple(np.argwhere(~np.isfinite(array))[0].tolist())
        what = f"{where}: not finite at index {bad}"
        raise InputError(f"{what}; got {array[bad]}; expected finite numbers")
    if real == "f64":
        return array
    what = f"{where}: too large for a device without 64-bit floats"
    require(largest <= F32_MAX, what, largest, f"at most {F32_MAX:.6g} (scale the input)")
    high = array.astype(np.float32)
    return np.stack([high, (array - high).astype(np.float32)], axis=-1)


def from_real(data: npt.NDArray[Any], real: str) -> Float:
    """The inverse of `to_real`."""
    if real == "f64":
        return data.astype(np.float64, copy=False)
    return data[..., 0].astype(np.float64) + data[..., 1].astype(np.float64)


@dataclass(eq=False)
class Buffer(DeviceMemory):
    """A storage buffer on the device."""

    device: DeviceContext
    gpu: Any
    nbytes: int
    label: str

    def read(self, dtype: npt.DTypeLike, shape: tuple[int, ...] | None = None) -> npt.NDArray[Any]:
        """Copy back to the host (waits for the device), from the start; by default all."""
        kind = np.dtype(dtype)
        size = self.nbytes
        if shape is not None:
            whole = all(n >= 0 for n in shape)
            require(whole, f"reading {self.label}", f"shape {shape}", "sizes >= 0")
            size = int(np.prod(shape, dtype=np.int64)) * kind.itemsize
        fits = size <= self.nbytes and size % kind.itemsize == 0
        expected = f"at most {self.nbytes}, a multiple of {kind.itemsize}"
        require(fits, f"reading {self.label}", f"{size} bytes", expected)
        gpu = self.live("reading")
        if size == 0:
            return np.zeros(shape if shape is not None else 0, kind)
        raw = self.device.read(gpu, self.label, -(-size // 4) * 4)
        array = np.frombuffer(raw, np.uint8)[:size].view(kind)
        return array if shape is None else array.reshape(shape)

    def write(self, array: npt.NDArray[Any]) -> None:
        """Copy whole words, or all that it holds, from the host to the start."""
        data = np.ascontiguousarray(array)
        fits = data.nbytes == self.nbytes or (data.nbytes < self.nbytes and data.nbytes % 4 == 0)
        expected = f"at most {self.nbytes}, a multiple of 4 or all"
        require(fits, f"writing {self.label}", f"{data.nbytes} bytes", expected)
        gpu = self.live("writing")
        if data.nbytes:
            with self.device.guard(f"writing {self.label}"):
                self.device.write(gpu, data)


@dataclass(eq=False)
class RealBuffer(Buffer):
    """float64 values stored in the device's ``real``; ``shape`` is that of the values."""

    shape: tuple[int, ...] = ()

    def read(
        self,
        dtype: npt.DTypeLike = np.float64,
        shape: tuple[int, ...] | None = None,
    ) -> Float:
        """The values as float64, in the buffer's own shape unless ``shape`` says how many."""
        if np.dtype(dtype) != np.float64:
            raise DeviceError(f"{self.label} holds real values; got {dtype}; expected float64")
        wanted = self.shape if shape is None else shape
        if self.device.real == "f64":
            return super().read(np.float64, wanted)
        return from_real(super().read(np.float32, (*wanted, 2)), self.device.real)

    def write(self, array: npt.NDArray[Any]) -> None:
        """Copy float64 values in."""
        super().write(to_real(array, self.device.real, self.label))
