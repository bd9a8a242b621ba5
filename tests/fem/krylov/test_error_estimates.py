"""What rounding leaves is part of the tolerance: conjugate gradients make room for it."""

from __future__ import annotations

import numpy as np
import pytest

import gpusim as gs
from gpusim.fem import Isotropic, Model, solve
from gpusim.fem.krylov import outer_iteration as iteration
from gpusim.fem.krylov.error_estimates import RoundingError


def cube() -> Model:
    mesh = gs.mesh.box(size=(1.0, 0.8, 0.7), divisions=(7, 6, 5))
    fixed = np.isclose(mesh.points[:, :1], 0.0).repeat(3, axis=1)
    forces = np.random.default_rng(3).normal(size=(3, *mesh.points.shape))
    return Model(mesh, [Isotropic(1.0, 0.3)], fixed=fixed, forces=forces)


def test_an_estimate_that_is_too_large_by_what_rounding_leaves_is_made_smaller(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(iteration, "VISIBLE", 0.5)
    rounding = 0.0
    monkeypatch.setattr(RoundingError, "__call__", lambda self, system, u: rounding)
    for tolerance in np.geomspace(1e-4, 1e-7, 16):
        alone = solve(cube(), backend="numpy", method="multigrid", tolerance=tolerance)
        if alone.error_estimate > 0.65 * tolerance:
            break
    else:
        raise AssertionError("none ends near its tolerance")
    # a little more than there is room for
    rounding = 1.02 * tolerance - alone.error_estimate
    solution = solve(cube(), backend="numpy", method="multigrid", tolerance=tolerance)
    assert solution.converged and rounding < solution.error_estimate <= tolerance
    assert solution.iterations > alone.iterations
    exact = solve(cube(), backend="numpy", method="direct", tolerance=1e-9)
    assert np.abs(solution.u - exact.u).max() <= tolerance * np.abs(exact.u).max()
    # it wouldn't have been by itself
    monkeypatch.setattr(iteration, "_LITTLE", 0.0)
    short = solve(cube(), backend="numpy", method="multigrid", tolerance=tolerance)
    assert not short.converged and "rounding of the stiffness" in short.message
