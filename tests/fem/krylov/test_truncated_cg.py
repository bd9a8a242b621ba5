"""Conjugate gradients that end early: how far they go, and what they say of indefinite matrices."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

from gpusim.errors import NotConverged
from gpusim.fem.krylov.cg import Preconditioner
from gpusim.fem.krylov.truncated_cg import truncated_cg

Float = npt.NDArray[np.float64]
N = 50


class Inverse(Preconditioner):
    """By a matrix."""

    def __init__(self, inverse: Float) -> None:
        super().__init__()
        self._inverse = inverse

    def apply(self, r: Float) -> Float:
        return r @ self._inverse


def problem(lowest: float) -> tuple[Float, Float, Float]:
    """A matrix with this least eigenvalue, an inverse near to that of its size, and right sides."""
    random = np.random.default_rng(4)
    basis, _ = np.linalg.qr(random.normal(size=(N, N)))
    values = np.linspace(1.0, 5.0, N)
    values[0] = lowest
    near = np.abs(values) * random.uniform(0.7, 1.3, N)
    return basis @ np.diag(values) @ basis.T, basis @ np.diag(1.0 / near) @ basis.T, basis[:3]


@pytest.mark.parametrize("forcing", [1e-2, 1e-6, 1e-10])
def test_residuals_fall_as_far_as_asked_and_not_much_further(forcing: float) -> None:
    matrix, inverse, right = problem(0.5)
    found = truncated_cg(lambda v: v @ matrix, Inverse(inverse), right, forcing)
    assert found is not None
    residual = right - found[0] @ matrix
    norm = np.sqrt(np.einsum("ln,nm,lm->l", residual, inverse, residual))
    first = np.sqrt(np.einsum("ln,nm,lm->l", right, inverse, right))
    assert found[2] == pytest.approx((norm / first).max(), rel=1e-3)
    assert (norm <= 1.01 * forcing * first).all() and (norm >= 1e-3 * forcing * first).any()


def test_an_indefinite_matrix_has_no_solution_here() -> None:
    matrix, inverse, right = problem(-0.5)
    assert truncated_cg(lambda v: v @ matrix, Inverse(inverse), right, 1e-6) is None
    matrix, inverse, right = problem(0.5)
    assert truncated_cg(lambda v: v @ matrix, Inverse(-inverse), right, 1e-6) is None


def test_a_right_hand_side_of_rounding_is_solved_as_well() -> None:
    # in the last iteration of Newton's method nothing else is left
    matrix, inverse, right = problem(0.5)
    found = truncated_cg(lambda v: v @ matrix, Inverse(inverse), 1e-100 * right, 1e-6)
    assert found is not None
    exact = np.linalg.solve(matrix, right.T).T
    assert np.abs(1e100 * found[0] - exact).max() <= 1e-5 * np.abs(exact).max()


def test_nothing_takes_no_iteration_and_nan_is_refused() -> None:
    matrix, inverse, right = problem(0.5)
    found = truncated_cg(lambda v: v @ matrix, Inverse(inverse), 0.0 * right, 1e-6)
    assert found is not None and found[1] == 0 and not found[0].any()
    with pytest.raises(NotConverged, match="finite"):
        truncated_cg(lambda v: np.nan * v, Inverse(inverse), right, 1e-6)


def test_running_out_of_iterations_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("gpusim.fem.krylov.truncated_cg._MOST_ITERATIONS", 3)
    matrix, inverse, right = problem(0.5)
    with pytest.raises(NotConverged, match="3 iterations"):
        truncated_cg(lambda v: v @ matrix, Inverse(inverse), right, 1e-12)
