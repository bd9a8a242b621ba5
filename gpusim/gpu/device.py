"""The explicit device: one adapter, portable limits, buffers, kernels and recordings."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from threading import Lock
from typing import Any

import numpy as np
import numpy.typing as npt

from gpusim.errors import InputError
from gpusim.gpu.buffer import Buffer, RealBuffer, to_real
from gpusim.gpu.context import DeviceContext
from gpusim.gpu.kernel import Kernel
from gpusim.gpu.programs import Programs, program_key
from gpusim.gpu.raster import Raster, Texture
from gpusim.gpu.recording import Recording
from gpusim.gpu.texture_array import TexelPool, Texels


class Device(DeviceContext):
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
        super().__init__(real, adapter, memory_limit, shaders)
        self.pool = TexelPool(self)
        self.reclaim.append(self.pool.free)
        self.programs = Programs(self)
        self._targets: dict[str, Texture] = {}
        self._no_texels: dict[str, Texels] = {}

    # -- buffers ---------------------------------------------------------------------------

    def empty(self, nbytes: int, label: str) -> Buffer:
        """A storage buffer of zeros."""
        return Buffer(self, self.allocate(nbytes, label), int(nbytes), label)

    def buffer(self, array: npt.NDArray[Any], label: str) -> Buffer:
        """A storage buffer holding a copy of ``array`` (not float64: that is `real_buffer`)."""
        data = np.ascontiguousarray(array)
        if data.dtype == np.float64:
            raise InputError(f"buffer {label}: got float64; expected real_buffer or float32 data")
        if data.dtype.kind not in "biufV" or (data.dtype.kind in "iuf" and data.itemsize > 4):
            wanted = "a type that WGSL has: 32-bit (or smaller, packed) numbers or structs of them"
            raise InputError(f"buffer {label}: got {data.dtype}; expected {wanted}")
        return Buffer(self, self.allocate(data.nbytes, label, data), data.nbytes, label)

    def real_buffer(self, array: npt.ArrayLike, label: str) -> RealBuffer:
        """float64 values stored as ``real``."""
        values = np.asarray(array, np.float64)
        data = to_real(values, self.real, label)
        gpu = self.allocate(data.nbytes, label, data)
        return RealBuffer(self, gpu, data.nbytes, label, values.shape)

    # -- programs --------------------------------------------------------------------------

    def kernel(
        self, name: str, entry: str = "main", constants: dict[str, float] | None = None
    ) -> Kernel:
        """The compute program ``entry`` of ``shaders/<name>.wgsl``, compiled once per device."""
        kernel: Kernel = self.programs.program(program_key(name, entry, constants))
        return kernel

    def raster(
        self,
        name: str,
        color_formats: tuple[str, ...],
        constants: dict[str, float] | None = None,
        entries: tuple[str, str] = ("vertex", "fragment"),
        depth: str = "greater",
    ) -> Raster:
        """The vertex + fragment program of ``shaders/<name>.wgsl`` (see `Raster`)."""
        key = program_key(name, entries, constants, color_formats, depth)
        raster: Raster = self.programs.program(key)
        return raster

    def rasters(
        self,
        wanted: Sequence[
            tuple[str, tuple[str, ...], dict[str, float] | None, tuple[str, str], str]
        ],
    ) -> list[Raster]:
        """Several of them, with the arguments of `raster` for each, compiled side by side."""
        self.programs.begin(program_key(n, e, c, f, d) for n, f, c, e, d in wanted)
        return [self.raster(*one) for one in wanted]

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


_default: Device | None = None
_opening = Lock()


def default_device() -> Device:
    """The process-wide device that ``gs.solve`` and ``gs.render`` use when none is given."""
    global _default
    with _opening:
        if _default is None:
            _default = Device()
        return _default


def device_if_open() -> Device | None:
    """The process-wide device if something has used it already; none is opened for this."""
    return _default
