"""Generalised minimum residuals, for matrices that aren't symmetric."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from gpusim.arrays.array_types import Float
from gpusim.errors import NotConverged

_MOST_ITERATIONS = 200


def gmres(
    apply: Callable[[Float], Float],
    precondition: Callable[[Float], Float],
    right: Float,
    tolerance: float,
) -> tuple[Float, int]:
    """x (1,n) with A x = ``right`` (1,n), and the iterations that it took (Saad & Schultz, SIAM J.
    Sci. Stat. Comput. 7 (1986) 856); all directions are kept.

    It ends where the 2-norm of M^-1 r, which is nearly the error, is ``tolerance`` times what it
    began with. Raises NotConverged after 200 iterations, or for numbers that aren't finite.
    """
    first = precondition(right)
    size = float(np.linalg.norm(first))
    if size == 0.0:
        return first, 0
    basis, image = [first / size], np.zeros((_MOST_ITERATIONS + 1, _MOST_ITERATIONS))
    for k in range(_MOST_ITERATIONS):
        new = precondition(apply(basis[k]))
        for row, vector in enumerate(basis):
            image[row, k] = np.vdot(vector, new)
            new = new - image[row, k] * vector
        image[k + 1, k] = np.linalg.norm(new)
        if not np.isfinite(image[: k + 2, k]).all():
            raise NotConverged("generalised minimum residuals: got values that aren't finite")
        part, wanted = image[: k + 2, : k + 1], size * np.eye(k + 2)[0]
        shares = np.linalg.lstsq(part, wanted, rcond=None)[0]
        if np.linalg.norm(part @ shares - wanted) <= tolerance * size:
            return np.asarray(np.tensordot(shares, np.stack(basis), axes=1)), k + 1
        basis.append(new / image[k + 1, k])
    raise NotConverged(
        f"generalised minimum residuals: got {_MOST_ITERATIONS} iterations; expected a residual "
        f"of {tolerance:.1e} of the first one before"
    )
