"""The finest levels of multigrid on a lattice, on the host: every vector stays stored as runs.

A step of Chebyshev smoothing by D^-1 A is a product with rows of blocks of its own,

    x + g D^-1 (b - A x) + k (x - y) = ((1 + k) I - g D^-1 A) x + g D^-1 b - k y,

so that a cycle is four products with dense matrices (``lattice_runs``) and hardly anything else.
Float32 is enough for a preconditioner as long as the softest motion is felt above its rounding;
where it wouldn't be, the same is done in float64.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
import numpy.typing as npt
from scipy.sparse import csr_matrix

from gpusim.arrays.array_types import Bool, Float, Long, Real
from gpusim.fem.lattice.lattice_runs import RunLayout, RunPattern
from gpusim.fem.lattice.stencil import Stencil, StencilProduct
from gpusim.fem.multigrid.hierarchy import Hierarchy
from gpusim.fem.multigrid.smoothers import Relaxation
from gpusim.fem.multigrid.transfer import MatrixTransfer, PlaneWeights

# rounding in float32 over the least eigenvalue from which on float64 is used
_FELT = 0.1
# ratio of stiffnesses beyond which soft parts may be felt worse than the least eigenvalue tells
_EVEN = 1e3


def cycle_dtype(lowest: float, contrast: float) -> type[np.float32] | type[np.float64]:
    """What cycles of a matrix take whose greatest diagonal is 1, least eigenvalue ``lowest``, and
    the ratio of its diagonal blocks ``contrast``."""
    single = float(np.finfo(np.float32).eps)
    return np.float32 if single <= _FELT * lowest and contrast <= _EVEN else np.float64


class LatticeLevel:
    """One level: ``steps`` are the two of its smoother, ``inverse`` (N,3,3) the inverted diagonal
    blocks, zero where fixed."""

    def __init__(
        self,
        stencil: Stencil,
        layout: RunLayout,
        free: Bool,
        inverse: Float,
        steps: tuple[Relaxation, ...],
        dtype: npt.DTypeLike,
    ) -> None:
        self.layout = layout
        key = 8 * stencil.row_class.astype(np.int64) + free @ [1, 2, 4]
        held = np.full(8 * len(stencil.blocks), -1)
        held[key[::-1]] = np.arange(len(key))[::-1]
        used = np.flatnonzero(held >= 0)
        first, number = held[used], np.cumsum(held >= 0) - 1
        self._pattern = RunPattern(layout, number[key], len(used))
        self.worthwhile = self._pattern.worthwhile
        if not self.worthwhile:
            return
        blocks = stencil.blocks[stencil.row_class[first]]
        scaled = np.matmul(inverse[first][:, None], blocks)
        one = free[first][:, None, :] * np.eye(3)
        begin, go = steps
        self._keep, self._more = float(go.keep), float(go.gain / begin.gain)
        before = -(go.gain / begin.gain) * begin.gain * scaled
        before[:, 13] += (1.0 + go.keep + go.gain / begin.gain) * one
        after = -begin.gain * scaled, -go.gain * scaled
        after[0][:, 13] += one
        after[1][:, 13] += (1.0 + go.keep) * one
        self._gain = self._pattern.own_matrices(begin.gain * inverse[first], dtype)
        self._before, self._left, self._first, self._second = (
            self._pattern.matrices(rows, dtype)
            for rows in (before, np.where(free[first][:, None, :, None], -blocks, 0.0), *after)
        )
        self.held = layout.places(~free)
        self.b, self._y = layout.zeros(dtype), layout.zeros(dtype)
        self._kept: dict[int, tuple[Real, Real]] = {}
        self.keep(0)

    def keep(self, case: int) -> None:
        """``down`` and ``up`` are of this load case: one may begin before another one has ended."""
        if case not in self._kept:
            dtype = self.b.dtype
            self._kept[case] = self.layout.zeros(dtype), self.layout.zeros(dtype)
        self._w, self._x = self._kept[case]

    def cycle(self, transfer: PlaneTransfer | AggregateTransfer, below: Callable[[], Real]) -> Real:
        """The stored solution for ``self.b``; ``below`` solves for what ``transfer`` leaves."""
        self._smooth()
        self._correct(transfer, below)
        return self.up()

    def down(self, transfer: PlaneTransfer | AggregateTransfer, below: Callable[[], Real]) -> float:
        """As far as to know b.z, by the smoothed x, its residual y and the corrected x' (the
        smoother is symmetric): b.z = b.x + y.x'."""
        self._smooth()
        before = self._dot(self.b, self._x)
        self._correct(transfer, below)
        return before + self._dot(self._y, self._x)

    def up(self) -> Real:
        """The rest; returns the stored solution."""
        apply, w, x, y = self._pattern.apply, self._w, self._x, self._y
        apply(self._first, x, y, w)
        w *= self._more
        x *= self._keep
        w -= x
        apply(self._second, y, x, w)
        return x

    def _smooth(self) -> None:
        apply, w, x, y = self._pattern.apply, self._w, self._x, self._y
        self._pattern.scale(self._gain, self.b, w)
        apply(self._before, w, x)
        apply(self._left, x, y, self.b)

    def _correct(
        self, transfer: PlaneTransfer | AggregateTransfer, below: Callable[[], Real]
    ) -> None:
        transfer.restrict(self._y)
        transfer.interpolate(below(), self._x)
        self._x[self.held] = 0.0

    def _dot(self, one: Real, two: Real) -> float:
        """Row by row, so that sums in float32 stay short."""
        rows = (self.layout.body(v).reshape(-1, self.layout.row) for v in (one, two))
        return float(np.einsum("ij,ij->i", *rows).sum(dtype=np.float64))


