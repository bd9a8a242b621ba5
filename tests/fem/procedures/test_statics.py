"""Statics: arguments that one kind of analysis has and the other hasn't, and what both tell."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import gpusim as gs
from gpusim.errors import InputError
from gpusim.fem import face_force, solve
from gpusim.fem.model.constraints import equations
from gpusim.mesh import Mesh, box, select_faces


def cantilever(cases: int = 1) -> gs.Model:
    mesh = box((1.0, 0.1, 0.1), (4, 1, 1))
    fixed = np.isclose(mesh.points[:, :1], 0.0).repeat(3, axis=1)
    force = face_force(mesh, select_faces(mesh, name="x_max"), (0.0, 0.0, 1e4))
    forces = force if cases == 1 else np.repeat(force[None], cases, axis=0)
    return gs.Model(mesh, [gs.Isotropic(210e9, 0.3)], fixed, forces)


@pytest.mark.parametrize(
    "factors", [0.5, "a", [], [np.nan], [[1.0], [1.0, 2.0]], [[1.0, 2.0]], [[[1.0]]]]
)
def test_factors_are_one_a_step(factors: Any) -> None:
    with pytest.raises(InputError, match=r"solve: factors; got .*; expected \(K,\) finite numbers"):
        solve(cantilever(), geometry="nonlinear", factors=factors, backend="numpy")


def test_several_load_cases_have_factors_of_their_own() -> None:
    for factors in (None, [1.0], [[1.0]], [1.0, 1.0]):
        with pytest.raises(InputError, match=r"solve: factors; .*; expected \(K, 2\)"):
            solve(cantilever(2), geometry="nonlinear", factors=factors, backend="numpy")
    both = solve(cantilever(2), geometry="nonlinear", factors=[[0.5, 0.5]], backend="numpy")
    one = solve(cantilever(), geometry="nonlinear", factors=[[1]], backend="numpy")
    np.testing.assert_allclose(both.u, one.u, rtol=0.0, atol=1e-9 * np.abs(one.u).max())


def test_what_an_analysis_would_leave_aside_is_refused() -> None:
    model = cantilever()
    with pytest.raises(InputError, match=r"solve: factors; got .*; expected none by linear theory"):
        solve(model, factors=[0.5, 1.0], backend="numpy")
    with pytest.raises(
        InputError, match=r"solve: start; .*; expected none: equilibria are followed"
    ):
        solve(model, geometry="nonlinear", start=np.zeros(model.mesh.points.shape))


def test_both_tell_of_nodes_of_no_cell_and_count_what_is_solved_for() -> None:
    one = cantilever()
    mesh = Mesh(np.concatenate([one.mesh.points, [[2.0, 0.0, 0.0]]]), dict(one.mesh.cells))
    assert one.fixed is not None and one.forces is not None
    fixed, forces = (
        np.concatenate([a, np.zeros((1, 3), a.dtype)]) for a in (one.fixed, one.forces)
    )
    joined = equations(mesh, [([(19, "x", 1.0), (18, "x", -1.0)], 0.0)])
    model = gs.Model(mesh, one.materials, fixed, forces, constraints=[joined])
    found = [solve(model, geometry=name, backend="numpy") for name in ("linear", "nonlinear")]
    for solution in found:
        assert "1 nodes belong to no cell" in solution.warnings[0]
        assert solution.unknowns == 3 * 16 - 1
