"""The coarsest level of multigrid, solved exactly: a band where the body is long, or an inverse.

The bandwidth of a long body's matrix is small, and solving by its factor costs less than further
levels would, which are gone through several times.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
from scipy.linalg import LinAlgError, cho_factor, cho_solve_banded, cholesky_banded
from scipy.linalg.lapack import dpotri
from scipy.sparse import bsr_matrix, coo_matrix, csr_matrix
from scipy.sparse.csgraph import reverse_cuthill_mckee

from gpusim.arrays.array_types import Bool, Float, Long, Real
from gpusim.fem.assembly.stiffness_rounding import indefinite
from gpusim.fem.sparse.block_rows import pattern

# A band of b in n unknowns is read twice to solve with it, and n b^2 operations make its factor:
# these are a third of a cycle, and ten cycles, of a body with one unknown
_READ, _FACTORISED = 16.0, 6000.0


def narrow_order(matrix: bsr_matrix, finest: int) -> Long | None:
    """An order of the block rows in which they make a narrow band (reverse Cuthill-McKee; George &
    Liu 1981), None where solving by it isn't worth it for a body with ``finest`` unknowns."""
    size = matrix.blocksize[0]
    graph = pattern(matrix)
    order = reverse_cuthill_mckee(graph, symmetric_mode=True).astype(np.int64)
    band = size * (_bandwidth(graph, order) + 1)
    numbers = band * matrix.shape[0]
    narrow = numbers <= _READ * finest and numbers * band <= _FACTORISED * finest
    return order if narrow else None


def _bandwidth(graph: csr_matrix, order: Long) -> int:
    place = np.empty(len(order), dtype=np.int64)
    place[order] = np.arange(len(order))
    row = np.repeat(place, np.diff(graph.indptr))
    return int(np.abs(row - place[graph.indices]).max(initial=0))


class CoarseSolver:
    """Solves with a symmetric positive definite ``matrix``, of which the unknowns in ``mask``
    (B,s) exist; by a band of its block rows in ``order``, or by its inverse.

    Raises NotConverged where the matrix isn't positive definite.
    """

    def __init__(self, matrix: bsr_matrix, mask: Bool, order: Long | None) -> None:
        self.unknowns = int(matrix.shape[0])
        self._matrix = matrix
        rows = np.arange(len(mask)) if order is None else order
        unknown = np.arange(self.unknowns).reshape(mask.shape)
        self._kept = unknown[rows][mask[rows]]
        diagonal = matrix.diagonal()[self._kept]
        if not (diagonal > 0.0).all():
            raise _indefinite()
        # scaled to a unit diagonal
        self._scale = 1.0 / np.sqrt(diagonal)
        self._band = None if order is None else self._factorised()
        if order is None:
            self.inverse  # noqa: B018 (a matrix that isn't definite is told now)

    def _scaled(self) -> coo_matrix:
        """The lower triangle and the diagonal of the unknowns that exist, in order."""
        place = np.full(self.unknowns, -1)
        place[self._kept] = np.arange(len(self._kept))
        whole = self._matrix.tocoo()
        row, column = place[whole.row], place[whole.col]
        existing = (row >= 0) & (column >= 0)
        row, column, value = row[existing], column[existing], whole.data[existing]
        value = 0.5 * value * self._scale[row] * self._scale[column]
        # both halves of the symmetric matrix, added
        shape = (len(self._kept),) * 2
        low, high = np.maximum(row, column), np.minimum(row, column)
        return coo_matrix((np.where(row == column, 2.0 * value, value), (low, high)), shape=shape)

    def _factorised(self) -> Float:
        lower = self._scaled()
        lower.sum_duplicates()
        width = int((lower.row - lower.col).max(initial=0))
        # as LAPACK takes it: the factor stands where the band was
        band = np.zeros((width + 1, lower.shape[0]), order="F")
        band[lower.row - lower.col, lower.col] = lower.data
        try:
            return np.asarray(cholesky_banded(band, overwrite_ab=True, lower=True))
        except LinAlgError:
            raise _indefinite() from None

    @cached_property
    def inverse(self) -> Float:
        """(n,n) dense, zero where nothing exists."""
        lower = self._scaled().toarray()
        try:
            factor = cho_factor(lower, lower=True)
        except LinAlgError:
            raise _indefinite() from None
        # the lower triangle is the inverse's
        inverse = np.tril(dpotri(factor[0], lower=True)[0])
        inverse += np.tril(inverse, -1).T
        inverse *= np.outer(self._scale, self._scale)
        result = np.zeros((self.unknowns, self.unknowns))
        result[np.ix_(self._kept, self._kept)] = inverse
        return result

    def solve(self, b: Real) -> Float:
        """(L,n) solutions for (L,n)."""
        if self._band is None:
            return np.asarray(b, dtype=np.float64) @ self.inverse
        result = np.zeros(b.shape)
        right = (b[:, self._kept] * self._scale).T
        result[:, self._kept] = (
            cho_solve_banded((self._band, True), right, check_finite=False).T * self._scale
        )
        return result


def _indefinite() -> Exception:
    return indefinite("multigrid, coarsest level")
