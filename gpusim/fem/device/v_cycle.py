"""The V-cycle on the device.

Levels with three unknowns a node work in float32, each step of a smoother in one dispatch.
Aggregated levels, a hundred times smaller, and the dense inverse at the bottom stay in float64:
their rotations don't allow the differences that float32 lives on.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gpusim.fem.device.block_texels import BlockTexels, block_texels_bytes, rows_of_matrix
from gpusim.fem.device.interpolation import DeviceWeights
from gpusim.fem.device.linear_combination import DeviceSum
from gpusim.fem.device.node_texels import Allocator, Pair, pair
from gpusim.fem.device.relaxation import (
    ColumnRelaxation,
    DeviceRelaxation,
    column_bytes,
    relaxation,
)
from gpusim.fem.device.stiffness import DeviceProduct, dense_blocks, product_bytes
from gpusim.fem.device.tet_elements import TetTexels
from gpusim.fem.multigrid.column_blocks import Columns
from gpusim.fem.multigrid.hierarchy import Hierarchy, Level
from gpusim.fem.multigrid.smoothers import Relaxation
from gpusim.fem.multigrid.transfer import MatrixTransfer, NodeTransfer
from gpusim.fem.sparse.block_rows import block_diagonal
from gpusim.gpu import Recording
from gpusim.gpu.texture_array import Texels

Steps = tuple[Relaxation, ...]

# what either of two cycles counts where a level is gone through twice
TWICE = 1.5


def compile_kernels(device: Allocator, by_elements: bool) -> None:
    """Compile what a solve runs: half a second at first, which may pass beside other work."""
    directions = {"rounded": 1.0}
    if by_elements:
        for entry in ("straight", "curved", "sums"):
            device.kernel("fem/device/tet_forces", entry=entry, constants=directions)
        for entry in ("straight", "curved"):
            device.kernel("fem/device/tet_forces_single", entry=entry)
        for entry in ("relax", "residual"):
            device.kernel("fem/device/relaxation", entry=f"{entry}_forces")
    device.kernel("fem/device/stiffness", entry="apply", constants=directions)
    for entry in ("begin", "relax", "residual"):
        device.kernel("fem/device/relaxation", entry=entry)
    device.kernel("fem/device/stiffness", entry="apply", constants={"plain": 1.0})
    device.kernel("fem/device/linear_combination", entry="combine")
    for entry in ("apply", "add"):
        device.kernel("fem/device/interpolation", entry=entry)
    for entry in ("dot_pq", "dot_rz", "start", "alpha", "beta", "advance", "turn"):
        device.kernel("fem/krylov/cg", entry=entry)


class DeviceMultigrid:
    """Records z = M^-1 r; ``finest`` is the matrix of the finest level."""

    def __init__(
        self,
        device: Allocator,
        hierarchy: Hierarchy,
        steps: Sequence[Steps],
        finest: BlockTexels | TetTexels,
        cases: int,
    ) -> None:
        below: _NodeLevel | _BlockLevel | DeviceProduct
        inverse = dense_blocks(hierarchy.coarsest.inverse)
        below = DeviceProduct(device, inverse, cases, "fem.multigrid.coarse")
        for number in reversed(range(len(hierarchy.levels))):
            level, label = hierarchy.levels[number], f"fem.multigrid.{number}"
            if level.inverse.shape[1] != 3:
                assert not isinstance(below, _NodeLevel)
                below = _BlockLevel(device, level, steps[number], below, cases, label)
                continue
            texels: BlockTexels | TetTexels = finest
            if number:
                rows = rows_of_matrix(level.product.matrix)
                texels = BlockTexels(device, rows, 1.0, label, exact=False)
            below = _NodeLevel(device, level, steps[number], texels, below, cases, label)
        assert isinstance(below, _NodeLevel)
        self._top = below

    def record(self, recording: Recording, r: Texels, z: Texels) -> None:
        self._top.record(recording, r, z)


def multigrid_bytes(hierarchy: Hierarchy, cases: int) -> int:
    """Bytes that ``DeviceMultigrid`` takes beside the finest matrix; never less."""

    def vectors(count: int, unknowns: int) -> int:
        return count * Texels.footprint(cases * (unknowns // 3 + 1))

    whole = hierarchy.coarsest.unknowns // 3
    total = block_texels_bytes(*2 * [np.full(whole, whole)], exact=True)
    for number, level in enumerate(hierarchy.levels):
        fine, coarse = (int(n) for n in level.transfer.shape)
        if level.inverse.shape[1] == 3:
            # the finest matrix counts as the operator, and may have to be assembled to be looked at
            if number:
                degree = np.diff(level.product.matrix.indptr).astype(np.int64)
                total += block_texels_bytes(degree, degree, exact=False)
            total += Texels.footprint(fine) + vectors(5, fine)
            if isinstance(level.smoother, Columns):
                total += column_bytes(level.smoother.matrix) + vectors(4, fine)
        else:
            total += (
                product_bytes(level.product.matrix)
                + product_bytes(block_diagonal(level.inverse))
                + vectors(20, fine)
            )
        if isinstance(level.transfer, NodeTransfer):
            entries = level.transfer.weights.nnz
            for rows in (fine // 3, coarse // 3):
                total += Texels.footprint(rows) + Texels.footprint((entries + rows) // 2 + 1)
            total += vectors(4, coarse)
        else:
            total += product_bytes(level.transfer.matrix)
            total += product_bytes(level.transfer.transposed)
            total += vectors(4, coarse) + vectors(4, fine)
    return total


class _BlockLevel:
    """An aggregated level: six unknowns a node, float64."""

    def __init__(
        self,
        device: Allocator,
        level: Level,
        steps: Steps,
        below: _BlockLevel | DeviceProduct,
        cases: int,
        label: str,
    ) -> None:
        matrix = level.product.matrix
        self._steps = steps
        self._matrix = DeviceProduct(device, matrix, cases, f"{label}.matrix")
        self._inverse = DeviceProduct(
            device, block_diagonal(level.inverse), cases, f"{label}.inverse"
        )
        self._sum = DeviceSum(device, self._matrix.rows, cases)
        self._right, self._product, self._scaled = (self._matrix.vector() for _ in range(3))
        self._vectors = [self._matrix.vector() for _ in range(3)]
        self._twice = level.twice
        self._once, self._left, self._again = (self._matrix.vector() for _ in range(3))
        assert isinstance(level.transfer, MatrixTransfer)
        self._below = _ByMatrix(device, level.transfer, below, cases, label)

    def record(self, recording: Recording, b: Pair, out: Pair) -> None:
        """Record out = t V b + t V (b - A t V b) with the V-cycle V, or out = V b."""
        if not self._twice:
            self._cycle(recording, b, out)
            return
        self._cycle(recording, b, self._once)
        self._matrix.record(recording, self._once, self._product)
        self._sum.record(recording, self._left, right=(1.0, b), product=(-TWICE, self._product))
        self._cycle(recording, self._left, self._again)
        self._sum.record(recording, out, x=(TWICE, self._once), right=(TWICE, self._again))

    def _cycle(self, recording: Recording, b: Pair, out: Pair) -> None:
        """Record out = V b."""
        self._inverse.record(recording, b, self._right)
        now, before, following = self._vectors
        self._sum.record(recording, now, right=(self._steps[0].gain, self._right))
        last: Pair | None = None
        for step in self._steps[1:]:
            self._relax(recording, now, last, step, following)
            last, now, before, following = now, following, now, before
        self._matrix.record(recording, now, self._product)
        self._sum.record(recording, before, right=(1.0, b), product=(-1.0, self._product))
        self._below.record(recording, before, now, following)
        before, now, following = now, following, before
        last = None
        for number, step in enumerate(self._steps):
            target = out if number == len(self._steps) - 1 else following
            self._relax(recording, now, last, step, target)
            last, now, before, following = now, following, now, before

    def _relax(
        self, recording: Recording, x: Pair, before: Pair | None, step: Relaxation, out: Pair
    ) -> None:
        """Record out = x + keep (x - before) + gain D^-1 (b - A x)."""
        self._matrix.record(recording, x, self._product)
        self._inverse.record(recording, self._product, self._scaled)
        terms = {
            "x": (1.0 + step.keep, x),
            "right": (step.gain, self._right),
            "product": (-step.gain, self._scaled),
        }
        if before is not None:
            terms["before"] = (-step.keep, before)
        self._sum.record(recording, out, **terms)


class _NodeLevel:
    """Three unknowns a node, float32."""

    def __init__(
        self,
        device: Allocator,
        level: Level,
        steps: Steps,
        texels: BlockTexels | TetTexels,
        below: _NodeLevel | _BlockLevel | DeviceProduct,
        cases: int,
        label: str,
    ) -> None:
        self._steps = steps
        self._smoother: DeviceRelaxation | ColumnRelaxation
        self._smoother = relaxation(device, texels, level.inverse, cases, label)
        if isinstance(level.smoother, Columns):
            self._smoother = ColumnRelaxation(
                device, self._smoother, level.smoother.matrix, level.inverse, cases, label
            )
        # what a step reads it can't write: now, before and next
        self._vectors = [self._smoother.vector(f"{label}.x") for _ in range(3)]
        # halves that a pair has and float32 lacks: one of zeros, one that nobody reads
        self._zero, self._spare = (self._smoother.vector(f"{label}.low") for _ in range(2))
        self._below: _ByWeights | _ByMatrix
        if isinstance(level.transfer, NodeTransfer):
            assert not isinstance(below, _BlockLevel)
            self._below = _ByWeights(device, level.transfer, below, cases, label)
        else:
            assert not isinstance(below, _NodeLevel)
            self._below = _ByMatrix(device, level.transfer, below, cases, label)

    def record(self, recording: Recording, b: Texels, z: Texels) -> None:
        """Record z = (V-cycle) b."""
        now, before, following = self._vectors
        self._smoother.begin(recording, b, now, self._steps[0].gain)
        last: Texels | None = None
        for step in self._steps[1:]:
            self._smoother.relax(recording, now, last, b, step, following)
            last, now, before, following = now, following, now, before
        self._smoother.residual(recording, now, b, before)
        if isinstance(self._below, _ByWeights):
            self._below.record(recording, before, now, following)
        else:
            self._below.record(
                recording,
                Pair(before, self._zero),
                Pair(now, self._zero),
                Pair(following, self._spare),
            )
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
        below: _NodeLevel | DeviceProduct,
        cases: int,
        label: str,
    ) -> None:
        coarse = int(transfer.shape[1]) // 3
        self._restriction = DeviceWeights(
            device, transfer.weights.T.tocsr(), transfer.coarse_free, cases, f"{label}.restriction"
        )
        self._prolongation = DeviceWeights(
            device, transfer.weights, transfer.free, cases, f"{label}.prolongation"
        )
        self._b, self._x = (pair(device, cases, coarse, f"{label}.coarse_{n}") for n in "bx")
        self._level = below

    def record(self, recording: Recording, r: Texels, x: Texels, out: Texels) -> None:
        """Record out = x + P (below) P^T r."""
        self._restriction.record(recording, r, self._b.high)
        if isinstance(self._level, DeviceProduct):
            # low halves are zero going down, and below float32 coming up
            self._level.record(recording, self._b, self._x)
        else:
            self._level.record(recording, self._b.high, self._x.high)
        self._prolongation.record(recording, self._x.high, out, x)


class _ByMatrix:
    """The correction of an aggregated level."""

    def __init__(
        self,
        device: Allocator,
        transfer: MatrixTransfer,
        below: _BlockLevel | DeviceProduct,
        cases: int,
        label: str,
    ) -> None:
        restriction, prolongation = f"{label}.restriction", f"{label}.prolongation"
        self._restriction = DeviceProduct(device, transfer.transposed, cases, restriction)
        self._prolongation = DeviceProduct(device, transfer.matrix, cases, prolongation)
        self._sum = DeviceSum(device, self._prolongation.rows, cases)
        self._fine = self._prolongation.vector()
        self._b, self._x = self._restriction.vector(), self._restriction.vector()
        self._level = below

    def record(self, recording: Recording, r: Pair, x: Pair, out: Pair) -> None:
        """Record out = x + P (below) P^T r."""
        self._restriction.record(recording, r, self._b)
        self._level.record(recording, self._b, self._x)
        self._prolongation.record(recording, self._x, self._fine)
        self._sum.record(recording, out, x=(1.0, x), product=(1.0, self._fine))
