"""The device layer: WGSL programs, buffers, recordings and the check against NumPy twins."""

from gpusim.gpu.adapter import software_adapter
from gpusim.gpu.backend import BACKENDS, chosen_backend, working_device
from gpusim.gpu.bound import Bound
from gpusim.gpu.buffer import Buffer, RealBuffer, SplitBuffer
from gpusim.gpu.device import PORTABLE_LIMITS, Device, default_device
from gpusim.gpu.kernel import Bindings, Kernel
from gpusim.gpu.raster import Raster, Texture
from gpusim.gpu.recording import Recording
from gpusim.gpu.texels import Texels
from gpusim.gpu.twin import TOLERANCES, Tolerance, compare, twin_check, twin_checks
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
    "Raster",
    "RealBuffer",
    "Recording",
    "SplitBuffer",
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
