"""Many small normal equations at once: Cholesky factors and solutions, vectorised over subsets."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from gpusim.measure.images import FloatArray

__all__ = ["MIN_PIVOT", "cholesky", "solve"]

MIN_PIVOT = 1e-5  # of a Cholesky pivot over its diagonal: below, a motion can't be told


def cholesky(matrix: FloatArray) -> tuple[FloatArray, npt.NDArray[np.bool_]]:
    """Lower factors of (B, P, P) matrices and whether each is safely positive definite."""
    size = matrix.shape[1]
    factor = np.zeros_like(matrix)
    good = np.ones(matrix.shape[0], dtype=bool)
    largest = np.einsum("bii->bi", matrix).max(axis=1)
    for j in range(size):
        diagonal = matrix[:, j, j]
        pivot = diagonal - (factor[:, j, :j] ** 2).sum(axis=1)
        good &= (pivot > MIN_PIVOT * diagonal) & (diagonal > MIN_PIVOT**2 * largest)
        root = np.sqrt(np.where(good, pivot, 1.0))
        factor[:, j, j] = root
        for i in range(j + 1, size):
            dot = (factor[:, i, :j] * factor[:, j, :j]).sum(axis=1)
            factor[:, i, j] = (matrix[:, i, j] - dot) / root
    return factor, good


def solve(factor: FloatArray, right: FloatArray) -> FloatArray:
    """Solve L L^T x = right for (B, P, P) factors and (B, P) right sides."""
    size = factor.shape[1]
    x = right.copy()
    for i in range(size):
        x[:, i] = (x[:, i] - (factor[:, i, :i] * x[:, :i]).sum(axis=1)) / factor[:, i, i]
    for i in reversed(range(size)):
        x[:, i] = (x[:, i] - (factor[:, i + 1 :, i] * x[:, i + 1 :]).sum(axis=1)) / factor[:, i, i]
    return x
