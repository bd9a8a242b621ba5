"""Preconditioners: block Jacobi, and a multigrid V-cycle over an aggregation hierarchy."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from gpusim.fem.aggregation import Hierarchy, Level
from gpusim.fem.arena import Allocator
from gpusim.fem.smooth import DeviceSmoother, Relaxation, chebyshev, relax
from gpusim.fem.sparse import DeviceSparse, apply_sparse
from gpusim.gpu import Recording
from gpusim.gpu.buffer import RealBuffer

__all__ = ["BlockJacobi", "Multigrid"]

Float = npt.NDArray[np.float64]

_JACOBI = Relaxation(0.0, 1.0, 0.0)
_DEGREE = 2
_RANGE = 20.0


class BlockJacobi:
    """z = D^-1 r with the 3x3 diagonal blocks of K; ``inverse`` (N,3,3), zero where fixed."""

    name = "block_jacobi"

    def __init__(self, inverse: Float) -> None:
        self.inverse = inverse

    def apply(self, r: Float) -> Float:
        """z = D^-1 r for (L,3N) r."""
        zero = np.zeros_like(r)
        return relax(self.inverse, r, None, zero, zero, _JACOBI)[2]

    def upload(self, device: Allocator, stiffness: Any, cases: int) -> _DeviceJacobi:
        """The same on a device."""
        return _DeviceJacobi(device, self.inverse, cases)


class _DeviceJacobi:
    def __init__(self, device: Allocator, inverse: Float, cases: int) -> None:
        self._smoother = DeviceSmoother(device, inverse, cases, "fem.jacobi")
        zeros = np.zeros((cases, self._smoother.unknowns))
        self._copy = device.real_buffer(zeros, label="fem.jacobi.copy")
        self._change = device.real_buffer(zeros, label="fem.jacobi.change")

    def record(self, recording: Recording, r: RealBuffer, z: RealBuffer) -> None:
        self._smoother.record(recording, r, None, self._copy, self._change, z, _JACOBI)


def _steps(level: Level) -> tuple[Relaxation, ...]:
    return chebyshev(level.largest / _RANGE, level.largest, _DEGREE)


def _from_zero(step: Relaxation) -> Relaxation:
    return Relaxation(step.keep, step.gain, 0.0)


class Multigrid:
    """One symmetric V-cycle: Chebyshev smoothing before and after, dense inverse at the bottom.

    ``stiffness`` is (L,3N) -> K times it, used on the finest level.
    """

    name = "multigrid"

    def __init__(self, hierarchy: Hierarchy, stiffness: Any) -> None:
        self.hierarchy, self._stiffness = hierarchy, stiffness

    def apply(self, r: Float) -> Float:
        """z = M^-1 r for (L,3N) r."""
        return self._cycle(0, r)

    def _cycle(self, number: int, b: Float) -> Float:
        levels = self.hierarchy.levels
        if number == len(levels):
            return apply_sparse(self.hierarchy.coarse_inverse, b)
        level = levels[number]
        steps = _steps(level)
        zero = np.zeros_like(b)
        r, d, x = relax(level.inverse, b, None, zero, zero, _from_zero(steps[0]))
        for step in steps[1:]:
            r, d, x = relax(level.inverse, r, self._product(level, d), d, x, step)
        r = r - self._product(level, d)
        coarse = self._cycle(number + 1, apply_sparse(level.prolongation.T, r))
        x = x + apply_sparse(level.prolongation, coarse)
        r, d, x = relax(level.inverse, b, self._product(level, x), d, x, steps[0])
        for step in steps[1:]:
            r, d, x = relax(level.inverse, r, self._product(level, d), d, x, step)
        return x

    def _product(self, level: Level, x: Float) -> Float:
        if level.matrix is None:
            return np.asarray(self._stiffness(x))
        return apply_sparse(level.matrix, x)

    def upload(self, device: Allocator, stiffness: Any, cases: int) -> _DeviceMultigrid:
        """The same on a device; ``stiffness.record(rec, x, y)`` acts on the finest level."""
        return _DeviceMultigrid(device, self.hierarchy, stiffness, cases)


@dataclass(frozen=True, eq=False)
class _DeviceLevel:
    operator: Any
    smoother: DeviceSmoother
    restriction: DeviceSparse
    prolongation: DeviceSparse
    steps: tuple[Relaxation, ...]
    residuals: tuple[RealBuffer, RealBuffer]
    product: RealBuffer
    change: RealBuffer
    coarse_b: RealBuffer
    coarse_x: RealBuffer


class _DeviceMultigrid:
    def __init__(self, device: Allocator, hierarchy: Hierarchy, stiffness: Any, cases: int) -> None:
        self._levels = [
            _upload_level(device, level, stiffness, cases, f"fem.multigrid.{number}")
            for number, level in enumerate(hierarchy.levels)
        ]
        self._coarse = DeviceSparse(device, hierarchy.coarse_inverse, cases, "fem.multigrid.coarse")

    def record(self, recording: Recording, r: RealBuffer, z: RealBuffer) -> None:
        self._cycle(recording, 0, r, z)

    def _cycle(self, recording: Recording, number: int, b: RealBuffer, x: RealBuffer) -> None:
        if number == len(self._levels):
            self._coarse.record(recording, b, x)
            return
        level = self._levels[number]
        steps = (_from_zero(level.steps[0]), *level.steps[1:])
        r = self._smooth(recording, level, b, None, x, steps)
        level.operator.record(recording, level.change, level.product)
        spare = level.residuals[1] if r is level.residuals[0] else level.residuals[0]
        level.smoother.record_difference(recording, r, level.product, spare)
        level.restriction.record(recording, spare, level.coarse_b)
        self._cycle(recording, number + 1, level.coarse_b, level.coarse_x)
        level.prolongation.record(recording, level.coarse_x, x, add=True)
        level.operator.record(recording, x, level.product)
        self._smooth(recording, level, b, level.product, x, level.steps)

    def _smooth(
        self,
        recording: Recording,
        level: _DeviceLevel,
        b: RealBuffer,
        t: RealBuffer | None,
        x: RealBuffer,
        steps: tuple[Relaxation, ...],
    ) -> RealBuffer:
        one, two = level.residuals
        level.smoother.record(recording, b, t, one, level.change, x, steps[0])
        for step in steps[1:]:
            level.operator.record(recording, level.change, level.product)
            level.smoother.record(recording, one, level.product, two, level.change, x, step)
            one, two = two, one
        return one


def _upload_level(
    device: Allocator, level: Level, stiffness: Any, cases: int, label: str
) -> _DeviceLevel:
    transfer = level.prolongation
    fine, coarse = (np.zeros((cases, int(n))) for n in transfer.shape)

    def vector(zeros: Float, name: str) -> RealBuffer:
        return device.real_buffer(zeros, label=f"{label}.{name}")

    operator = stiffness
    if level.matrix is not None:
        operator = DeviceSparse(device, level.matrix, cases, f"{label}.matrix")
    return _DeviceLevel(
        operator,
        DeviceSmoother(device, level.inverse, cases, label),
        DeviceSparse(device, transfer.T.tocsr(), cases, f"{label}.restriction"),
        DeviceSparse(device, transfer, cases, f"{label}.prolongation"),
        _steps(level),
        (vector(fine, "r"), vector(fine, "s")),
        vector(fine, "product"),
        vector(fine, "change"),
        vector(coarse, "b"),
        vector(coarse, "x"),
    )
