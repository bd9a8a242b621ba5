"""Multigrid with patches as smoothers, on the host."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from gpusim.fem.hierarchy import Level
from gpusim.fem.preconditioner import Multigrid
from gpusim.fem.smooth import Relaxation, chebyshev

__all__ = ["PatchMultigrid"]

Float = npt.NDArray[np.float64]

# stronger smoothing than Jacobi's: a step costs little beside what the coarse level can't do
_DEGREE, _RANGE = 3, 30.0


class PatchMultigrid(Multigrid):
    """The V-cycle of ``Multigrid``; levels that have patches are smoothed by them.

    There is no device form: patches gather and scatter whole blocks of nodes, which the host's
    matrix products do well.
    """

    def _down(self, number: int, b: Float) -> tuple[Float, Float, Float]:
        level = self.hierarchy.levels[number]
        if level.patches is None:
            return super()._down(number, b)
        x = _smooth(level, _steps(level), b, np.zeros_like(b))
        r = b - level.product(x)
        coarse = self._cycle(number + 1, level.transfer.restrict(r))
        return x, r, x + level.transfer.interpolate(coarse)

    def _up(self, number: int, b: Float, x: Float) -> Float:
        level = self.hierarchy.levels[number]
        if level.patches is None:
            return super()._up(number, b, x)
        return _smooth(level, _steps(level), b, x)


def _steps(level: Level) -> tuple[Relaxation, ...]:
    return chebyshev(level.largest / _RANGE, level.largest, _DEGREE)


def _smooth(level: Level, steps: tuple[Relaxation, ...], b: Float, x: Float) -> Float:
    assert level.patches is not None
    d = np.zeros_like(b)
    r = b - level.product(x) if x.any() else b
    for number, step in enumerate(steps):
        if number:
            r = r - level.product(d)
        d = step.keep * d + step.gain * level.patches.apply(r)
        x = x + d
    return x
