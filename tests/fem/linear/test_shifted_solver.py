"""Which solver eigenvalues get."""

from __future__ import annotations

import numpy as np
import pytest

import gpusim as gs
from gpusim.fem.assembly.equation_of_motion import EquationOfMotion
from gpusim.fem.linear.shifted_solver import ShiftedSolver, definite_solver
from gpusim.fem.linear.solve_plan import Clock, Options
from gpusim.fem.model.model import resolve_formulation

STEEL = gs.Isotropic(200e9, 0.3, density=8000.0)


def solver_of(thickness: float, method: str) -> ShiftedSolver:
    """Of a plate of 10 x 10 for which a static solution takes multigrid."""
    mesh = gs.mesh.box(size=(10.0, 10.0, thickness), divisions=(24, 24, 3))
    fixed = np.repeat(mesh.points[:, :1] < 1e-9, 3, axis=1)
    model = gs.Model(mesh, STEEL, fixed)
    formulation = resolve_formulation(model, None)
    equation = EquationOfMotion.of(model, formulation, "exact")
    options = Options(method, None, "numpy", 1e-8, None, None, None, formulation, Clock())
    return definite_solver(equation, 0.0, options)


def test_flat_bodies_take_factors(monkeypatch: pytest.MonkeyPatch) -> None:
    # statics would take a cycle
    monkeypatch.setattr("gpusim.fem.linear.solve_plan.multigrid_seconds", lambda unknowns: 0.01)
    flat, thick = solver_of(0.05, "auto"), solver_of(2.0, "auto")
    assert flat.exact and "makes little of some motions" in flat.plan.reasons["solver"]
    assert not thick.exact and thick.weakest > 0.1
    assert not solver_of(0.05, "multigrid").exact
