"""Sums of vectors on the device: twin and driver of
``shaders/fem/device/linear_combination.wgsl``."""

from __future__ import annotations

import numpy as np

from gpusim.arrays.array_types import Float
from gpusim.fem.device.node_texels import Allocator, Pair
from gpusim.gpu import Bindings, Recording

# the order in which the kernel takes and adds them
_NAMES = ("x", "before", "right", "product")


def weighted_sum(terms: dict[str, tuple[float, Float]]) -> Float:
    """Sum of factor times vector; factors are rounded to float32, as the kernel takes them."""
    return np.asarray(sum(float(np.float32(factor)) * value for factor, value in terms.values()))


class DeviceSum:
    """Sums of up to four vectors of ``nodes`` nodes and ``cases`` load cases, in float64."""

    def __init__(self, device: Allocator, nodes: int, cases: int) -> None:
        self.device, self.texels = device, cases * (nodes + 1)
        self._kernel = device.kernel("fem/device/linear_combination", entry="combine")
        self._bound: dict[object, Bindings] = {}

    def record(self, recording: Recording, out: Pair, **terms: tuple[float, Pair]) -> None:
        """Record out = sum of factor times vector; terms x, before, right, product."""
        any_vector = next(iter(terms.values()))[1]
        full = {name: terms.get(name, (0.0, any_vector)) for name in _NAMES}
        key = (id(out.high), *((factor, id(one.high)) for factor, one in full.values()))
        if key not in self._bound:
            vectors = {"out_high": out.high, "out_low": out.second}
            for name, (_, one) in full.items():
                vectors |= {f"{name}_high": one.high, f"{name}_low": one.second}
            factors = {name: factor for name, (factor, _) in full.items()}
            params = {"count": self.texels, **factors}
            self._bound[key] = self._kernel.bind(**vectors, params=params)
        recording.dispatch(self._kernel, self._bound[key], threads=(self.texels,))
