"""When to stop: from the coefficients of conjugate gradients to an error in displacement.

Write e for the error of the iterate, A for K on the free unknowns, M for the preconditioner and
mu for the smallest Ritz value, the least eigenvalue of the tridiagonal (Lanczos) matrix that
alpha and beta define. Then

    ||e||_A^2 <= g_k (r_k . z_k),   g_0 = 1/mu,
    g_{k+1} = (g_k - alpha_k) / (mu (g_k - alpha_k) + beta_k)

is the Gauss-Radau upper bound (Meurant & Tichy, Numer. Algorithms 62 (2013) 163), exact for mu
below the smallest eigenvalue of M^-1 A; a Ritz value is slightly above it, so mu is taken 10 %
smaller. The displacement error follows from a norm N with a known least eigenvalue of N^-1 A,

    ||e||_N <= ||e||_A / sqrt(lambda_N),     relative to ||u||_N,

where N = I (root-mean-square displacement of the nodes) and lambda_N comes from the multigrid
hierarchy, and from `gpusim.fem.krylov.soft_modes` where that converges slowly. The bound assumes
that the whole error sits in the softest mode, so it is pessimistic for stiff load cases. It speaks
of the root mean square; a single node may be off by more, most of all where soft and stiff parts
meet.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.linalg import eigvalsh_tridiagonal

__all__ = ["energy_bound", "smallest_ritz_value"]

Float = npt.NDArray[np.float64]


def smallest_ritz_value(alpha: Float, beta: Float) -> float:
    """Least eigenvalue of the Lanczos matrix of one load case; inf before the first step."""
    # a case that broke down takes no further step
    steps = int(np.logical_and.accumulate(alpha > 0.0).sum())
    if steps == 0:
        return float("inf")
    alpha, beta = alpha[:steps], beta[:steps]
    diagonal = 1.0 / alpha
    diagonal[1:] += beta[:-1] / alpha[:-1]
    if steps == 1:
        return float(diagonal[0])
    off = np.sqrt(beta[:-1]) / alpha[:-1]
    return float(eigvalsh_tridiagonal(diagonal, off, select="i", select_range=(0, 0))[0])


def energy_bound(history: Float, mu: float) -> float:
    """Gauss-Radau bound of ||e||_A after all steps of ``history`` (k,4): r.z, alpha, beta, p.q."""
    rz, alpha, beta = history[-1, 0] * history[-1, 2], history[:, 1], history[:, 2]
    if not mu > 0.0 or not np.isfinite(mu):
        return float("inf")
    simple = 1.0 / mu
    radau = simple
    for a, b in zip(alpha, beta, strict=True):
        gap = radau - a
        # a gap below zero says that mu is above an eigenvalue already found: fall back
        radau = gap / (mu * gap + b) if gap > 0.0 else simple
    return float(np.sqrt(max(min(radau, simple), 0.0) * max(rz, 0.0)))
