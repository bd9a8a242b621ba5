"""Geometry of many cells at quadrature points, written out by components.

Arrays of 3x3 matrices keep the cell and the point last: (3,3,M,Q). NumPy's batched ``inv`` and
``det`` take a microsecond per matrix; this takes a few nanoseconds.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from gpusim.arrays.array_types import Float
from gpusim.errors import InputError
from gpusim.fem.elements.element import Rule


def reference_gradient(values: Float, rule: Rule) -> Float:
    """(3,3,M,Q) d value_i / d xi_j at the points of a rule, of nodal ``values`` (M,k,3)."""
    points, nodes, _ = rule.gradient.shape
    # one matrix product: (3M,k) @ (k,3Q)
    flat = values.transpose(2, 0, 1).reshape(-1, nodes)
    product = flat @ rule.gradient.transpose(1, 2, 0).reshape(nodes, 3 * points)
    return np.ascontiguousarray(product.reshape(3, -1, 3, points).transpose(0, 2, 1, 3))


def determinant(matrix: Float) -> Float:
    """(…) determinants of (3,3,…)."""
    a = matrix
    return np.asarray(
        a[0, 0] * (a[1, 1] * a[2, 2] - a[1, 2] * a[2, 1])
        - a[0, 1] * (a[1, 0] * a[2, 2] - a[1, 2] * a[2, 0])
        + a[0, 2] * (a[1, 0] * a[2, 1] - a[1, 1] * a[2, 0])
    )


def require_positive(kind: str, det: Float) -> None:
    """Raises InputError where determinants (M,…) of the Jacobians of cells aren't positive."""
    bad = ~(det > 0.0)
    if bad.any():
        count = int(bad.reshape(len(bad), -1).any(axis=1).sum())
        raise InputError(
            f"{kind}: {count} elements are inverted at a quadrature point; got a Jacobian of "
            f"{det[bad].min():.3g}; expected positive volume (see mesh_quality)"
        )


def inverse(matrix: Float, det: Float) -> Float:
    """(3,3,…) inverses, by cofactors, of matrices with these determinants."""
    result = np.empty_like(matrix)
    for i in range(3):
        for j in range(3):
            a, b = (j + 1) % 3, (j + 2) % 3
            c, d = (i + 1) % 3, (i + 2) % 3
            result[i, j] = (matrix[a, c] * matrix[b, d] - matrix[a, d] * matrix[b, c]) / det
    return result


def times(left: Float, right: Float) -> Float:
    """(3,3,…) matrix products."""
    result = np.empty(np.broadcast_shapes(left.shape, right.shape))
    for i in range(3):
        for j in range(3):
            result[i, j] = left[i, 0] * right[0, j]
            result[i, j] += left[i, 1] * right[1, j]
            result[i, j] += left[i, 2] * right[2, j]
    return result


def cross_matrices(vectors: Float) -> Float:
    """(…,3,3) matrices of the products with ``vectors`` (…,3) from the left."""
    return np.asarray((vectors.reshape(-1, 3) @ _CROSS).reshape(*vectors.shape, 3))


_CROSS = np.array([[0.0, 0, 0, 0, 0, -1, 0, 1, 0], [0, 0, 1, 0, 0, 0, -1, 0, 0],
                   [0, -1, 0, 1, 0, 0, 0, 0, 0]])  # fmt: skip
"""(3,9) of v: the matrix of v x w."""


def add_to(total: Float, numbers: npt.NDArray[np.integer], values: Float) -> None:
    """Add ``values`` (M,k,c) to the rows ``numbers`` (M,k) of ``total`` (N,c), repeats included.

    Works on the range of rows that occur, so that adding a mesh's cells in chunks is cheap.
    """
    rows = numbers.ravel()
    first, last = int(rows.min()), int(rows.max()) + 1
    local = rows - first
    for column in range(total.shape[1]):
        weights = values[..., column].ravel()
        total[first:last, column] += np.bincount(local, weights, minlength=last - first)


def solve_definite(matrix: Float, right: Float) -> Float:
    """x (n,M) with matrix (n,n,M) x = right (n,M), for symmetric positive definite matrices.

    Elimination without pivoting, which definite matrices don't need. Overwrites its arguments.
    """
    size = len(right)
    for k in range(size):
        factor = matrix[k + 1 :, k] / matrix[k, k]
        right[k + 1 :] -= factor * right[k]
        for i in range(k + 1, size):
            # the part below the diagonal isn't needed: it is the factors
            matrix[i, k + 1 :] -= factor[i - k - 1] * matrix[k, k + 1 :]
    for k in reversed(range(size)):
        right[k] /= matrix[k, k]
        right[:k] -= matrix[:k, k] * right[k]
    return right


def volumes(nodes: Float, rule: Rule) -> Float:
    """(M,Q) volume that belongs to each quadrature point of cells with ``nodes`` (M,k,3)."""
    # relative to the first node: large offsets don't cost digits
    local = nodes - nodes[:, :1]
    return determinant(reference_gradient(local, rule)) * rule.weight
