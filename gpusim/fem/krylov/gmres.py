"""Generalised minimum residuals, for matrices that are indefinite or not symmetric."""

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
    Sci. Stat. Comput. 7 (1986) 856), each of which keeps two vectors.

    What is made least, and ends it at ``tolerance`` times what it began with, is sqrt(r . M^-1 r):
    in a 2-norm the soft directions of slender bodies would hide what is left in stiff ones. For
    symmetric matrices these are minimum residuals (Paige & Saunders, SIAM J. Numer. Anal. 12 (1975)
    617), but for their short recurrences: near limit points, where these lose what is orthogonal,
    they took three times as many iterations, or never ended.

    Raises NotConverged after 200 iterations, or where M isn't positive definite.
    """
    # M^-1 r beside r, over the size of the two
    residuals: list[Float] = []
    directions: list[Float] = []
    image = np.zeros((_MOST_ITERATIONS + 1, _MOST_ITERATIONS))
    r, z = right, precondition(right)
    size = first = _norm(r, z)
    if first == 0.0:
        return z, 0
    for k in range(_MOST_ITERATIONS):
        residuals.append(r / size)
        directions.append(z / size)
        r = apply(directions[k])
        for row, (residual, direction) in enumerate(zip(residuals, directions, strict=True)):
            image[row, k] = np.vdot(r, direction)
            r = r - image[row, k] * residual
        z = precondition(r)
        size = image[k + 1, k] = _norm(r, z)
        part, wanted = image[: k + 2, : k + 1], first * np.eye(k + 2)[0]
        shares = np.linalg.lstsq(part, wanted, rcond=None)[0]
        if np.linalg.norm(part @ shares - wanted) <= tolerance * first:
            return np.asarray(np.tensordot(shares, np.stack(directions), axes=1)), k + 1
    raise NotConverged(
        f"generalised minimum residuals: got {_MOST_ITERATIONS} iterations; expected a residual "
        f"of {tolerance:.1e} of the first one before"
    )


def _norm(r: Float, z: Float) -> float:
    """sqrt(r . M^-1 r), where z = M^-1 r."""
    square = float(np.vdot(r, z))
    if not 0.0 <= square < np.inf:
        raise NotConverged(
            f"generalised minimum residuals: got r.M^-1 r = {square:.3g}; expected a positive "
            "definite preconditioner"
        )
    return float(np.sqrt(square))
