"""The preconditioner: a multigrid V-cycle over a hierarchy of levels."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property, partial

import numpy as np

from gpusim.arrays.array_types import Float
from gpusim.fem.device.node_texels import Allocator
from gpusim.fem.device.tet_forces import DeviceOperator
from gpusim.fem.device.v_cycle import TWICE, DeviceMultigrid, multigrid_bytes
from gpusim.fem.krylov.cg import Preconditioner
from gpusim.fem.lattice.stencil import StencilProduct
from gpusim.fem.multigrid.column_blocks import Columns
from gpusim.fem.multigrid.hierarchy import Hierarchy, Level
from gpusim.fem.multigrid.lattice_cycle import LatticeCycle
from gpusim.fem.multigrid.smoothers import Relaxation, columns, relax
from gpusim.fem.sparse.matrix_product import Product


def _from_zero(step: Relaxation) -> Relaxation:
    return Relaxation(step.keep, step.gain, 0.0)


class Multigrid(Preconditioner):
    """One symmetric cycle: Chebyshev smoothing before and after, dense inverse at the bottom.

    Aggregated levels are gone through twice (Axelsson & Vassilevski, Numer. Math. 56 (1989) 157):
    with the V-cycle V of a level, I - t V A once more brings its spectrum from (0, 1] to
    1 - (1 - t x)^2, positive for t < 2, and small values to 2 t times as much.
    """

    def __init__(self, hierarchy: Hierarchy) -> None:
        self.hierarchy = hierarchy
        self._inverses: dict[int, Float] = {}
        # what ``down`` of a load case leaves for ``up``
        self._begun: dict[int, tuple[Float, Float]] = {}

    def _inverse(self, number: int) -> Float:
        """By columns; the levels that ``LatticeCycle`` goes through are never asked for."""
        if number not in self._inverses:
            self._inverses[number] = columns(self.hierarchy.levels[number].inverse)
        return self._inverses[number]

    @property
    def lowest(self) -> float:
        """The hierarchy's estimate of the least eigenvalue of K."""
        return self.hierarchy.lowest

    @property
    def product(self) -> Product | StencilProduct:
        """x (L,3N) -> K x on the finest level."""
        return self.hierarchy.levels[0].product

    @cached_property
    def _lattice(self) -> LatticeCycle | None:
        return LatticeCycle.of(self.hierarchy)

    def apply(self, r: Float) -> Float:
        """z = M^-1 r for (L,3N) r."""
        lattice = self._lattice
        if lattice is None:
            return self._cycle(0, r)
        below = partial(self._cycle, lattice.depth)
        return np.stack([lattice.apply(one, below) for one in r])

    def down(self, r: Float, cases: Sequence[int]) -> Float:
        """r.z (L,) for (L,3N) r of some load cases, whose z ``up`` gives then; whoever stops by
        r.z needs no more.

        With the smoothed x = S r, S symmetric, its residual y and x' = x + P c after the coarser
        levels, z = x' + S (r - A x') makes r.z = r.x + y.x'.
        """
        lattice = self._lattice
        if lattice is not None:
            below = partial(self._cycle, lattice.depth)
            return np.array(
                [lattice.down(one, below, case) for one, case in zip(r, cases, strict=True)]
            )
        smoothed, residual, corrected = self._down(0, r)
        for case, one, x in zip(cases, r, corrected, strict=True):
            self._begun[case] = one, x
        energy: Float = np.einsum("ln,ln->l", r, smoothed) + np.einsum(
            "ln,ln->l", residual, corrected
        )
        return energy

    def up(self, cases: Sequence[int]) -> Float:
        """z (L,3N) of the load cases of ``down``."""
        lattice = self._lattice
        if lattice is not None:
            return np.stack([lattice.up(case) for case in cases])
        b, x = (np.stack(parts) for parts in zip(*map(self._begun.pop, cases), strict=True))
        return self._up(0, b, x)

    def _cycle(self, number: int, b: Float) -> Float:
        if number == len(self.hierarchy.levels):
            return self.hierarchy.coarsest.solve(b)
        x = self._up(number, b, self._down(number, b)[2])
        level = self.hierarchy.levels[number]
        if level.twice:
            x *= TWICE
            b = b - level.product(x)
            x += TWICE * self._up(number, b, self._down(number, b)[2])
        return x

    def _down(self, number: int, b: Float) -> tuple[Float, Float, Float]:
        """The smoothed x, its residual, and x with what coarser levels add."""
        level = self.hierarchy.levels[number]
        if level.smoother is not None:
            x = _smoothed(level, level.smoother, b, None)
            r = b - level.product(x)
            coarse = self._cycle(number + 1, level.transfer.restrict(r))
            return x, r, x + level.transfer.interpolate(coarse)
        inverse, steps = self._inverse(number), level.smoothing_steps()
        r, d, x = relax(inverse, b, None, None, None, _from_zero(steps[0]))
        for step in steps[1:]:
            r, d, x = relax(inverse, r, level.product(d), d, x, step)
        r = r - level.product(d)
        coarse = self._cycle(number + 1, level.transfer.restrict(r))
        return x, r, x + level.transfer.interpolate(coarse)

    def _up(self, number: int, b: Float, x: Float) -> Float:
        level = self.hierarchy.levels[number]
        if level.smoother is not None:
            return _smoothed(level, level.smoother, b, x)
        inverse, steps = self._inverse(number), level.smoothing_steps()
        r, d, x = relax(inverse, b, level.product(x), None, x, steps[0])
        for step in steps[1:]:
            r, d, x = relax(inverse, r, level.product(d), d, x, step)
        return x

    def upload(self, device: Allocator, stiffness: DeviceOperator, cases: int) -> DeviceMultigrid:
        """The same on a device; the matrix of ``stiffness`` is that of the finest level."""
        steps = [level.smoothing_steps() for level in self.hierarchy.levels]
        return DeviceMultigrid(device, self.hierarchy, steps, stiffness.texels, cases)

    def device_bytes(self, cases: int) -> int:
        """Bytes on a device, beside the stiffness; never less than are taken."""
        return multigrid_bytes(self.hierarchy, cases)


def _smoothed(level: Level, smoother: Columns, b: Float, x: Float | None) -> Float:
    """Chebyshev steps with blocks larger than a node's, from x or from zero; the twin of
    `gpusim.fem.device.relaxation.ColumnRelaxation`."""
    r = b if x is None else b - level.product(x)
    x = np.zeros_like(b) if x is None else x
    d = np.zeros_like(b)
    for number, step in enumerate(level.smoothing_steps()):
        if number:
            r = r - level.product(d)
        d = step.keep * d + step.gain * smoother.apply(r)
        x = x + d
    return x