class PlaneTransfer:
    """Interpolation between two stored levels, axis after axis; ``coarse`` receives what is left.

    ``held`` are the places of the coarse level that aren't free.
    """

    def __init__(
        self,
        weights: PlaneWeights,
        fine: RunLayout,
        coarse: RunLayout,
        held: Long,
        into: Real,
    ) -> None:
        self._fine, self._coarse, self._held, self._into = fine, coarse, held, into
        slow, middle, fast = (weights.axes[axis].astype(into.dtype) for axis in fine.order)
        self._slow, self._slow_back = csr_matrix(slow), csr_matrix(slow.T)
        self._middle = np.zeros((fine.shape[1] + 1, coarse.shape[1] + 1), dtype=into.dtype)
        self._middle[:-1, :-1] = middle.toarray()
        spread = np.zeros((fine.row // 3, 3, coarse.row // 3, 3), dtype=into.dtype)
        dense = fast.toarray()
        for k in range(3):
            spread[: dense.shape[0], k, : dense.shape[1], k] = dense
        self._fast = spread.reshape(fine.row, coarse.row)

    def interpolate(self, coarse: Real, x: Real) -> None:
        """x += P coarse, places that aren't free included."""
        body = self._coarse.body(coarse)
        wide = np.matmul(body.reshape(-1, body.shape[2]), self._fast.T)
        high = np.matmul(self._middle, wide.reshape(*body.shape[:2], -1))
        into = self._fine.body(x)
        into += (self._slow @ high.reshape(len(high), -1)).reshape(into.shape)

    def restrict(self, r: Real) -> None:
        """The transpose, into the coarse level's right-hand side."""
        body = self._fine.body(r)
        thick = self._slow_back @ body.reshape(len(body), -1)
        high = np.matmul(self._middle.T, thick.reshape(-1, *body.shape[1:]))
        into = self._coarse.body(self._into)
        np.matmul(high.reshape(-1, body.shape[2]), self._fast, out=into.reshape(-1, into.shape[2]))
        self._into[self._held] = 0.0


class AggregateTransfer:
    """Interpolation from aggregates, whose vectors are stored as they are."""

    def __init__(self, transfer: MatrixTransfer, fine: RunLayout, dtype: npt.DTypeLike) -> None:
        self._transfer, self._fine = transfer, fine
        self._moved = fine.zeros(dtype)

    def interpolate(self, coarse: Real, x: Real) -> None:
        """x += P coarse."""
        moved = self._transfer.interpolate(np.asarray(coarse[None], np.float64))
        self._fine.put(moved[0], self._moved)
        x += self._moved

    def restrict(self, r: Real) -> None:
        """The transpose, for ``solve``."""
        self._right = self._transfer.restrict(self._fine.get(r)[None])

    def solve(self, below: Callable[[Float], Float]) -> Real:
        """What the level below makes of it."""
        return np.asarray(below(self._right)[0])


class _Unstored:
    """The level below the last stored one takes and gives its vectors in the order of its nodes."""

    def __init__(self, layout: RunLayout, dtype: npt.DTypeLike) -> None:
        self.layout, self.b = layout, layout.zeros(dtype)
        self._x = layout.zeros(dtype)

    def solve(self, below: Callable[[Float], Float]) -> Real:
        self.layout.put(below(self.layout.get(self.b)[None])[0], self._x)
        return self._x


class LatticeCycle:
    """The levels of a hierarchy from the finest on that are lattices of repeating rows."""

    @staticmethod
    def of(hierarchy: Hierarchy) -> LatticeCycle | None:
        """None where the finest level isn't one."""
        first = hierarchy.levels[0].product
        if not isinstance(first, StencilProduct):
            return None
        trace = np.einsum("cii->c", first.stencil.diagonal)
        contrast = float(trace.max() / trace[trace > 0.0].min(initial=np.inf))
        dtype = cycle_dtype(hierarchy.lowest, contrast)
        levels: list[LatticeLevel] = []
        for level in hierarchy.levels:
            product = level.product
            if not isinstance(product, StencilProduct) or level.smoother is not None:
                break
            layout = product.layout
            if layout.order != first.layout.order:
                layout = RunLayout(product.stencil.lattice, first.layout.order)
            free = np.einsum("nii->ni", level.inverse) != 0.0
            one = LatticeLevel(
                product.stencil, layout, free, level.inverse, level.smoothing_steps(), dtype
            )
            if not one.worthwhile:
                break
            levels.append(one)
        return LatticeCycle(hierarchy, levels, dtype) if levels else None

    def __init__(
        self, hierarchy: Hierarchy, levels: list[LatticeLevel], dtype: npt.DTypeLike
    ) -> None:
        self.depth, self._levels = len(levels), levels
        self._transfers: list[PlaneTransfer | AggregateTransfer] = []
        self._end: AggregateTransfer | _Unstored
        for number, level in enumerate(levels):
            transfer = hierarchy.levels[number].transfer
            if isinstance(transfer, MatrixTransfer):
                self._end = AggregateTransfer(transfer, level.layout, dtype)
                self._transfers.append(self._end)
                break
            assert isinstance(transfer.interpolation, PlaneWeights)
            if number + 1 < self.depth:
                coarser = levels[number + 1]
                layout, held, into = coarser.layout, coarser.held, coarser.b
            else:
                layout = RunLayout(transfer.interpolation.coarse, levels[0].layout.order)
                self._end = _Unstored(layout, dtype)
                held, into = layout.places(~transfer.coarse_free), self._end.b
            self._transfers.append(
                PlaneTransfer(transfer.interpolation, level.layout, layout, held, into)
            )

    def apply(self, b: Float, below: Callable[[Float], Float]) -> Float:
        """z (3N,) for b (3N,); ``below`` solves on the level below these, for (1,n)."""
        return self._begin(b, 0).layout.get(self._solve(0, below))

    def down(self, b: Float, below: Callable[[Float], Float], case: int) -> float:
        """b.z; ``up`` then gives z of this load case."""
        solve = partial(self._solve, 1, below)
        return self._begin(b, case).down(self._transfers[0], solve)

    def up(self, case: int) -> Float:
        """The z (3N,) that ``down`` of the same load case has begun."""
        top = self._levels[0]
        top.keep(case)
        return top.layout.get(top.up())

    def _begin(self, b: Float, case: int) -> LatticeLevel:
        top = self._levels[0]
        top.keep(case)
        top.layout.put(b, top.b)
        # residuals hold reactions, too
        top.b[top.held] = 0.0
        return top

    def _solve(self, number: int, below: Callable[[Float], Float]) -> Real:
        if number < self.depth:
            return self._levels[number].cycle(
                self._transfers[number], partial(self._solve, number + 1, below)
            )
        return self._end.solve(below)
