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
) -> tuple[Float, int] | None:
    """x (L,n) with A x = ``right`` (L,n), and the iterations that it took; None where A isn't
    positive definite.

    It ends where sqrt(r . M^-1 r) is ``forcing`` times what it began with. Raises NotConverged for
    numbers that aren't finite, or after 600 iterations.
    """
    loop = NumpyCG(apply, preconditioner)
    first = loop.begin(right)
    active = first != 0.0
    for iteration in range(_MOST_ITERATIONS):
        if not active.any():
            return loop.correction(), iteration
        rz, _, beta, curvature = loop.run(1, active)[0].T
        if not np.isfinite(np.stack([rz, beta, curvature])).all():
            raise NotConverged("conjugate gradients: got values that aren't finite")
        if (active & ((curvature <= 0.0) | (rz < 0.0) | (beta < 0.0))).any():
            return None
        active &= rz * beta > forcing**2 * first
    raise NotConverged(
        f"conjugate gradients: got {_MOST_ITERATIONS} iterations; expected a residual of "
        f"{forcing:.1e} of the first one before"
    )
