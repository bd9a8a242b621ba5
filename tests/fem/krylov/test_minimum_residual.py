"""Minimum residuals: matrices of any sign, and how they end."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

from gpusim.errors import NotConverged
from gpusim.fem.krylov.minimum_residual import minimum_residual

Float = npt.NDArray[np.float64]
N = 60


def problem(values: Float) -> tuple[Float, Float, Float]:
    """A symmetric matrix of these eigenvalues, the inverse of a definite one near to its size, and
    a right-hand side."""
    random = np.random.default_rng(4)
    basis, _ = np.linalg.qr(random.normal(size=(N, N)))
    near = np.abs(values) * random.uniform(0.7, 1.3, N) + 0.05
    return basis @ np.diag(values) @ basis.T, basis @ np.diag(1.0 / near) @ basis.T, basis.sum(1)


@pytest.mark.parametrize("lowest", [0.5, -0.3, 1e-4, -1e-4])
def test_matrices_of_any_sign_are_solved(lowest: float) -> None:
    values = np.linspace(1.0, 5.0, N)
    values[0] = lowest
    matrix, inverse, right = problem(values)
    x, iterations = minimum_residual(
        lambda v: v @ matrix, lambda r: r @ inverse, right[None], 1e-10
    )
    residual = right - matrix @ x[0]
    norm = np.sqrt(residual @ inverse @ residual / (right @ inverse @ right))
    # what is compared by recursion is the true one, but for rounding
    assert norm <= 2e-10
    assert np.abs(x[0] - np.linalg.solve(matrix, right)).max() <= 1e-5 * np.abs(x).max()
    assert iterations < 30


def test_a_nearly_singular_matrix_is_no_excuse() -> None:
    # beside |A| |x| any residual is small there: that isn't asked
    values = np.linspace(1.0, 5.0, N)
    values[0] = 1e-7
    matrix, inverse, right = problem(values)
    x, _ = minimum_residual(lambda v: v @ matrix, lambda r: r @ inverse, right[None], 1e-8)
    exact = np.linalg.solve(matrix, right)
    assert np.abs(x[0] - exact).max() <= 1e-2 * np.abs(exact).max()


def test_nothing_to_solve_takes_no_iteration() -> None:
    x, iterations = minimum_residual(lambda v: v, lambda r: r, np.zeros((1, 4)), 1e-8)
    assert iterations == 0 and not x.any()


@pytest.mark.parametrize("scale", [-1.0, np.nan])
def test_a_preconditioner_that_is_not_definite_is_refused(scale: float) -> None:
    with pytest.raises(NotConverged, match="positive definite"):
        minimum_residual(lambda v: v, lambda r: scale * r, np.ones((1, 4)), 1e-8)


def test_running_out_of_iterations_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("gpusim.fem.krylov.minimum_residual._PER_DECIMAL", 0.25)
    matrix, inverse, right = problem(np.linspace(1.0, 5.0, N))
    with pytest.raises(NotConverged, match="3 iterations"):
        minimum_residual(lambda v: v @ matrix, lambda r: r @ inverse, right[None], 1e-12)
