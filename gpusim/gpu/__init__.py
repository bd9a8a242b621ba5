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

from gpusim.gpu.adapter import software_adapter as software_adapter
from gpusim.gpu.backend import BACKENDS as BACKENDS
from gpusim.gpu.backend import chosen_backend as chosen_backend
from gpusim.gpu.backend import working_device as working_device
from gpusim.gpu.binding_cache import Bound as Bound
from gpusim.gpu.buffer import Buffer as Buffer
from gpusim.gpu.buffer import RealBuffer as RealBuffer
from gpusim.gpu.context import PORTABLE_LIMITS as PORTABLE_LIMITS
from gpusim.gpu.device import Device as Device
from gpusim.gpu.device import default_device as default_device
from gpusim.gpu.kernel import Bindings as Bindings
from gpusim.gpu.kernel import Kernel as Kernel
from gpusim.gpu.raster import Raster as Raster
from gpusim.gpu.raster import Texture as Texture
from gpusim.gpu.recording import Recording as Recording
from gpusim.gpu.texture_array import Texels as Texels
from gpusim.gpu.twin import TOLERANCES as TOLERANCES
from gpusim.gpu.twin import Pair as Pair
from gpusim.gpu.twin import Pairs as Pairs
from gpusim.gpu.twin import Tolerance as Tolerance
from gpusim.gpu.twin import compare as compare
from gpusim.gpu.twin import twin_check as twin_check
from gpusim.gpu.twin import twin_checks as twin_checks
from gpusim.gpu.uniform import Uniform as Uniform
from gpusim.public_names import public_names as _public_names

__all__, __getattr__, __dir__ = _public_names(__name__)
