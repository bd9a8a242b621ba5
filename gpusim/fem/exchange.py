"""Between nodal texels (float32) and float64 buffers: driver of ``shaders/fem/exchange.wgsl``.

The twin is a conversion of type.
"""

from __future__ import annotations

import numpy as np

from gpusim.fem.arena import Allocator
from gpusim.fem.node_texels import node_texels, read_nodes, vector_texels
from gpusim.gpu import Bindings, Device, Recording, compare, twin_check
from gpusim.gpu.buffer import RealBuffer
from gpusim.gpu.texels import Texels

__all__ = ["Exchange"]


class Exchange:
    """Conversions of vectors of ``nodes`` nodes and ``cases`` load cases."""

    def __init__(self, device: Allocator, nodes: int, cases: int) -> None:
        self.device, self.nodes, self.cases = device, nodes, cases
        self._bound: dict[object, Bindings] = {}

    def widen(self, recording: Recording, x: Texels, out: RealBuffer) -> None:
        """Record out = x."""
        self._dispatch(recording, "widen", x_in=x, value_out=out)

    def narrow(self, recording: Recording, value: RealBuffer, out: Texels) -> None:
        """Record out = value, rounded."""
        self._dispatch(recording, "narrow", value_in=value, x_out=out)

    def add(self, recording: Recording, x: Texels, value: RealBuffer, out: Texels) -> None:
        """Record out = x + value, rounded."""
        self._dispatch(recording, "add", x_in=x, value_in=value, x_out=out)

    def _dispatch(self, recording: Recording, entry: str, **vectors: RealBuffer | Texels) -> None:
        kernel = self.device.kernel("fem/exchange", entry=entry)
        key = (entry, *(id(one) for one in vectors.values()))
        if key not in self._bound:
            params = {"nodes": self.nodes, "cases": self.cases}
            self._bound[key] = kernel.bind(**vectors, params=params)
        recording.dispatch(kernel, self._bound[key], threads=(self.nodes * self.cases,))


@twin_check("fem/exchange")
def _check(device: Device) -> None:
    rng = np.random.default_rng(11)
    x, value = rng.normal(size=(2, 2, 70, 3))
    exchange = Exchange(device, 70, 2)
    source, rounded, added = (vector_texels(device, 2, 70, "fem.check.x") for _ in range(3))
    source.write(node_texels(x))
    given = device.real_buffer(value, label="fem.check.value")
    wide = device.real_buffer(np.zeros_like(x), label="fem.check.wide")
    with device.recording("fem.check") as recording:
        exchange.widen(recording, source, wide)
        exchange.narrow(recording, given, rounded)
        exchange.add(recording, source, given, added)
    single = x.astype(np.float32)
    compare("fem/exchange.widen", wide.read(), single.astype(np.float64), "exact")
    compare("fem/exchange.narrow", read_nodes(rounded, 2), value, atol=0.0, rtol=1e-7)
    compare("fem/exchange.add", read_nodes(added, 2), single + value, atol=1e-12, rtol=1e-7)
