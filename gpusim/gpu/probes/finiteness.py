"""NaN and infinity on the device: the probe that shows whether a driver lets them be seen."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from gpusim.arrays.array_types import Float, Single
from gpusim.gpu.device import Device
from gpusim.gpu.twin import Pair, Pairs, twin_check

_SCALE = 4.0


def finite_probe(device: Device, single: Single, wide: Float) -> npt.NDArray[np.uint32]:
    """Flags (n,) for two (n,) arrays: 1 if ``4 single`` is finite, 2 if ``wide`` is, 4 if
    ``4 wide`` is. Unlike `Device.real_buffer`, it takes NaN and infinity."""
    if device.real == "f64":
        stored = wide.view(np.uint32)
    else:
        with np.errstate(over="ignore"):
            high = wide.astype(np.float32)
        low = np.where(np.isfinite(high), wide - np.where(np.isfinite(high), high, 0.0), 0.0)
        stored = np.stack([high, low.astype(np.float32)], axis=-1)
    flags = device.empty(4 * len(single), "finite.flags")
    kernel = device.kernel("gpu/probes/finiteness")
    bindings = kernel.bind(
        single=device.buffer(single, "finite.single"),
        wide=device.buffer(stored, "finite.wide"),
        flags=flags,
        params={"count": len(single), "scale": _SCALE},
    )
    with device.recording("gpu.finite") as recording:
        recording.dispatch(kernel, bindings, threads=(len(single),))
    return flags.read(np.uint32)


def finite_probe_twin(single: Single, wide: Float, real: str) -> npt.NDArray[np.uint32]:
    """The same in NumPy; ``real`` decides the range of ``wide``."""
    kind = np.dtype(np.float64 if real == "f64" else np.float32)
    with np.errstate(over="ignore", invalid="ignore"):
        stored = wide.astype(kind)
        finite = (
            np.isfinite(single * np.float32(_SCALE)),
            np.isfinite(stored),
            np.isfinite(np.multiply(stored, _SCALE, dtype=kind)),
        )
    return np.asarray(sum(flag.astype(np.uint32) << i for i, flag in enumerate(finite)), np.uint32)


@twin_check("gpu/probes/finiteness", "exact")
def _check(device: Device) -> Pairs:
    big = 1e308 if device.real == "f64" else 1e38
    wide = np.array([0.0, -0.0, 1.0, -3e33, big, -big, np.nan, -np.nan, np.inf, -np.inf, 1e-30])
    single = np.array([1e38, 0, np.nan, 3e38, -np.inf, 5, -1e38, np.inf, 1e-45, -1, -np.nan])
    single = single.astype(np.float32)
    twin = finite_probe_twin(single, wide, device.real)
    yield Pair(finite_probe(device, single, wide), twin)
