"""Minimum residuals for symmetric matrices of any sign, with a definite preconditioner."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from gpusim.arrays.array_types import Float
from gpusim.errors import NotConverged

# iterations per decimal: with a preconditioner that is near, some ten are enough
_PER_DECIMAL = 120


def minimum_residual(
    apply: Callable[[Float], Float],
    precondition: Callable[[Float], Float],
    right: Float,
    tolerance: float,
) -> tuple[Float, int]:
    """x (1,n) with A x = ``right`` (1,n), and the iterations that it took (Paige & Saunders, SIAM
    J. Numer. Anal. 12 (1975) 617, as Elman, Silvester & Wathen, Finite Elements and Fast Iterative
    Solvers, 2014, algorithm 4.1).

    It ends where sqrt(r . M^-1 r) is ``tolerance`` times what it began with, by recursion. (SciPy's
    minres compares the residual with |A| |x|, which near a limit point is no residual at all.)

    Raises NotConverged after 120 iterations for each decimal, or where M isn't positive definite.
    """
    x = np.zeros_like(right)
    v_before, v = np.zeros_like(right), right.copy()
    z = precondition(v)
    gamma = residual_norm(v, z)
    # what is left of the right-hand side, with the sign that rotations give it
    rest, first, gamma_before = gamma, gamma, 1.0
    sine, sine_before, cosine, cosine_before = 0.0, 0.0, 1.0, 1.0
    w_before, w = np.zeros_like(right), np.zeros_like(right)
    most = int(np.ceil(-_PER_DECIMAL * np.log10(tolerance)))
    for iteration in range(most):
        if abs(rest) <= tolerance * first:
            return x, iteration
        z = z / gamma
        image = apply(z)
        delta = float(np.vdot(image, z))
        v_next = image - (delta / gamma) * v - (gamma / gamma_before) * v_before
        z_next = precondition(v_next)
        gamma_next = residual_norm(v_next, z_next)
        # two old rotations, and a new one that makes the matrix triangular
        alpha_0 = cosine * delta - cosine_before * sine * gamma
        alpha_1 = float(np.hypot(alpha_0, gamma_next))
        alpha_2 = sine * delta + cosine_before * cosine * gamma
        alpha_3 = sine_before * gamma
        cosine_before, cosine = cosine, alpha_0 / alpha_1
        sine_before, sine = sine, gamma_next / alpha_1
        w_before, w = w, (z - alpha_3 * w_before - alpha_2 * w) / alpha_1
        x += cosine * rest * w
        rest *= -sine
        v_before, v, z, gamma_before, gamma = v, v_next, z_next, gamma, gamma_next
    raise NotConverged(
        f"minimum residuals: got {most} iterations; expected a residual of "
        f"{tolerance:.1e} of the first one before"
    )


def residual_norm(r: Float, z: Float) -> float:
    """sqrt(r . z) of a residual and z = M^-1 r. Raises NotConverged where M isn't positive
    definite, or numbers aren't finite."""
    square = float(np.vdot(r, z))
    if not 0.0 <= square < np.inf:
        raise NotConverged(
            f"minimum residuals: got r.M^-1 r = {square:.3g}; expected a positive definite "
            "preconditioner"
        )
    return float(np.sqrt(square))
