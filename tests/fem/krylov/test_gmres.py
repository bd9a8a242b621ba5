"""Generalised minimum residuals against a direct solution."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

from gpusim.errors import NotConverged
from gpusim.fem.krylov.gmres import gmres

Float = npt.NDArray[np.float64]


def test_a_change_of_low_rank_takes_one_iteration_more_than_its_rank() -> None:
    rng = np.random.default_rng(3)
    known = np.diag(rng.uniform(1.0, 1e6, 90))
    matrix = known @ (np.eye(90) + rng.normal(size=(90, 4)) @ rng.normal(size=(4, 90)))
    right = rng.normal(size=(1, 90))

    def solved(right: Float) -> tuple[Float, int]:
        return gmres(lambda x: x @ matrix.T, lambda r: r / np.diag(known), right, 1e-10)

    found, iterations = solved(right)
    expected = np.linalg.solve(matrix, right[0])
    assert np.abs(found[0] - expected).max() <= 1e-7 * np.abs(expected).max()
    assert iterations == 5
    nothing, iterations = solved(np.zeros((1, 90)))
    assert iterations == 0 and not nothing.any()


def test_a_matrix_without_an_answer_is_told() -> None:
    turn = np.roll(np.eye(300), 1, axis=0)
    with pytest.raises(NotConverged, match="got 200 iterations"):
        gmres(lambda x: x @ turn.T, lambda r: r, np.eye(300)[:1], 1e-6)
    with pytest.raises(NotConverged, match="finite"):
        gmres(lambda x: np.nan * x, lambda r: r, np.eye(300)[:1], 1e-6)
