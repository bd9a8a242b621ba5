"""Nodal interpolation between levels on the device: driver of
``shaders/fem/device/interpolation.wgsl``.

The twin is ``apply_weights``: a row of weights per node, the same for x, y and z.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_matrix

from gpusim.arrays.array_types import Bool, Float
from gpusim.fem.device.node_texels import Allocator, row_threads
from gpusim.fem.sparse.block_rows import ranges
from gpusim.gpu import Bindings, Recording
from gpusim.gpu.texture_array import Texels


def apply_weights(weights: csr_matrix, free: Bool, v: Float) -> Float:
    """W v for (L,K,3) vectors, zero where not ``free`` (N,3): (L,N,3)."""
    return np.stack([np.where(free, weights @ one, 0.0) for one in v])


class DeviceWeights:
    """Weights (N,K) on the device."""

    def __init__(
        self, device: Allocator, weights: csr_matrix, free: Bool, cases: int, label: str
    ) -> None:
        self.device, self.cases = device, cases
        self.rows, self.columns = (int(n) for n in weights.shape)
        length = np.diff(weights.indptr).astype(np.int64)
        pairs = -(-length // 2)
        start = np.cumsum(pairs) - pairs
        entry = np.zeros((2 * int(pairs.sum()), 2), dtype=np.uint32)
        at = ranges(2 * start, length)
        entry[at, 0] = weights.indices
        entry[at, 1] = weights.data.astype(np.float32).view(np.uint32)
        info = np.zeros((self.rows, 4), dtype=np.uint32)
        info[:, 0], info[:, 1] = start, pairs
        info[:, 2] = free @ np.array([1, 2, 4])
        self._info = device.texels(self.rows, "rgba32uint", f"{label}.info")
        self._weight = device.texels(len(entry) // 2, "rgba32uint", f"{label}.weight")
        self._info.write(info)
        self._weight.write(entry.reshape(-1, 4))
        self._bound: dict[object, Bindings] = {}

    def record(self, recording: Recording, v: Texels, out: Texels, x: Texels | None = None) -> None:
        """Record out = W v, or out = x + W v."""
        kernel = self.device.kernel(
            "fem/device/interpolation", entry="apply" if x is None else "add"
        )
        key = (id(v), id(out), id(x))
        if key not in self._bound:
            more = {} if x is None else {"x_in": x}
            self._bound[key] = kernel.bind(
                info=self._info,
                weight=self._weight,
                v_in=v,
                x_out=out,
                params={"rows": self.rows, "columns": self.columns, "cases": self.cases},
                **more,
            )
        recording.dispatch(kernel, self._bound[key], threads=(row_threads(self.rows, self.cases),))
