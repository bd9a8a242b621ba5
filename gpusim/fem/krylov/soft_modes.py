"""Soft modes that the loads hardly feel, found by conjugate gradients from a rough right-hand side.

What bounds the error rests on the least eigenvalue of M^-1 A. Conjugate gradients tell it by
their Ritz values as far as the right-hand side holds its mode, and a load may hold next to
nothing of it, though it decides the displacement: a thin plate that is pulled along, and a little
across. Noise in the forces holds every mode, and most of the soft ones.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from gpusim.arrays.unique import noise
from gpusim.fem.assembly.definiteness import check_finite, indefinite
from gpusim.fem.assembly.system import System
from gpusim.fem.krylov.stopping_criterion import smallest_ritz_value

__all__ = ["Probed", "probe"]

Float = npt.NDArray[np.float64]

_FIRST = 10
# the Ritz value may fall by this factor and the Rayleigh quotient by that one while the number of
# iterations doubles, where the least eigenvalues count as found
_RITZ, _RAYLEIGH = 2.0, 1.5


@dataclass(frozen=True, eq=False)
class Probed:
    """``mu`` (L,) least Ritz values of M^-1 A, ``settled`` (L,) whether they are final, ``lowest``
    a Rayleigh quotient of A near its least eigenvalue, and the ``iterations`` that it took."""

    mu: Float
    settled: npt.NDArray[np.bool_]
    lowest: float
    iterations: int


def probe(system: System, loop: Any, most: int, first: int = _FIRST, ritz: float = _RITZ) -> Probed:
    """Solve for noise until the least Ritz value and the Rayleigh quotient of the solution settle
    between ``first`` and twice as many iterations, or 2 and 4 times as many, and so on.

    One solution of A x = noise is a step of inverse iteration, so its quotient is near the least
    eigenvalue. Raises NotConverged for stiffnesses that aren't positive definite.
    """
    rough = noise(system.right.size, 11)
    rough = np.where(system.free, rough.reshape(system.right.shape), 0.0)
    active = loop.begin(rough.reshape(len(rough), -1)) > 0.0
    cases = len(rough)
    history = np.zeros((0, cases, 4))
    mu, lowest = np.full(cases, np.inf), np.inf
    settled = ~active
    while len(history) < most and not settled.all():
        count = min(max(first, len(history)), most - len(history))
        history = np.concatenate([history, loop.run(count, active)])
        check_finite(history, "conjugate gradients")
        if ((history[:, :, 3] <= 0.0) & (history[:, :, 0] > 0.0)).any():
            raise indefinite("conjugate gradients")
        before, quotient_before = mu, lowest
        mu = np.array(
            [smallest_ritz_value(history[:, k, 1], history[:, k, 2]) for k in range(cases)]
        )
        x = loop.correction()
        size = np.einsum("ln,ln->l", x, x)
        # ||x_k||_A^2 is the sum of alpha r.z
        energy = (history[:, :, 0] * history[:, :, 1]).sum(axis=0)
        held = size > 0.0
        lowest = float((energy[held] / size[held]).min()) if held.any() else np.inf
        settled = ~active | ((before <= ritz * mu) & bool(quotient_before <= _RAYLEIGH * lowest))
    return Probed(mu, settled, lowest, len(history))
