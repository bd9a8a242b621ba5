"""The preconditioner: a multigrid V-cycle over a hierarchy of levels."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Any

import numpy as np

from gpusim.arrays.array_types import Float, Real
from gpusim.fem.device.node_texels import Allocator
from gpusim.fem.device.tet_forces import DeviceOperator
from gpusim.fem.device.v_cycle import TWICE, DeviceMultigrid, multigrid_bytes
from gpusim.fem.krylov.cg import Preconditioner, dot
from gpusim.fem.lattice.stencil import StencilProduct
from gpusim.fem.multigrid.column_blocks import Columns
from gpusim.fem.multigrid.hierarchy import Hierarchy
from gpusim.fem.multigrid.smoothers import BlockJacobi
from gpusim.fem.sparse.matrix_product import Product

# rounding in float32 over the least eigenvalue from which on float64 is used
_FELT = 0.1
# ratio of stiffnesses beyond which soft parts may be felt worse than the least eigenvalue tells
_EVEN = 1e3


class Multigrid(Preconditioner):
    """One symmetric cycle: Chebyshev smoothing before and after, dense inverse at the bottom.

    Aggregated levels are gone through twice (Axelsson & Vassilevski, Numer. Math. 56 (1989) 157):
    with the V-cycle V of a level, I - t V A once more brings its spectrum from (0, 1] to
    1 - (1 - t x)^2, positive for t < 2, and small values to 2 t times as much.
    """

    def __init__(self, hierarchy: Hierarchy) -> None:
        self.hierarchy = hierarchy
        self._smoothers: dict[int, BlockJacobi | Columns] = {}
        # what ``down`` of a load case leaves for ``up``
        self._begun: dict[int, tuple[Float, Float]] = {}

    @property
    def lowest(self) -> float:
        """The hierarchy's estimate of the least eigenvalue of K."""
        return self.hierarchy.lowest

    @property
    def product(self) -> Product | StencilProduct:
        """x (L,3N) -> K x on the finest level."""
        return self.hierarchy.levels[0].product

    def apply(self, r: Float) -> Float:
        """z = M^-1 r for (L,3N) r."""
        return np.asarray(self._cycle(0, r.astype(self._dtype)), dtype=np.float64)

    def down(self, r: Float, cases: Sequence[int]) -> Float:
        """r.z (L,) for (L,3N) r of some load cases, whose z ``up`` gives then; whoever stops by
        r.z needs no more.

        With the smoothed x = S r, S symmetric, its residual y and x' = x + P c after the coarser
        levels, z = x' + S (r - A x') makes r.z = r.x + y.x'.
        """
        r = r.astype(self._dtype)
        smoothed, residual, corrected = self._down(0, r)
        for case, one, x in zip(cases, r, corrected, strict=True):
            self._begun[case] = one, x
        return dot(r, smoothed) + dot(residual, corrected)

    def up(self, cases: Sequence[int]) -> Float:
        """z (L,3N) of the load cases of ``down``."""
        b, x = (np.stack(parts) for parts in zip(*map(self._begun.pop, cases), strict=True))
        return np.asarray(self._up(0, b, x), dtype=np.float64)

    def _cycle(self, number: int, b: Real) -> Real:
        if number == len(self.hierarchy.levels):
            return self.hierarchy.coarsest.solve(b)
        level = self.hierarchy.levels[number]
        if not isinstance(level.product, StencilProduct):
            b = np.asarray(b, dtype=np.float64)
        x = self._up(number, b, self._down(number, b)[2])
        if level.twice:
            x *= TWICE
            b = b - level.product(x)
            x += TWICE * self._up(number, b, self._down(number, b)[2])
        return x

    def _down(self, number: int, b: Real) -> tuple[Real, Real, Real]:
        """The smoothed x, its residual, and x with what coarser levels add."""
        level = self.hierarchy.levels[number]
        x, r, change = self._smoothed(number, b, None)
        r = r - level.product(change)
        corrected = x.copy()
        corrected += level.transfer.interpolate(self._cycle(number + 1, level.transfer.restrict(r)))
        return x, r, corrected

    def _up(self, number: int, b: Real, x: Real) -> Real:
        return self._smoothed(number, b - self.hierarchy.levels[number].product(x), x)[0]

    def _smoothed(self, number: int, r: Real, x: Real | None) -> tuple[Real, Real, Real]:
        """x after Chebyshev steps from one with residual ``r``, from zero if it is None; the
        residual before the last step, and that step's change."""
        level, smoother = self.hierarchy.levels[number], self._smoother(number, r.dtype)
        first, *others = level.smoothing_steps()
        change = smoother.apply(r)
        change *= first.gain
        x = change if x is None else x + change
        for step in others:
            r = r - level.product(change)
            scaled = smoother.apply(r)
            scaled *= step.gain
            change = step.keep * change
            change += scaled
            x = x + change
        return x, r, change

    def _smoother(self, number: int, dtype: np.dtype[Any]) -> BlockJacobi | Columns:
        if number not in self._smoothers:
            level = self.hierarchy.levels[number]
            self._smoothers[number] = level.smoother or BlockJacobi(level.inverse.astype(dtype))
        return self._smoothers[number]

    @cached_property
    def _dtype(self) -> type[np.float32] | type[np.float64]:
        """float32 where the finest levels are lattices of repeating rows and it is enough."""
        level = self.hierarchy.levels[0]
        if not isinstance(level.product, StencilProduct) or level.smoother is not None:
            return np.float64
        trace = np.einsum("cii->c", level.product.stencil.diagonal)
        contrast = float(trace.max() / trace[trace > 0.0].min(initial=np.inf))
        return cycle_dtype(self.hierarchy.lowest, contrast)

    def upload(self, device: Allocator, stiffness: DeviceOperator, cases: int) -> DeviceMultigrid:
        """The same on a device; the matrix of ``stiffness`` is that of the finest level."""
        steps = [level.smoothing_steps() for level in self.hierarchy.levels]
        return DeviceMultigrid(device, self.hierarchy, steps, stiffness.texels, cases)

    def device_bytes(self, cases: int) -> int:
        """Bytes on a device, beside the stiffness; never less than are taken."""
        return multigrid_bytes(self.hierarchy, cases)


def cycle_dtype(lowest: float, contrast: float) -> type[np.float32] | type[np.float64]:
    """What cycles of a matrix take whose greatest diagonal is 1, least eigenvalue ``lowest``, and
    the ratio of its diagonal blocks ``contrast``."""
    single = float(np.finfo(np.float32).eps)
    return np.float32 if single <= _FELT * lowest and contrast <= _EVEN else np.float64
