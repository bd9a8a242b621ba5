"""The V-cycle on the device.

Levels with three unknowns a node work on texels in float32, each step of a smoother in one
dispatch. Aggregated levels, a hundred times smaller, and the dense inverse at the bottom stay in
float64 buffers.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.sparse import csr_matrix

from gpusim.fem.arena import Allocator
from gpusim.fem.block_texels import BlockTexels, block_texels_bytes, rows_of_matrix
from gpusim.fem.exchange import Exchange
from gpusim.fem.hierarchy import Hierarchy, Level
from gpusim.fem.node_texels import vector_texels
from gpusim.fem.relax import DeviceRelaxation
from gpusim.fem.smooth import DeviceSmoother, Relaxation
from gpusim.fem.sparse import DeviceSparse
from gpusim.fem.spread import DeviceWeights
from gpusim.fem.transfer import MatrixTransfer, NodeTransfer
from gpusim.gpu import Recording
from gpusim.gpu.buffer import RealBuffer
from gpusim.gpu.texels import Texels

__all__ = ["DeviceMultigrid", "multigrid_bytes"]

Steps = tuple[Relaxation, ...]


class DeviceMultigrid:
    """Records z = M^-1 r; ``finest`` are the blocks of the finest level."""

    def __init__(
        self,
        device: Allocator,
        hierarchy: Hierarchy,
        steps: Sequence[Steps],
        finest: BlockTexels,
        cases: int,
    ) -> None:
        below: _NodeLevel | _NodeBottom | _BlockLevel | _Bottom
        below = _Bottom(device, hierarchy, cases)
        if isinstance(hierarchy.levels[-1].transfer, NodeTransfer):
            below = _NodeBottom(device, below, len(hierarchy.coarse_inverse) // 3, cases)
        for number in reversed(range(len(hierarchy.levels))):
            level, label = hierarchy.levels[number], f"fem.multigrid.{number}"
            if level.inverse.shape[1] != 3:
                assert isinstance(below, _BlockLevel | _Bottom)
                below = _BlockLevel(device, level, steps[number], below, cases, label)
                continue
            texels = finest
            if number:
                rows = rows_of_matrix(level.product.matrix)
                free = np.einsum("nii->ni", level.inverse) != 0.0
                texels = BlockTexels(device, rows, free, 1.0, label, exact=False)
            below = _NodeLevel(device, level, steps[number], texels, below, cases, label)
        assert isinstance(below, _NodeLevel)
        self._top = below

    def record(self, recording: Recording, r: Texels, z: Texels) -> None:
        self._top.record(recording, r, z)


def multigrid_bytes(hierarchy: Hierarchy, cases: int) -> int:
    """Bytes that ``DeviceMultigrid`` takes beside the finest matrix; never less."""
    size = len(hierarchy.coarse_inverse)
    total = _sparse_bytes(size * size, size) + 16 * cases * size
    for number, level in enumerate(hierarchy.levels):
        fine, coarse = level.transfer.shape
        matrix = level.product.matrix
        if level.inverse.shape[1] == 3:
            degree = np.diff(matrix.indptr).astype(np.int64)
            if number:
                total += block_texels_bytes(degree, degree, exact=False)
            total += Texels.footprint(fine) + 5 * Texels.footprint(cases * (fine // 3 + 1))
        else:
            total += _sparse_bytes(matrix.nnz, fine) + 8 * fine * (6 + 4 * cases)
        if isinstance(level.transfer, NodeTransfer):
            entries = level.transfer.weights.nnz
            for rows in (fine // 3, coarse // 3):
                total += Texels.footprint(rows) + Texels.footprint((entries + rows) // 2 + 1)
                total += Texels.footprint(cases * (rows + 1))
        else:
            entries = level.transfer.matrix().nnz
            total += _sparse_bytes(entries, fine) + _sparse_bytes(entries, coarse)
            total += 8 * cases * (fine + 2 * coarse)
    return total


def _sparse_bytes(entries: int, rows: int) -> int:
    # slices of eight block rows are padded to the longest
    return 12 * entries + 24 * rows


class _Bottom:
    """The dense inverse."""

    def __init__(self, device: Allocator, hierarchy: Hierarchy, cases: int) -> None:
        self._inverse = DeviceSparse(
            device, csr_matrix(hierarchy.coarse_inverse), cases, "fem.multigrid.coarse"
        )

    def record(self, recording: Recording, b: RealBuffer, x: RealBuffer) -> None:
        self._inverse.record(recording, b, x)


class _NodeBottom:
    """The dense inverse between texels."""

    def __init__(self, device: Allocator, bottom: _Bottom, nodes: int, cases: int) -> None:
        self.device, self.nodes, self.cases = device, nodes, cases
        self._bottom, self._exchange = bottom, Exchange(device, nodes, cases)
        zeros = np.zeros((cases, 3 * nodes))
        self._b, self._x = (
            device.real_buffer(zeros, label=f"fem.multigrid.coarse.{name}") for name in "bx"
        )

    def vector(self, label: str) -> Texels:
        """A vector of zeros."""
        return vector_texels(self.device, self.cases, self.nodes, label)

    def record(self, recording: Recording, b: Texels, x: Texels) -> None:
        self._exchange.widen(recording, b, self._b)
        self._bottom.record(recording, self._b, self._x)
        self._exchange.narrow(recording, self._x, x)


class _BlockLevel:
    """An aggregated level: six unknowns a node, float64."""

    def __init__(
        self,
        device: Allocator,
        level: Level,
        steps: Steps,
        below: _BlockLevel | _Bottom,
        cases: int,
        label: str,
    ) -> None:
        transfer = level.transfer.matrix()
        fine, coarse = (np.zeros((cases, int(n))) for n in transfer.shape)
        self._steps, self._below = steps, below
        self._operator = DeviceSparse(
            device, csr_matrix(level.product.matrix), cases, f"{label}.matrix"
        )
        self._smoother = DeviceSmoother(device, level.inverse, cases, label)
        self._restriction = DeviceSparse(device, transfer.T.tocsr(), cases, f"{label}.restriction")
        self._prolongation = DeviceSparse(device, transfer, cases, f"{label}.prolongation")
        self._residuals = tuple(device.real_buffer(fine, f"{label}.{name}") for name in "rs")
        self._product = device.real_buffer(fine, f"{label}.product")
        self._change = device.real_buffer(fine, f"{label}.change")
        self._coarse = tuple(device.real_buffer(coarse, f"{label}.{name}") for name in "bx")

    def record(self, recording: Recording, b: RealBuffer, x: RealBuffer) -> None:
        first = self._steps[0]
        steps = (Relaxation(first.keep, first.gain, 0.0), *self._steps[1:])
        r, spare = self._smooth(recording, b, None, x, steps)
        self._operator.record(recording, self._change, self._product)
        self._smoother.record_difference(recording, r, self._product, spare)
        self._restriction.record(recording, spare, self._coarse[0])
        self._below.record(recording, *self._coarse)
        self._prolongation.record(recording, self._coarse[1], x, add=True)
        self._operator.record(recording, x, self._product)
        self._smooth(recording, b, self._product, x, self._steps)

    def _smooth(
        self, recording: Recording, b: RealBuffer, t: RealBuffer | None, x: RealBuffer, steps: Steps
    ) -> tuple[RealBuffer, RealBuffer]:
        """Returns the buffers with the residual and without."""
        one, two = self._residuals
        self._smoother.record(recording, b, t, one, self._change, x, steps[0])
        for step in steps[1:]:
            self._operator.record(recording, self._change, self._product)
            self._smoother.record(recording, one, self._product, two, self._change, x, step)
            one, two = two, one
        return one, two


class _NodeLevel:
    """Three unknowns a node, float32."""

    def __init__(
        self,
        device: Allocator,
        level: Level,
        steps: Steps,
        texels: BlockTexels,
        below: _NodeLevel | _NodeBottom | _BlockLevel | _Bottom,
        cases: int,
        label: str,
    ) -> None:
        self._steps = steps
        self._smoother = DeviceRelaxation(device, texels, level.inverse, cases, label)
        # what a step reads it can't write: now, before and next
        self._vectors = [self._smoother.vector(f"{label}.x") for _ in range(3)]
        self._below: _ByWeights | _ByMatrix
        if isinstance(level.transfer, NodeTransfer):
            assert isinstance(below, _NodeLevel | _NodeBottom)
            self._below = _ByWeights(device, level.transfer, below, cases, label)
        else:
            assert isinstance(below, _BlockLevel | _Bottom)
            self._below = _ByMatrix(device, level.transfer, below, cases, label)

    def vector(self, label: str) -> Texels:
        return self._smoother.vector(label)

    def record(self, recording: Recording, b: Texels, z: Texels) -> None:
        """Record z = (V-cycle) b."""
        now, before, following = self._vectors
        self._smoother.begin(recording, b, now, self._steps[0].gain)
        last: Texels | None = None
        for step in self._steps[1:]:
            self._smoother.relax(recording, now, last, b, step, following)
            last, now, before, following = now, following, now, before
        self._smoother.residual(recording, now, b, before)
        self._below.record(recording, before, now, following)
        before, now, following = now, following, before
        last = None
        for number, step in enumerate(self._steps):
            out = z if number == len(self._steps) - 1 else following
            self._smoother.relax(recording, now, last, b, step, out)
            last, now, before, following = now, following, now, before


class _ByWeights:
    """The correction of a level whose nodes interpolate."""

    def __init__(
        self,
        device: Allocator,
        transfer: NodeTransfer,
        below: _NodeLevel | _NodeBottom,
        cases: int,
        label: str,
    ) -> None:
        self._restriction = DeviceWeights(
            device, transfer.weights.T.tocsr(), transfer.coarse_free, cases, f"{label}.restriction"
        )
        self._prolongation = DeviceWeights(
            device, transfer.weights, transfer.free, cases, f"{label}.prolongation"
        )
        self._b, self._x = below.vector(f"{label}.coarse_b"), below.vector(f"{label}.coarse_x")
        self._level = below

    def record(self, recording: Recording, r: Texels, x: Texels, out: Texels) -> None:
        """Record out = x + P (below) P^T r."""
        self._restriction.record(recording, r, self._b)
        self._level.record(recording, self._b, self._x)
        self._prolongation.record(recording, self._x, out, x)


class _ByMatrix:
    """The correction of an aggregated level."""

    def __init__(
        self,
        device: Allocator,
        transfer: MatrixTransfer,
        below: _BlockLevel | _Bottom,
        cases: int,
        label: str,
    ) -> None:
        matrix = transfer.matrix()
        fine, coarse = (np.zeros((cases, int(n))) for n in matrix.shape)
        self._restriction = DeviceSparse(device, matrix.T.tocsr(), cases, f"{label}.restriction")
        self._prolongation = DeviceSparse(device, matrix, cases, f"{label}.prolongation")
        self._exchange = Exchange(device, matrix.shape[0] // 3, cases)
        self._fine = device.real_buffer(fine, label=f"{label}.fine")
        self._b, self._x = (device.real_buffer(coarse, label=f"{label}.{name}") for name in "bx")
        self._level = below

    def record(self, recording: Recording, r: Texels, x: Texels, out: Texels) -> None:
        """Record out = x + P (below) P^T r."""
        self._exchange.widen(recording, r, self._fine)
        self._restriction.record(recording, self._fine, self._b)
        self._level.record(recording, self._b, self._x)
        self._prolongation.record(recording, self._x, self._fine)
        self._exchange.add(recording, x, self._fine, out)
