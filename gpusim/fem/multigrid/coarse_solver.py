"""The coarsest level of multigrid, solved exactly by its inverse."""

from __future__ import annotations

import numpy as np
from scipy.linalg import LinAlgError, cho_factor
from scipy.linalg.lapack import dpotri
from scipy.sparse import bsr_matrix

from gpusim.arrays.array_types import Bool, Float, Real
from gpusim.fem.assembly.stiffness_rounding import indefinite


class CoarseSolver:
    """Solves with a symmetric positive definite ``matrix``, of which the unknowns in ``mask``
    (B,s) exist. ``inverse`` (n,n) is dense, zero where nothing exists.

    Raises NotConverged where the matrix isn't positive definite.
    """

    def __init__(self, matrix: bsr_matrix, mask: Bool) -> None:
        self.unknowns = int(matrix.shape[0])
        kept = np.flatnonzero(mask)
        diagonal = matrix.diagonal()[kept]
        if not (diagonal > 0.0).all():
            raise _indefinite()
        # scaled to a unit diagonal
        scale = 1.0 / np.sqrt(diagonal)
        half = matrix.toarray()[np.ix_(kept, kept)]
        half *= 0.5
        half *= scale[:, None]
        half *= scale
        try:
            factor, _ = cho_factor(half + half.T, lower=True)
        except LinAlgError:
            raise _indefinite() from None
        # the lower triangle is the inverse's
        inverse = np.tril(dpotri(factor, lower=True)[0])
        inverse += np.tril(inverse, -1).T
        inverse *= np.outer(scale, scale)
        self.inverse: Float = np.zeros((self.unknowns, self.unknowns))
        self.inverse[np.ix_(kept, kept)] = inverse

    def solve(self, b: Real) -> Float:
        """(L,n) solutions for (L,n)."""
        return np.asarray(b, dtype=np.float64) @ self.inverse


def _indefinite() -> Exception:
    return indefinite("multigrid, coarsest level")
