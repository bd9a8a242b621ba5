"""Conjugate gradients as far as an iteration around them wants them, of Newton's method or for
eigenvalues (truncated Newton: Dembo & Steihaug, Math. Program. 26 (1983) 190)."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from gpusim.arrays.array_types import Float
from gpusim.errors import NotConverged
from gpusim.fem.krylov.cg import NumpyCG, Preconditioner

_MOST_ITERATIONS = 600


def truncated_cg(
    apply: Callable[[Float], Float],
    preconditioner: Preconditioner,
    right: Float,
    forcing: float,
    size: float = 0.0,
) -> tuple[Float, int, float] | None:
    """x (L,n) with A x = ``right`` (L,n), the iterations that it took, and what sqrt(r . M^-1 r)
    has fallen to, over what it began with; None where A isn't positive definite.

    It ends where that is ``forcing``, or where its square is ``forcing``^2 of a ``size``. Raises
    NotConverged for numbers that aren't finite, or after 600 iterations.
    """
    loop = NumpyCG(apply, preconditioner)
    first = loop.begin(right)
    active, left = ~(np.abs(first) <= forcing**2 * size), np.zeros_like(first)
    for iteration in range(_MOST_ITERATIONS):
        if not active.any():
            return loop.correction(), iteration, float(np.sqrt(left.max()))
        rz, _, beta, curvature = loop.run(1, active)[0].T
        if not np.isfinite(np.stack([rz, beta, curvature])).all():
            raise NotConverged("conjugate gradients: got values that aren't finite")
        if (active & ((curvature <= 0.0) | (rz < 0.0) | (beta < 0.0))).any():
            return None
        left[active] = (rz * beta)[active] / first[active]
        active &= left > forcing**2 * np.maximum(1.0, size / np.maximum(first, 1e-300))
    raise NotConverged(
        f"conjugate gradients: got {_MOST_ITERATIONS} iterations; expected a residual of "
        f"{forcing:.1e} of the first one before"
    )
