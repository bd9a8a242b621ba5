"""Symmetric tensors by their components xx yy zz xy yz zx, of second and fourth order."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from gpusim.arrays.array_types import Float

ROW = np.array([0, 1, 2, 0, 1, 2])
COLUMN = np.array([0, 1, 2, 1, 2, 0])
FULL = np.array([[0, 3, 5], [3, 1, 4], [5, 4, 2]])
"""(3,3) which of the six components stands there: ``a[FULL]`` is (3,3,…) of ``a`` (6,…)."""
ENGINEERING = np.array([1.0, 1.0, 1.0, 2.0, 2.0, 2.0])
"""Engineering strain over a tensor's components."""


def cofactors(a: Float) -> Float:
    """(6,…) the inverse times the determinant, of tensors (6,…)."""
    xx, yy, zz, xy, yz, zx = a
    return np.stack(
        [
            yy * zz - yz * yz,
            zz * xx - zx * zx,
            xx * yy - xy * xy,
            yz * zx - xy * zz,
            zx * xy - yz * xx,
            xy * yz - zx * yy,
        ]
    )


def first_row_product(a: Float, b: Float) -> Float:
    """(…) the first row of a times that of b, tensors (6,…): the determinant if b = cofactors."""
    return np.asarray(a[0] * b[0] + a[3] * b[3] + a[5] * b[5])


def symmetric_sum(matrices: Float) -> Float:
    """(6,…) components of a + a^t, of matrices (3,3,…)."""
    return np.asarray(matrices[ROW, COLUMN] + matrices[COLUMN, ROW])


def components_last(a: Float, shape: tuple[int, ...]) -> Float:
    """(…,n) in one piece, of components (n,P)."""
    return np.ascontiguousarray(a.T).reshape(*shape, len(a))


def _rearrangement() -> Float:
    """(21,36) from products of two tensors' components x <= y to the sandwich product."""
    table = np.zeros((6, 6, 6, 6))
    for row, (i, j) in enumerate(zip(ROW, COLUMN, strict=True)):
        for column, (k, m) in enumerate(zip(ROW, COLUMN, strict=True)):
            for x, y in ((FULL[i, k], FULL[j, m]), (FULL[i, m], FULL[j, k])):
                table[min(x, y), max(x, y), row, column] += 0.5
    return table[np.triu_indices(6)].reshape(21, 36)


_REARRANGED = _rearrangement()


def sandwich_product(a: Float, b: Float) -> Float:
    """(P,6,6) fourth-order tensors that send a symmetric e to the sum of a_k e b_k.

    ``a`` and ``b`` (K,6,P) are tensors whose sum of products is the same if they are exchanged.
    Components are plain, as those of moduli: times engineering strain they give a e b. One
    product with a constant matrix rearranges them and puts the components last.
    """
    products, at = np.empty((21, a.shape[-1])), 0
    for x in range(6):
        np.einsum("kn,kyn->yn", a[:, x], b[:, x:], out=products[at : at + 6 - x])
        at += 6 - x
    return np.asarray(products.T @ _REARRANGED).reshape(-1, 6, 6)


def strain_congruence(a: npt.NDArray[Any]) -> Float:
    """(…,6,6) T with a e a^t = T e for strains e with engineering shear, of matrices (…,3,3).

    If the rows of a are axes, T e is the strain along them. Stress turns with the inverse
    transpose, stiffness as T^t C T.
    """
    pairs = tuple(zip(ROW, COLUMN, strict=True))
    matrix = np.empty((*a.shape[:-2], 6, 6))
    for row, (i, j) in enumerate(pairs):
        for column, (k, m) in enumerate(pairs):
            value = a[..., i, k] * a[..., j, m]
            if k != m:
                value = 0.5 * (value + a[..., i, m] * a[..., j, k])
            matrix[..., row, column] = value if row < 3 else 2.0 * value
    return matrix
