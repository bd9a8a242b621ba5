"""Any matrix of 3x3 blocks times a vector on the device, in float64.

The kernel is that of the stiffness (``shaders/fem/device/stiffness.wgsl``), without its
differences. Used for aggregated levels, whose six unknowns per aggregate count as two nodes, for
transfer to them and for the dense inverse at the bottom.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.sparse import bsr_matrix, csr_matrix

from gpusim.fem.assembly.block_rows import BlockRows
from gpusim.fem.device.arena import Allocator
from gpusim.fem.device.block_texels import BlockTexels, block_texels_bytes
from gpusim.fem.device.node_texels import Pair, pair, row_threads
from gpusim.gpu import Bindings, Recording

__all__ = ["DeviceProduct", "product_bytes"]

Long = npt.NDArray[np.int64]


class DeviceProduct:
    """A matrix on the device; both dimensions must be multiples of 3."""

    def __init__(
        self, device: Allocator, matrix: csr_matrix | bsr_matrix, cases: int, label: str
    ) -> None:
        self.device, self.cases, self.label = device, cases, label
        self.rows, self.columns = (int(n) // 3 for n in matrix.shape)
        self._texels = BlockTexels(device, _rows(matrix), 1.0, label, exact=True)
        self._kernel = device.kernel(
            "fem/device/stiffness", entry="apply", constants={"plain": 1.0}
        )
        self._bound: dict[object, list[Bindings]] = {}

    def vector(self) -> Pair:
        """A vector of zeros for the result."""
        return pair(self.device, self.cases, self.rows, f"{self.label}.vector")

    def record(self, recording: Recording, x: Pair, out: Pair) -> None:
        """Record out = A x."""
        key = (id(x.high), id(out.high))
        parts = self._texels.parts
        if key not in self._bound:
            self._bound[key] = [
                self._kernel.bind(
                    info=part.info,
                    neighbour=part.neighbour,
                    blocks=part.blocks,
                    u_high=x.high,
                    u_low=x.second,
                    k_high=out.high,
                    k_low=out.second,
                    params={
                        "count": part.count,
                        "nodes": self.rows,
                        "columns": self.columns,
                        "cases": self.cases,
                        "stride": part.stride,
                        "low": part.low,
                    },
                )
                for part in parts
            ]
        for part, bindings in zip(parts, self._bound[key], strict=True):
            recording.dispatch(
                self._kernel, bindings, threads=(row_threads(part.count, self.cases),)
            )


def product_bytes(matrix: csr_matrix | bsr_matrix) -> int:
    """Bytes that the matrix takes on a device."""
    degree = np.diff(_blocks(matrix).indptr).astype(np.int64)
    return block_texels_bytes(degree, degree, exact=True)


def _blocks(matrix: csr_matrix | bsr_matrix) -> bsr_matrix:
    if matrix.format == "bsr" and matrix.blocksize == (3, 3):
        return matrix
    return bsr_matrix(csr_matrix(matrix), blocksize=(3, 3))


def _rows(matrix: csr_matrix | bsr_matrix) -> BlockRows:
    blocks = _blocks(matrix)
    count = blocks.shape[0] // 3
    start = blocks.indptr.astype(np.int64)
    number = np.arange(count, dtype=np.int32)
    nothing = np.zeros((count, 3, 3))
    neighbour = blocks.indices.astype(np.int32)
    return BlockRows(lambda: (start, neighbour), number, blocks.data, start, nothing, 0)
