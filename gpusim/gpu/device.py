"""The explicit device: one adapter, portable limits, buffers, kernels and recordings."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from itertools import pairwise
from pathlib import Path
from threading import Lock
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
import numpy.typing as npt
import wgpu

from gpusim.errors import InputError, NoAdapter, OutOfDeviceMemory
from gpusim.gpu import faults
from gpusim.gpu.adapter import find_adapter, free_memory, is_processor
from gpusim.gpu.buffer import Buffer, RealBuffer, SplitBuffer, to_real
from gpusim.gpu.buffer_pool import Kept
from gpusim.gpu.kernel import Kernel
from gpusim.gpu.programs import Programs
from gpusim.gpu.raster import Raster, Texture
from gpusim.gpu.recording import Recording
from gpusim.gpu.texture_array import Texels
from gpusim.gpu.timing import StageTimer
from gpusim.gpu.transfer import MAPPABLE, Transfer
from gpusim.gpu.wgsl import Module

__all__ = ["PORTABLE_LIMITS", "Device", "default_device"]

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

ATOMICS64 = frozenset({"shader-int64", "shader-int64-atomic-min-max"})
"""What `Device.atomics64` takes."""


class Device:
    """A Vulkan device with the limits that WebGPU promises everywhere.

    Parameters
    ----------
    real : ``"f64"``, ``"double_single"``, or None: 64-bit floats where the adapter has them.
    adapter : part of an adapter's name (as ``gpusim doctor`` prints it); None takes that of the
        environment variable ``GPUSIM_ADAPTER``, or else the first, discrete GPUs before others.
    memory_limit : bytes that may be allocated; None: what the system (CPU) or the driver says.
    shaders : a folder with further WGSL files, searched before gpusim's own.

    Raises
    ------
    NoAdapter
        No Vulkan adapter at all, none of that name, or no 64-bit floats though ``real="f64"``.

    Examples
    --------
    >>> gs.Device().real in ("f64", "double_single")
    True
    """

    def __init__(
        self,
        real: str | None = None,
        adapter: str | None = None,
        memory_limit: int | None = None,
        shaders: Path | None = None,
    ) -> None:
        if real not in (None, "f64", "double_single"):
            raise InputError(f"Device real; got {real!r}; expected 'f64' or 'double_single'")
        self.adapter = find_adapter(adapter or os.environ.get("GPUSIM_ADAPTER") or None)
        self.info: dict[str, Any] = dict(self.adapter.info)
        has_f64 = "shader-f64" in self.adapter.features
        if real == "f64" and not has_f64:
            raise NoAdapter(f"{self.name}: no 64-bit floats; got real='f64'; use 'double_single'")
        self.real = real or ("f64" if has_f64 else "double_single")
        features = ["shader-f64"] if self.real == "f64" else []
        wanted = ["timestamp-query", "primitive-index"]
        if ATOMICS64 <= set(self.adapter.features):
            wanted += sorted(ATOMICS64)
        if is_processor(self.info):
            wanted.append(MAPPABLE)
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
        self.transfer = Transfer(self.gpu, MAPPABLE in self.features)
        self.timer = StageTimer(self, "timestamp-query" in self.features)
        self.kept = Kept(self)
        self.programs = Programs(self)
        # bytes by wgpu object: an entry goes when Python drops the object, and only then does
        # wgpu free the memory, after the last submit that uses it
        self._live: WeakKeyDictionary[Any, int] = WeakKeyDictionary()
        self._opaque: Buffer | None = None
        self._targets: dict[str, Texture] = {}
        self._no_texels: dict[str, Texels] = {}
        self._fence = self.gpu.create_buffer(
            label="gpusim.fence", size=4, usage=wgpu.BufferUsage.COPY_SRC
        )

    @property
    def name(self) -> str:
        """The adapter's name, driver included."""
        parts = (self.info.get("device"), self.info.get("description"))
        return ", ".join(str(part) for part in parts if part)

    def __repr__(self) -> str:
        return f"Device({self.name!r}, real={self.real!r})"

    @property
    def atomics64(self) -> bool:
        """Whether kernels may keep the larger of two 64-bit numbers in one step."""
        return ATOMICS64 <= self.features

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

    # -- buffers ---------------------------------------------------------------------------

    def empty(self, nbytes: int, label: str) -> Buffer:
        """A storage buffer of zeros."""
        return Buffer(self, self._allocate(nbytes, label), int(nbytes), label)

    def buffer(self, array: npt.NDArray[Any], label: str) -> Buffer:
        """A storage buffer holding a copy of ``array`` (not float64: that is `real_buffer`)."""
        data = np.ascontiguousarray(array)
        if data.dtype == np.float64:
            raise InputError(f"buffer {label}: got float64; expected real_buffer or float32 data")
        if data.dtype.kind not in "biufV" or (data.dtype.kind in "iuf" and data.itemsize > 4):
            raise InputError(
                f"buffer {label}: got {data.dtype}; expected a type that WGSL has: 32-bit "
                "(or smaller, packed) numbers or structs of them"
            )
        return Buffer(self, self._allocate(data.nbytes, label, data), data.nbytes, label)

    def real_buffer(
        self,
        array: npt.ArrayLike | None = None,
        label: str = "real",
        shape: tuple[int, ...] | None = None,
    ) -> RealBuffer:
        """float64 values stored as ``real``: those of ``array``, or zeros of ``shape``."""
        if array is None:
            wanted = shape or ()
            nbytes = 8 * int(np.prod(wanted, dtype=np.int64))
            return RealBuffer(self, self._allocate(nbytes, label), nbytes, label, wanted)
        values = np.asarray(array, np.float64)
        data = to_real(values, self.real, label)
        gpu = self._allocate(data.nbytes, label, data)
        return RealBuffer(self, gpu, data.nbytes, label, values.shape)

    def split(
        self,
        array: npt.NDArray[Any],
        label: str,
        align: int = 1,
        like: SplitBuffer | None = None,
    ) -> SplitBuffer:
        """Rows of ``array`` (float64 becomes ``real``) in parts below the binding limit.

        Part borders fall on multiples of ``align`` rows, or where those of ``like`` are, which
        buffers of one dispatch must have in common (split the widest rows first).
        """
        rows = len(array)
        is_real = array.dtype == np.float64
        row_bytes = max(1, array.nbytes // max(rows, 1))
        limit = self.limits["max-storage-buffer-binding-size"]
        if like is not None:
            starts = like.starts
            if starts[-1] != rows:
                raise InputError(f"split {label}; got {rows} rows; expected {starts[-1]}")
        else:
            per_part = max(align, limit // row_bytes)
            per_part -= per_part % align
            starts = (*range(0, max(rows, 1), per_part), rows)
        longest = max(end - start for start, end in pairwise(starts))
        if longest * row_bytes > limit:
            raise InputError(
                f"split {label}; got {longest} rows of {row_bytes} bytes in one part; "
                f"expected at most {limit} bytes"
            )
        parts: list[Buffer] = []
        for start, end in pairwise(starts):
            piece, name = array[start:end], f"{label}[{start}]"
            parts.append(self.real_buffer(piece, name) if is_real else self.buffer(piece, name))
        return SplitBuffer(tuple(parts), starts)

    def _allocate(self, nbytes: int, label: str, data: npt.NDArray[Any] | None = None) -> Any:
        size = max(16, -(-int(nbytes) // 16) * 16)
        if size > self.limits["max-buffer-size"]:
            raise OutOfDeviceMemory(
                f"buffer {label}; got {size} bytes; expected at most "
                f"{self.limits['max-buffer-size']} in one buffer on {self.name}"
            )
        self.require_memory(size, label)
        with self.guard(f"buffer {label} of {size} bytes"):
            gpu = self.transfer.create(label, size, data if nbytes else None)
        self.account(gpu, size)
        return gpu

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
        self.kept.free()
        if not self.allocated + nbytes <= limit:
            raise OutOfDeviceMemory(
                f"{what}: needs {nbytes / 1e6:.0f} MB beside the {self.allocated / 1e6:.0f} MB in "
                f"use; got a limit of {limit / 1e6:.0f} MB on {self.name}"
            )

    def forget(self, buffer: Buffer | Texels) -> None:
        """Free the memory of a buffer or of texels."""
        if buffer.gpu is not None:
            self._live.pop(buffer.gpu, None)
            buffer.gpu.destroy()
            buffer.gpu = None

    @contextmanager
    def seen_bytes(self, buffer: Buffer, offset: int, size: int) -> Iterator[memoryview]:
        """Raw bytes (offset and size multiples of 4) for as long as the block runs.

        Waits until the device has finished.
        """
        gpu = buffer.live("reading")
        with ExitStack() as opened:
            with self.guard(f"reading {buffer.label}"):
                try:
                    data = opened.enter_context(self.transfer.seen(gpu, offset, size))
                except (RuntimeError, AttributeError) as error:
                    # wgpu-py's words for a failed map, and for one on a device that is gone
                    reason = error if self._alive() else "device is lost"
                    raise faults.translate(reason, f"reading {buffer.label}") from error
            yield data

    def write_bytes(self, buffer: Buffer, data: npt.NDArray[Any], offset: int) -> None:
        """Raw bytes into a buffer; the device takes whole words, so partial ones are merged."""
        gpu = buffer.live("writing")
        end = offset + data.nbytes
        first, last = offset - offset % 4, -(-end // 4) * 4
        if first != offset or last != end:
            words = np.zeros(last - first, np.uint8)
            for start in {first, last - 4}:
                # nothing worth keeping lies before the start or behind the end of the buffer
                if start < offset or start + 4 > end < buffer.nbytes:
                    with self.seen_bytes(buffer, start, 4) as word:
                        words[start - first : start - first + 4] = word
            words[offset - first : end - first] = data.reshape(-1).view(np.uint8)
            data, offset = words, first
        with self.guard(f"writing {buffer.label}"):
            self.transfer.write(gpu, data, offset)

    # -- programs --------------------------------------------------------------------------

    def kernel(
        self, name: str, entry: str = "main", constants: dict[str, float] | None = None
    ) -> Kernel:
        """The compute program ``entry`` of ``shaders/<name>.wgsl``, compiled once per device."""
        return self.programs.kernel(name, entry, constants)

    def shader_module(self, module: Module) -> Any:
        """The wgpu module of a shader file, compiled once however many entries it has."""
        return self.programs.module(module)

    def raster(
        self,
        name: str,
        color_formats: tuple[str, ...],
        constants: dict[str, float] | None = None,
        entries: tuple[str, str] = ("vertex", "fragment"),
        depth: str = "greater",
    ) -> Raster:
        """The vertex + fragment program of ``shaders/<name>.wgsl`` (see `Raster`)."""
        return self.programs.raster(name, color_formats, constants, entries, depth)

    def texture(self, width: int, height: int, fmt: str, label: str) -> Texture:
        """A texture that can be rendered to and read by kernels."""
        return Texture(self, width, height, fmt, label)

    def texels(self, count: int, fmt: str, label: str) -> Texels:
        """An array of texels, zero at first: ``fmt`` "rgba32float" or "rgba32uint"."""
        return Texels(self, count, fmt, label)

    def target(self, width: int, height: int, fmt: str, label: str) -> Texture:
        """A texture for one frame after the other: the last one of that label if it fits.

        What it holds is good until the next one of that label is drawn into.
        """
        kept = self._targets.pop(label, None)
        if kept is None or (kept.width, kept.height, kept.format) != (width, height, fmt):
            del kept
            kept = self.texture(width, height, fmt, label)
        self._targets[label] = kept
        return kept

    def no_texels(self, fmt: str) -> Texels:
        """A zero for bindings that have nothing to hold; not to be written."""
        if fmt not in self._no_texels:
            self._no_texels[fmt] = self.texels(1, fmt, "none")
        return self._no_texels[fmt]

    def recording(self, stage: str) -> Recording:
        """A list of dispatches and draws, submitted together when its ``with`` block ends."""
        return Recording(self, stage)

    def opaque_zero(self) -> Any:
        """The uniform that keeps double-single arithmetic safe from the compiler."""
        if self._opaque is None:
            gpu = self.gpu.create_buffer_with_data(
                label="gpusim.real.zero",
                data=np.zeros(4, np.uint32),
                usage=wgpu.BufferUsage.UNIFORM,
            )
            self._opaque = Buffer(self, gpu, 16, "real.zero")
        return self._opaque.gpu

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
            self.transfer.submit([commands])


_default: Device | None = None
_opening = Lock()


def default_device() -> Device:
    """The process-wide device that ``gs.solve`` and ``gs.render`` use when none is given."""
    global _default
    with _opening:
        if _default is None:
            _default = Device()
        return _default
