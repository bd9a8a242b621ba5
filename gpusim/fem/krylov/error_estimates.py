"""What is known of the error of an iteration: least eigenvalues, and bounds that rest on them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from gpusim.fem.assembly.system import System
from gpusim.fem.krylov.rounding_error import extent
from gpusim.fem.krylov.soft_modes import probe
from gpusim.fem.krylov.stopping_criterion import smallest_ritz_value

__all__ = ["BELOW", "Estimates", "Norm"]

Float = npt.NDArray[np.float64]

# a Ritz value lies slightly above the eigenvalue that the bounds ask for
BELOW = 0.9
# a Ritz value below which the preconditioner is poor, and iterations per decimal beyond which it
# is: the loads may not feel all soft modes then, either
_POOR, _MANY = 0.03, 5.0
# a Ritz value below this tells of motions that the coarse levels, and ``Norm.lowest``, don't see
_UNSEEN = 1e-6


@dataclass(frozen=True)
class Norm:
    """The norm of the stopping rule, the sum of squares: ``lowest`` is the least eigenvalue of K';
    ``sought``: soft modes have been looked for already, as ``probe`` does."""

    lowest: float
    sought: bool = False


class Estimates:
    """Least Ritz value so far, and the estimates per load case."""

    def __init__(self, system: System, norm: Norm) -> None:
        self.system, self.norm = system, norm
        self.mu = np.full(len(system.right), np.inf)
        self.settled = np.ones(len(system.right), dtype=bool)
        self.given = system.prescribed * (system.scale / system.load_scale)[:, None, None]
        self.lowest, self.probed = norm.lowest, False
        # what a start was off by, where nothing sharper came to be known
        self.floor = np.zeros(len(system.right))

    def doubtful(self, iterations: int, tolerance: float) -> bool:
        """Whether there may be soft modes that the loads haven't told of, by a first run."""
        if self.probed:
            return False
        many = iterations > _MANY * -np.log10(tolerance) and not self.norm.sought
        return bool((self.mu < _POOR).any()) or many

    def probe(self, loop: Any, most: int) -> str:
        """Look for them; the loop's run is lost. Returns what to say of it."""
        found = probe(self.system, loop, most)
        self.probed = True
        self.mu = np.minimum(self.mu, found.mu)
        self.lowest = min(self.lowest, found.lowest)
        self.settled &= found.settled
        return f" ({found.iterations} more iterations looked for soft modes)"

    def learn(self, history: Float) -> None:
        for case in range(len(self.mu)):
            lowest = smallest_ritz_value(history[:, case, 1], history[:, case, 2])
            self.mu[case] = min(self.mu[case], lowest)

    def left(self, history: Float, rz: Float, x: Float) -> Float:
        """Estimates (L,) by r.z after a run, which are above the bounds that stopped it; ``rz``
        before it."""
        for line in history:
            # a case at rest has neither step nor change
            rz = np.where(line[:, 1] > 0.0, line[:, 0] * line[:, 2], rz)
        return self.by_rz(rz, x)

    def by_rz(self, rz: Float, x: Float) -> Float:
        """Estimates (L,) for the residual of x by ||e||_A <= sqrt(r.z / mu), infinite where no Ritz
        value is known. A case without load takes no step and needs none. That r.z is below zero
        says nothing of the error, least of all that there is none."""
        known = np.where(rz > 0.0, np.isfinite(self.mu), rz == 0.0)
        energy = np.sqrt(np.maximum(rz, 0.0) / (BELOW * np.where(known, self.mu, 1.0)))
        return np.where(known, self.relative(energy, x), np.inf)

    def apart(self, residual: Float, expected: Float | None, x: Float) -> Float:
        """Relative displacement error (L,) from what the true residual (L,n) has more than the
        one that the loop went by: ||A^-1 d||_A <= ||d|| / sqrt(least eigenvalue)."""
        if expected is None:
            return np.full(len(residual), np.inf)
        gap = np.where(self.system.free.ravel(), residual - expected, 0.0)
        size = np.sqrt(np.einsum("ln,ln->l", gap, gap))
        return self.relative(size / np.sqrt(BELOW * self.lowest), x)

    def relative(self, energy: Float, x: Float) -> Float:
        """Estimated relative displacement error for energy-norm errors (L,)."""
        return self.over(energy, self.size(x + self.given))

    def size(self, total: Float) -> Float:
        """What errors (L,) are relative to, for complete displacements (L,N,3)."""
        return extent(total, even=bool(self.given.any()))

    def over(self, energy: Float, size: Float) -> Float:
        """The same for solutions whose norms are ``size`` (L,)."""
        lowest = BELOW * self.lowest * np.minimum(1.0, self.mu / _UNSEEN)
        bound = np.where(self.settled, energy / np.sqrt(lowest), np.inf)
        relative = np.divide(bound, size, out=np.full_like(bound, np.inf), where=size > 0.0)
        return np.where(energy > 0.0, relative, 0.0)
