"""Generalised minimum residuals: matrices of any kind, and how they end."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

from gpusim.errors import NotConverged
from gpusim.fem.krylov.gmres import gmres

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
@pytest.mark.parametrize("skew", [0.0, 0.2])
def test_matrices_of_any_sign_are_solved(lowest: float, skew: float) -> None:
    values = np.linspace(1.0, 5.0, N)
    values[0] = lowest
    matrix, inverse, right = problem(values)
    part = np.random.default_rng(5).normal(size=(N, N))
    matrix = matrix + skew * (part - part.T)
    x, iterations = gmres(lambda v: v @ matrix.T, lambda r: r @ inverse, right[None], 1e-10)
    residual = right - matrix @ x[0]
    norm = np.sqrt(residual @ inverse @ residual / (right @ inverse @ right))
    # what is told by the small system is the true one, but for rounding
    assert norm <= 2e-10
    assert np.abs(x[0] - np.linalg.solve(matrix, right)).max() <= 1e-5 * np.abs(x).max()
    assert iterations < (30 if skew == 0.0 else N)


def test_a_change_of_low_rank_takes_one_iteration_more_than_its_rank() -> None:
    rng = np.random.default_rng(3)
    known = np.diag(rng.uniform(1.0, 1e6, 90))
    matrix = known @ (np.eye(90) + rng.normal(size=(90, 4)) @ rng.normal(size=(4, 90)))
    right = rng.normal(size=(1, 90))
    found, iterations = gmres(lambda x: x @ matrix.T, lambda r: r / np.diag(known), right, 1e-10)
    expected = np.linalg.solve(matrix, right[0])
    assert np.abs(found[0] - expected).max() <= 1e-7 * np.abs(expected).max()
    assert iterations == 5


def test_a_nearly_singular_matrix_is_no_excuse() -> None:
    # beside |A| |x| any residual is small there: that isn't asked
    values = np.linspace(1.0, 5.0, N)
    values[0] = 1e-7
    matrix, inverse, right = problem(values)
    x, _ = gmres(lambda v: v @ matrix, lambda r: r @ inverse, right[None], 1e-8)
    exact = np.linalg.solve(matrix, right)
    assert np.abs(x[0] - exact).max() <= 1e-2 * np.abs(exact).max()


def test_nothing_to_solve_takes_no_iteration() -> None:
    x, iterations = gmres(lambda v: v, lambda r: r, np.zeros((1, 4)), 1e-8)
    assert iterations == 0 and not x.any()


@pytest.mark.parametrize("scale", [-1.0, np.nan])
def test_a_preconditioner_that_is_not_definite_is_refused(scale: float) -> None:
    with pytest.raises(NotConverged, match="positive definite"):
        gmres(lambda v: v, lambda r: scale * r, np.ones((1, 4)), 1e-8)


def test_running_out_of_iterations_is_told() -> None:
    turn = np.roll(np.eye(300), 1, axis=0)
    with pytest.raises(NotConverged, match="got 200 iterations"):
        gmres(lambda x: x @ turn.T, lambda r: r, np.eye(300)[:1], 1e-6)
