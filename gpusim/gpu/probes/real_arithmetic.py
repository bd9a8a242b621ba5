"""Arithmetic in ``real``: the probe that shows whether a driver keeps 64-bit or double-single."""

from __future__ import annotations

import numpy as np

from gpusim.arrays.array_types import Float
from gpusim.gpu.device import Device
from gpusim.gpu.twin import Pair, Pairs, Tolerance, twin_check

_OPERATIONS = 6


def real_probe(device: Device, a: Float, b: Float) -> Float:
    """a+b, a-b, a*b, a/b, a*b+a, sqrt|a| on the device; (6, n) float64 from two (n,) arrays."""
    kernel = device.kernel("gpu/probes/real_arithmetic")
    out = device.real_buffer(np.zeros((_OPERATIONS, len(a))), "real.out")
    bindings = kernel.bind(
        a=device.real_buffer(a, "real.a"),
        b=device.real_buffer(b, "real.b"),
        result=out,
        params={"count": len(a)},
    )
    with device.recording("gpu.real") as recording:
        recording.dispatch(kernel, bindings, threads=(len(a),))
    return out.read()


def real_probe_twin(a: Float, b: Float) -> Float:
    """The same in NumPy float64."""
    return np.stack([a + b, a - b, a * b, a / b, a * b + a, np.sqrt(np.abs(a))])


@twin_check("gpu/probes/real_arithmetic")
def _check(device: Device) -> Pairs:
    rng = np.random.default_rng(11)
    a = rng.normal(size=300) * 10.0 ** rng.integers(-3, 4, 300)
    b = np.where(rng.random(300) < 0.5, rng.normal(size=300), -a * (1 + 1e-9 * rng.random(300)))
    scale = np.abs(a) + np.abs(b) + np.abs(a * b) + np.abs(a / b) + 1.0
    unit = 1e-15 if device.real == "f64" else 2e-13
    cancelling = Tolerance(unit, 0.0, "sums cancel on purpose: in units of the operands")
    yield Pair(real_probe(device, a, b) / scale, real_probe_twin(a, b) / scale, cancelling)
