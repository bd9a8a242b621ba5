"""Components of symmetric tensors against full matrices."""

from __future__ import annotations

import numpy as np

from gpusim.fem.materials.symmetric_tensors import (
    COLUMN,
    ENGINEERING,
    FULL,
    ROW,
    cofactors,
    components_last,
    first_row_product,
    sandwich_product,
    symmetric_sum,
)

RANDOM = np.random.default_rng(8)
A, B, STRAIN = RANDOM.normal(size=(3, 6, 5))


def matrices(components: np.ndarray) -> np.ndarray:
    """(P,3,3)."""
    return np.moveaxis(components[FULL], 2, 0)


def test_components_of_a_matrix() -> None:
    full = A[FULL]
    np.testing.assert_array_equal(full, full.swapaxes(0, 1))
    np.testing.assert_array_equal(full[ROW, COLUMN], A)
    assert [int(FULL[i, j]) for i, j in ((0, 1), (1, 2), (2, 0))] == [3, 4, 5]
    np.testing.assert_allclose(symmetric_sum(RANDOM.normal(size=(3, 3, 5)) * 0 + full), 2.0 * A)


def test_components_last_lie_in_one_piece() -> None:
    found = components_last(A[:, :4], (2, 2))
    assert found.shape == (2, 2, 6) and found.flags.c_contiguous
    np.testing.assert_array_equal(found[1, 0], A[:, 2])


def test_cofactors_and_determinant() -> None:
    minors = cofactors(A)
    determinant = first_row_product(A, minors)
    np.testing.assert_allclose(determinant, np.linalg.det(matrices(A)), rtol=1e-12)
    inverse = np.moveaxis(np.linalg.inv(matrices(A)), 0, 2)[ROW, COLUMN]
    np.testing.assert_allclose(minors / determinant, inverse, rtol=1e-11)


def test_sandwich_product_sends_e_to_the_symmetric_part_of_a_e_b() -> None:
    tensor = sandwich_product(0.5 * np.stack([A, B]), np.stack([B, A]))
    found = np.einsum("pab,bp->ap", tensor, STRAIN * ENGINEERING[:, None])
    product = np.moveaxis(matrices(A) @ matrices(STRAIN) @ matrices(B), 0, 2)
    np.testing.assert_allclose(found, 0.5 * symmetric_sum(product), rtol=1e-12, atol=1e-14)
