"""Tangents in Newton's method: what is kept, what is updated, and indefinite ones."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt
import pytest
from scipy.sparse import csr_matrix

import gpusim as gs
from gpusim.fem.assembly.element_responses import element_responses
from gpusim.fem.assembly.equation import Equation, Tangent
from gpusim.fem.linear.direct_solver import DirectSolver
from gpusim.fem.linear.multigrid_solver import MultigridSolver
from gpusim.fem.linear.solve_plan import Clock, Options
from gpusim.fem.linear.tangent_solver import TangentSolver
from gpusim.fem.model.model import resolve_formulation
from gpusim.fem.sparse.block_rows import block_matrix

Float = npt.NDArray[np.float64]
METHODS = ("direct", "multigrid")


def bar() -> Equation:
    """Clamped at x = 0; it buckles at a strain of about 0.01."""
    mesh = gs.mesh.box(size=(4.0, 1.0, 1.0), divisions=(8, 2, 2))
    fixed = np.repeat(mesh.points[:, :1] < 1e-9, 3, axis=1)
    model = gs.Model(mesh, gs.Isotropic(100.0, 0.3), fixed)
    return Equation(model, element_responses(model, resolve_formulation(model, None)))


def tangent_solver(equation: Equation, method: str) -> TangentSolver:
    formulation = resolve_formulation(equation.model, None)
    return TangentSolver(
        equation, Options(method, None, "numpy", 1e-8, None, None, None, formulation, Clock())
    )


def exact(equation: Equation, tangent: Tangent, force: Float, given: Float) -> Float:
    """By a dense solver."""
    matrix = block_matrix(tangent.assembled.rows).toarray()
    free = equation.free.ravel()
    du = np.where(equation.free, 0.0, given).ravel()
    right = force.ravel() - matrix @ du
    du[free] = np.linalg.solve(matrix[np.ix_(free, free)], right[free])
    return du.reshape(force.shape)


def pressed(equation: Equation, strain: float) -> Float:
    """Displacements of a bar pressed along its length."""
    return equation.model.mesh.points * [-strain, 0.0, 0.0]


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("strain", [0.0, 0.005, 0.6])
def test_corrections_are_right_for_definite_and_indefinite_tangents(
    method: str, strain: float
) -> None:
    equation = bar()
    solver = tangent_solver(equation, method)
    random = np.random.default_rng(1)
    force = random.normal(size=(2, *equation.model.mesh.points.shape))
    given = np.where(equation.free, 0.0, random.normal(size=force.shape))
    tangent = equation.linearised(pressed(equation, strain), np.ones(1))
    found = solver.correction(tangent, force, given, 1e-8)
    wanted = np.stack([exact(equation, tangent, *one) for one in zip(force, given, strict=True)])
    assert np.abs(found.du - wanted).max() <= 1e-6 * np.abs(wanted).max()
    matrix = block_matrix(tangent.assembled.rows).toarray()
    free = equation.free.ravel()
    definite = np.linalg.eigvalsh(matrix[np.ix_(free, free)])[0] > 0.0
    assert found.definite == definite == (strain < 0.01)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("strain", [0.00675, 0.00681])
def test_an_indefinite_tangent_is_seen_whatever_forces_act(method: str, strain: float) -> None:
    # the bar buckles at a strain of 0.00678, which forces along it don't show on levels
    equation = bar()
    solver = tangent_solver(equation, method)
    along = np.where(equation.model.mesh.points[:, :1] == 4.0, [1.0, 0.0, 0.0], 0.0)[None]
    tangent = equation.linearised(pressed(equation, strain), np.ones(1))
    found = solver.correction(tangent, along, np.zeros_like(along), 1e-4)
    assert (found.definite and solver.definite(tangent)) == (strain < 0.00678)
    assert found.definite or method == "direct"


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("strain", [0.0, 0.6])
def test_a_skew_part_is_solved_with(method: str, strain: float) -> None:
    equation = bar()
    random = np.random.default_rng(1)
    force = random.normal(size=(2, *equation.model.mesh.points.shape))
    tangent = equation.linearised(pressed(equation, strain), np.ones(1))
    free = equation.free.ravel()
    # of the nodes at the end, as from the edges of a pressed face
    end = np.repeat(equation.model.mesh.points[:, 0] == 4.0, 3)
    part = np.where(end[:, None] & end, random.normal(size=(len(free), len(free))), 0.0)
    skew = csr_matrix(0.1 * (part - part.T))
    solver = tangent_solver(equation, method)
    found = solver.correction(replace(tangent, skew=skew), force, np.zeros_like(force), 1e-8)
    whole = block_matrix(tangent.assembled.rows).toarray() + skew.toarray()
    wanted = np.zeros((2, len(free)))
    wanted[:, free] = np.linalg.solve(whole[np.ix_(free, free)], force.reshape(2, -1)[:, free].T).T
    # levels that round to float32 leave 1e-5
    assert np.abs(found.du.reshape(2, -1) - wanted).max() <= 1e-5 * np.abs(wanted).max()
    assert found.definite == (strain == 0.0)
    symmetric = solver.correction(tangent, force, np.zeros_like(force), 1e-8).du
    assert np.abs(found.du - symmetric).max() > 1e-2 * np.abs(wanted).max()


@pytest.mark.parametrize("method", METHODS)
def test_factors_and_levels_are_kept_while_nodes_hardly_move(
    method: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    equation = bar()
    solver = tangent_solver(equation, method)
    updates: list[int] = []
    for kind in (DirectSolver, MultigridSolver):
        update = kind.update
        monkeypatch.setattr(
            kind, "update", lambda *data, own=update: (updates.append(1), own(*data))[1]
        )
    force = np.random.default_rng(1).normal(size=(1, *equation.model.mesh.points.shape))
    given = np.zeros_like(force)
    for strain, made in ((0.002, 0), (0.00201, 0), (0.003, 1), (0.00299, 1)):
        tangent = equation.linearised(pressed(equation, strain), np.ones(1))
        found = solver.correction(tangent, force, given, 1e-8)
        wanted = exact(equation, tangent, force[0], given[0])
        assert np.abs(found.du[0] - wanted).max() <= 1e-6 * np.abs(wanted).max()
        assert len(updates) == made


def test_one_indefinite_tangent_is_prepared_once(monkeypatch: pytest.MonkeyPatch) -> None:
    equation = bar()
    solver = tangent_solver(equation, "direct")
    asked: list[int] = []
    linearised = equation.linearised
    monkeypatch.setattr(
        equation, "linearised", lambda *data: (asked.append(1), linearised(*data))[1]
    )
    tangent = linearised(pressed(equation, 0.6), np.ones(1))
    force = np.random.default_rng(1).normal(size=(1, *equation.model.mesh.points.shape))
    first = solver.correction(tangent, force, np.zeros_like(force), 1e-8)
    second = solver.correction(tangent, 2.0 * force, np.zeros_like(force), 1e-8)
    assert not first.definite and len(asked) == 1
    assert np.abs(second.du - 2.0 * first.du).max() <= 1e-6 * np.abs(second.du).max()


def test_nothing_to_correct_takes_no_work() -> None:
    equation = bar()
    solver = tangent_solver(equation, "auto")
    zero = np.zeros((1, *equation.model.mesh.points.shape))
    tangent = equation.linearised(zero[0], np.ones(1))
    found = solver.correction(tangent, zero, zero, 1e-8)
    assert found.iterations == 0 and not found.du.any() and solver.plan is None


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("strain", [0.0, 0.6])
def test_constraints_hold_in_corrections(method: str, strain: float) -> None:
    plain = bar()
    mesh, random = plain.model.mesh, np.random.default_rng(1)
    end = np.flatnonzero(np.isclose(mesh.points[:, 0], 4.0))
    # nodes of the end keep their distance along x from the first one, which differs by 0.3
    rows = [([(node, "x", 1.0), (end[0], "x", -1.0)], 0.3) for node in end[1:]]
    held = replace(plain.model, constraints=[gs.fem.equations(mesh, rows)])
    equation = Equation(held, element_responses(held, {"hex8": "incompatible"}))
    u = pressed(equation, strain)
    tangent = equation.linearised(u, np.ones(1))
    force = random.normal(size=(1, *mesh.points.shape))
    given = equation.missing(u, np.ones(1))[None]
    du = tangent_solver(equation, method).correction(tangent, force, given, 1e-9).du[0]
    assert np.abs((u + du)[end[1:], 0] - (u + du)[end[0], 0] - 0.3).max() <= 1e-9
    left = force[0] - (block_matrix(tangent.assembled.rows) @ du.ravel()).reshape(-1, 3)
    assert np.abs(equation.unbalanced(left)).max() <= 1e-6 * np.abs(force).max()
    # forces of constraints are in balance among themselves
    assert abs(left[end, 0].sum()) <= 1e-6 * np.abs(force).max()
