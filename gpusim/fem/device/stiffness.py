"""The stiffness operator y = K u: kernel driver of ``shaders/fem/device/stiffness.wgsl``; the
twin is `gpusim.fem.sparse.stiffness_product`.

K is held as distinct block rows (see ``block_rows``), on the device as texels (``block_texels``).
K is a sum of two float32 there, 48 bits, and so is u, unless it is rounded; the arithmetic is
float64 or double-single. Without its differences the same kernel multiplies by any matrix of 3x3
blocks (``DeviceProduct``): aggregated levels, whose six unknowns per aggregate count as two nodes,
transfer to them and the dense inverse at the bottom.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import bsr_matrix

from gpusim.arrays.array_types import Float
from gpusim.fem.device.block_texels import BlockTexels, RowPart, block_texels_bytes
from gpusim.fem.device.node_texels import Allocator, Pair, pair, row_threads
from gpusim.fem.sparse.block_rows import BlockRows
from gpusim.gpu import Bindings, Kernel, Recording


class RowsOnDevice:
    """Rows of blocks in ``texels`` that are multiplied by vectors of ``columns`` nodes."""

    def __init__(
        self, device: Allocator, texels: BlockTexels, columns: int, cases: int, plain: bool
    ) -> None:
        self.device, self.cases, self.texels = device, cases, texels
        self._columns, self._plain = columns, plain
        self._bound: dict[tuple[int, int], list[Bindings]] = {}

    def record(self, recording: Recording, x: Pair, out: Pair) -> None:
        """Record out = A x; ``out`` not rounded."""
        constants = {"plain": 1.0} if self._plain else {"rounded": float(x.rounded)}
        kernel = self.device.kernel("fem/device/stiffness", entry="apply", constants=constants)
        key = (id(x.high), id(out.high))
        if key not in self._bound:
            self._bound[key] = [self._bind(kernel, part, x, out) for part in self.texels.parts]
        for part, bindings in zip(self.texels.parts, self._bound[key], strict=True):
            recording.dispatch(kernel, bindings, threads=(row_threads(part.count, self.cases),))

    def _bind(self, kernel: Kernel, part: RowPart, x: Pair, out: Pair) -> Bindings:
        return kernel.bind(
            info=part.info,
            neighbour=part.neighbour,
            blocks=part.blocks,
            u_high=x.high,
            u_low=x.second,
            k_high=out.high,
            k_low=out.second,
            params={
                "count": part.count,
                "nodes": self.texels.nodes,
                "columns": self._columns,
                "cases": self.cases,
                "stride": part.stride,
                "low": part.low,
            },
        )


class DeviceProduct(RowsOnDevice):
    """A matrix on the device, in blocks whose sides are multiples of 3."""

    def __init__(self, device: Allocator, matrix: bsr_matrix, cases: int, label: str) -> None:
        self.rows, columns = (int(n) // 3 for n in matrix.shape)
        texels = BlockTexels(device, _split_rows(matrix), 1.0, label, exact=True)
        super().__init__(device, texels, columns, cases, plain=True)
        self._label = f"{label}.vector"

    def vector(self) -> Pair:
        """A vector of zeros for the result."""
        return pair(self.device, self.cases, self.rows, self._label)


def product_bytes(matrix: bsr_matrix) -> int:
    """Bytes that the matrix takes on a device."""
    high, wide = (size // 3 for size in matrix.blocksize)
    degree = np.repeat(wide * np.diff(matrix.indptr).astype(np.int64), high)
    return block_texels_bytes(degree, degree, exact=True)


def dense_blocks(matrix: Float) -> bsr_matrix:
    """A dense matrix in blocks of 3x3."""
    rows, columns = (n // 3 for n in matrix.shape)
    data = matrix.reshape(rows, 3, columns, 3).transpose(0, 2, 1, 3).reshape(-1, 3, 3)
    start = columns * np.arange(rows + 1)
    return bsr_matrix((data, np.tile(np.arange(columns), rows), start), shape=matrix.shape)


def _split_rows(matrix: bsr_matrix) -> BlockRows:
    """Rows of 3x3 blocks; the matrix's own may be larger."""
    high, wide = (size // 3 for size in matrix.blocksize)
    degree = np.repeat(wide * np.diff(matrix.indptr).astype(np.int64), high)
    start = np.concatenate([[0], np.cumsum(degree)])
    blocks, neighbour = matrix.data, matrix.indices.astype(np.int32)
    if high > 1 or wide > 1:
        # (block, row, column): a block's rows lie as far apart as their lengths
        owner = np.repeat(np.arange(len(matrix.indptr) - 1), np.diff(matrix.indptr))
        within = wide * (np.arange(len(owner)) - matrix.indptr[owner])
        into = (start[high * owner] + within)[:, None, None] + np.arange(wide)
        into = into + (np.arange(high) * degree[high * owner, None])[:, :, None]
        blocks = np.empty((int(start[-1]), 3, 3))
        split = matrix.data.reshape(-1, high, 3, wide, 3).transpose(0, 1, 3, 2, 4)
        blocks[into] = split
        number = wide * matrix.indices.astype(np.int32)[:, None, None] + np.arange(wide)
        neighbour = np.empty(len(blocks), dtype=np.int32)
        neighbour[into] = number
    rows = np.arange(len(degree), dtype=np.int32)
    nothing = np.zeros((len(degree), 3, 3))
    return BlockRows(lambda: (start, neighbour), rows, blocks, start, nothing, 0)


class DeviceStiffness(RowsOnDevice):
    """K on the device, divided by ``scale``; ``texels`` are its blocks, which others may share."""

    def __init__(self, device: Allocator, rows: BlockRows, scale: float, cases: int) -> None:
        self.nodes = rows.node_count
        texels = BlockTexels(device, rows, scale, "fem.stiffness", exact=True)
        super().__init__(device, texels, self.nodes, cases, plain=False)

    def vector(self, u: Float, *, rounded: bool = False) -> Pair:
        """Float64 values (L,N,3) in the form that ``record`` takes and, not ``rounded``, gives."""
        result = pair(self.device, len(u), self.nodes, "fem.stiffness.u", rounded=rounded)
        result.write(u)
        return result
