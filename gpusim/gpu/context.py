"""What buffers, textures and programs need of an open device: limits, memory, transfers, errors."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cached_property
from pathlib import Path
from threading import Lock
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
import numpy.typing as npt
import wgpu

from gpusim.errors import NoAdapter, OutOfDeviceMemory
from gpusim.gpu import faults
from gpusim.gpu.adapter import find_adapter, free_memory
from gpusim.gpu.timing import StageTimer
from gpusim.validation import require

PORTABLE_LIMITS = {
    "max-texture-dimension-2d": 8192,
    "max-bind-groups": 4,
    "max-sampled-textures-per-shader-stage": 16,
    "max-storage-textures-per-shader-stage": 4,
    "max-storage-buffers-per-shader-stage": 8,
    "max-uniform-buffers-per-shader-stage": 12,
    "max-storage-buffer-binding-size": 134217728,
    "max-uniform-buffer-binding-size": 65536,
    "max-buffer-size": 268435456,
    "max-compute-workgroup-storage-size": 16384,
    "max-compute-invocations-per-workgroup": 256,
    "max-compute-workgroup-size-x": 256,
    "max-compute-workgroup-size-y": 256,
    "max-compute-workgroup-size-z": 64,
    "max-compute-workgroups-per-dimension": 65535,
}
"""What every WebGPU implementation promises; asking for more would hide non-portable code."""

_opening = Lock()


class DeviceContext:
    """An open adapter with the limits that WebGPU promises everywhere (see `Device`)."""

    def __init__(
        self,
        real: str | None = None,
        adapter: str | None = None,
        memory_limit: int | None = None,
        shaders: Path | None = None,
    ) -> None:
        known = real in (None, "f64", "double_single")
        require(known, "Device real", repr(real), "'f64' or 'double_single'")
        self.adapter = find_adapter(adapter or os.environ.get("GPUSIM_ADAPTER") or None)
        self.info: dict[str, Any] = dict(self.adapter.info)
        has_f64 = "shader-f64" in self.adapter.features
        if real == "f64" and not has_f64:
            raise NoAdapter(f"{self.name}: no 64-bit floats; got real='f64'; use 'double_single'")
        self.real = real or ("f64" if has_f64 else "double_single")
        features = ["shader-f64"] if self.real == "f64" else []
        wanted = ["timestamp-query", "primitive-index"]
        features += [extra for extra in wanted if extra in self.adapter.features]
        self.features = frozenset(features)
        try:
            self.gpu: Any = self.adapter.request_device_sync(
                label="gpusim", required_features=features, required_limits=PORTABLE_LIMITS
            )
        except Exception as error:
            raise NoAdapter(f"{self.name}: the device could not be opened: {error}") from error
        self.limits: dict[str, int] = dict(self.gpu.limits)
        self.memory_limit = memory_limit if memory_limit is not None else free_memory(self.info)
        self.shaders = shaders
        self.timer = StageTimer(self.gpu, self.guard, "timestamp-query" in self.features)
        self.reclaim: list[Callable[[], None]] = []
        """What frees memory that nobody needs now, before more is refused."""
        # bytes by wgpu object: an entry goes when Python drops the object, and only then does
        # wgpu free the memory, after the last submit that uses it
        self._live: WeakKeyDictionary[Any, int] = WeakKeyDictionary()
        self._fence = self.gpu.create_buffer(
            label="gpusim.fence", size=4, usage=wgpu.BufferUsage.COPY_SRC
        )

    def another(self) -> DeviceContext:
        """One more device of the same adapter."""
        name = str(self.info.get("device") or "")
        with _opening:  # one at a time: finding adapters changes the environment for a moment
            return DeviceContext(self.real, name, self.memory_limit, self.shaders)

    @property
    def name(self) -> str:
        """The adapter's name, driver included."""
        parts = (self.info.get("device"), self.info.get("description"))
        return ", ".join(str(part) for part in parts if part)

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.name!r}, real={self.real!r})"

    @property
    def allocated(self) -> int:
        """Bytes of all live buffers and textures."""
        return sum(self._live.values())

    @contextmanager
    def guard(self, what: str) -> Iterator[None]:
        """Turn what wgpu raises or logs inside the block into `DeviceError` and its kinds."""
        try:
            yield
        except wgpu.GPUError as error:
            faults.pending()
            raise faults.translate(error, what) from error
        for message in faults.pending():
            # the log doesn't say which device was lost: a probe shows whether it was this one
            if not faults.is_loss(message) or not self._alive():
                raise faults.translate(message, what)

    def _alive(self) -> bool:
        try:
            self.gpu.create_buffer(size=4, usage=wgpu.BufferUsage.COPY_SRC)
        except wgpu.GPUError as error:
            return not faults.is_loss(str(error))
        return True

    def allocate(self, nbytes: int, label: str, data: npt.NDArray[Any] | None = None) -> Any:
        """The wgpu object of a storage buffer of zeros, or of what ``data`` holds."""
        size = max(16, -(-int(nbytes) // 16) * 16)
        if size > self.limits["max-buffer-size"]:
            most = f"{self.limits['max-buffer-size']} in one buffer on {self.name}"
            raise OutOfDeviceMemory(f"buffer {label}; got {size} bytes; expected at most {most}")
        self.require_memory(size, label)
        with self.guard(f"buffer {label} of {size} bytes"):
            usage = wgpu.BufferUsage
            gpu = self.create(
                label, size, data if nbytes else None,
                usage.STORAGE | usage.COPY_SRC | usage.COPY_DST | usage.INDIRECT,
            )  # fmt: skip
        self.account(gpu, size)
        return gpu

    def allocate_texture(
        self, label: str, size: tuple[int, int], fmt: str, usage: int, nbytes: int
    ) -> Any:
        """The wgpu object of a texture of ``nbytes`` bytes."""
        self.require_memory(nbytes, f"texture {label}")
        with self.guard(f"texture {label} ({size[0]}x{size[1]} {fmt})"):
            gpu = self.gpu.create_texture(
                label=f"gpusim.{label}", size=(*size, 1), format=fmt, usage=usage
            )
        self.account(gpu, nbytes)
        return gpu

    def create(self, label: str, size: int, data: npt.NDArray[Any] | None, usage: int) -> Any:
        """A wgpu buffer of ``size`` bytes, a multiple of 4: contiguous ``data``, then zeros."""
        gpu = self.gpu.create_buffer(
            label=f"gpusim.{label}", size=size, usage=usage, mapped_at_creation=data is not None
        )
        if data is not None:
            gpu.write_mapped(_words(data))
            gpu.unmap()
        return gpu

    def write(self, gpu: Any, data: npt.NDArray[Any]) -> None:
        """Contiguous data to the start of a wgpu buffer, after all that was submitted before."""
        self.gpu.queue.write_buffer(gpu, 0, _words(data))

    def account(self, gpu: Any, nbytes: int) -> None:
        """Count ``nbytes`` as in use for as long as the wgpu object ``gpu`` lives."""
        self._live[gpu] = nbytes

    def require_memory(self, nbytes: int, what: str) -> None:
        """Refuse ``nbytes`` more, before anything is allocated, if they don't fit.

        Raises
        ------
        OutOfDeviceMemory
        """
        limit = self.memory_limit
        if limit is None or self.allocated + nbytes <= limit:
            return
        for free in self.reclaim:
            free()
        if not self.allocated + nbytes <= limit:
            raise OutOfDeviceMemory(
                f"{what}: needs {nbytes / 1e6:.0f} MB beside the {self.allocated / 1e6:.0f} MB in "
                f"use; got a limit of {limit / 1e6:.0f} MB on {self.name}"
            )

    def forget(self, gpu: Any) -> None:
        """Free the memory of a wgpu buffer or texture."""
        self._live.pop(gpu, None)
        gpu.destroy()

    def read(self, gpu: Any, label: str, size: int) -> memoryview:
        """A copy of a wgpu buffer's first bytes (``size`` a multiple of 4), once the device has
        finished."""
        with self.guard(f"reading {label}"):
            try:
                copied: memoryview = self.gpu.queue.read_buffer(gpu, 0, size)
            except (RuntimeError, AttributeError) as error:
                # wgpu-py's words for a failed map, and for one on a device that is gone
                reason = error if self._alive() else "device is lost"
                raise faults.translate(reason, f"reading {label}") from error
        return copied

    @cached_property
    def opaque_zero(self) -> Any:
        """The uniform that keeps double-single arithmetic safe from the compiler."""
        return self.create("real.zero", 16, np.zeros(4, np.uint32), wgpu.BufferUsage.UNIFORM)

    @cached_property
    def smooth_sampler(self) -> Any:
        """What interpolates between a texture's texels, for a binding of type ``sampler``."""
        return self.gpu.create_sampler(mag_filter="linear", min_filter="linear")

    def sync(self) -> None:
        """Wait until everything submitted so far is done.

        Reads four bytes back: wgpu-py 0.32 can't call its own work-done callback.
        """
        with self.guard("waiting for the device"):
            try:
                self.gpu.queue.read_buffer(self._fence, 0, 4)
            except RuntimeError as error:
                raise faults.translate(error, "waiting for the device") from error

    def submit(self, commands: Any, stage: str) -> None:
        """Send a finished command buffer; device errors come back as `DeviceError`."""
        with self.guard(stage):
            self.gpu.queue.submit([commands])


class DeviceMemory:
    """What takes a device's memory until it is released, or Python drops it and no `Bindings` hold
    it any more."""

    device: DeviceContext
    gpu: Any
    label: str

    def live(self, what: str) -> Any:
        """The wgpu object; raises `InputError` if it was released."""
        there = self.gpu is not None
        require(there, f"{what} {self.label}", "a released buffer or texture", "a live one")
        return self.gpu

    def release(self) -> None:
        """Free the memory as soon as submitted work is done; no use afterwards."""
        if self.gpu is not None:
            self.device.forget(self.gpu)
            self.gpu = None


def _words(data: npt.NDArray[Any]) -> npt.NDArray[np.uint8]:
    """The bytes of contiguous data, then zeros up to a multiple of 4."""
    found = data.reshape(-1).view(np.uint8)
    return found if len(found) % 4 == 0 else np.pad(found, (0, -len(found) % 4))
