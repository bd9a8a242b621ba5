"""The device layer: WGSL programs, buffers, recordings and the check against NumPy twins.

In the order in which data passes:

- `declarations`: Type names of wgpu's C header, read without reading the whole header again for
  each.
- `adapter`: Finding the adapter: Vulkan (or the system's native interface), the fastest first.
- `faults`: What the driver reports, turned into gpusim errors.
- `timing`: Device time per stage from timestamp queries, resolved only when somebody asks.
- `context`: What buffers, textures and programs need of an open device: limits, memory,
  transfers, errors.
- `wgsl`: WGSL as the single source: loading, ``#import``, and reflection of bindings and structs.
- `uniform`: Uniform structs: checked, packed, and written to the device once for all that bind
  them.
- `kernel`: Compute programs and their bindings: compiled once, bound by name, checked once.
- `raster`: Raster programs (vertex + fragment) and the textures that they draw into.
- `priming`: Programs that software drivers have compiled before their first use.
- `programs`: The programs of a device, each compiled once: by who asks for it first, or in a
  thread before.
- `warmup`: The device opened, and programs compiled, before it is known whether they are needed.
- `texture_array`: Long arrays as textures: texel i lies at (i % 4096, i / 4096); a pool of them.
- `buffer`: Device buffers: plain bytes, float64 values stored as ``real``.
- `binding_cache`: Values that many programs bind: bindings are made once for each program, and
  used again.
- `recording`: A recording: dispatches and draws collected in order, sent to the device in one
  submit.
- `device`: The explicit device: buffers, kernels, rasters and recordings of one context.
- `backend`: Where numbers are made when nobody says so: one decision for everything public.
- `twin`: Comparing a kernel with its NumPy twin, and the registry that ``gpusim doctor`` runs.
- `probes`: What a driver does with numbers.
"""

from gpusim.gpu.adapter import software_adapter
from gpusim.gpu.backend import BACKENDS, chosen_backend, working_device
from gpusim.gpu.binding_cache import Bound
from gpusim.gpu.buffer import Buffer, RealBuffer
from gpusim.gpu.context import PORTABLE_LIMITS
from gpusim.gpu.device import Device, default_device
from gpusim.gpu.kernel import Bindings, Kernel
from gpusim.gpu.raster import Raster, Texture
from gpusim.gpu.recording import Recording
from gpusim.gpu.texture_array import Texels
from gpusim.gpu.twin import TOLERANCES, Pair, Pairs, Tolerance, compare, twin_check, twin_checks
from gpusim.gpu.uniform import Uniform

__all__ = [
    "BACKENDS",
    "PORTABLE_LIMITS",
    "TOLERANCES",
    "Bindings",
    "Bound",
    "Buffer",
    "Device",
    "Kernel",
    "Pair",
    "Pairs",
    "Raster",
    "RealBuffer",
    "Recording",
    "Texels",
    "Texture",
    "Tolerance",
    "Uniform",
    "chosen_backend",
    "compare",
    "default_device",
    "software_adapter",
    "twin_check",
    "twin_checks",
    "working_device",
]


def __dir__() -> list[str]:
    return sorted(__all__)
