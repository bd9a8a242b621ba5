"""Rayleigh-Ritz: the eigenvalues in a span of vectors, as sharp as float64 has the stiffness."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.linalg import LinAlgError, eigh

from gpusim.arrays.array_types import Float
from gpusim.fem.assembly.equation_of_motion import EquationOfMotion
from gpusim.fem.assembly.stiffness_rounding import indefinite

Apply = Callable[[Float], Float]

# share of a tolerance that iterations are to reach: rounding may take the rest
AIM = 0.8


def rayleigh_ritz(stiffness: Apply, inertia: Apply, rows: Float) -> tuple[Float, Float]:
    """Values (k,) of B x = mu K x in the span of ``rows`` (k,n), the greatest first, and its
    vectors, orthonormal in K. Raises NotConverged where K isn't positive definite on them."""
    energy, product = rows @ stiffness(rows).T, rows @ inertia(rows).T
    try:
        values, shares = eigh(0.5 * (product + product.T), 0.5 * (energy + energy.T))
    except LinAlgError:
        raise indefinite("modes") from None
    return values[::-1], shares.T[::-1] @ rows


def sharpened(
    equation: EquationOfMotion, inertia: Apply, rows: Float, tolerance: float
) -> tuple[Float, Float, Float]:
    """The same, and as much as rounding may make of values (k,), relative: with K by deformation
    where by differences it would be seen beside the ``tolerance``."""
    values, rounding = np.zeros(len(rows)), np.zeros(len(rows))
    rows, seen = rows.copy(), np.ones(len(rows), dtype=bool)
    for stiffness, sizes in (
        (equation.stiffness_by_differences, equation.rounding_by_differences),
        (equation.stiffness_by_deformation, equation.rounding_by_deformation),
    ):
        values[seen], rows[seen] = rayleigh_ritz(stiffness, inertia, rows[seen])
        rounding[seen] = np.linalg.norm(rows[seen] * sizes(rows[seen]), axis=1)
        seen = rounding > (1.0 - AIM) * tolerance
        if not seen.any():
            break
    order = np.argsort(-values)
    return values[order], rows[order], rounding[order]
