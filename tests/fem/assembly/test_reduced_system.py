"""Models with constraints: their matrix, and solutions against Lagrange multipliers."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from benchmarks.solver.reference import reference_solution
from benchmarks.stability.hard_bodies import bar
from gpusim.fem import (
    Equations,
    Isotropic,
    Model,
    equations,
    face_force,
    solve,
    stress,
    tie,
    traction,
)
from gpusim.fem.assembly.assembly import assemble
from gpusim.fem.assembly.reduced_system import reduced_rows
from gpusim.fem.model.elimination import eliminate
from gpusim.fem.model.model import resolve_formulation
from gpusim.fem.sparse.block_rows import block_matrix
from gpusim.gpu import Device
from gpusim.mesh import Mesh, box, select_faces, select_nodes
from tests.support.fem_reference import Float, stiffness
from tests.support.tied_blocks import Divisions, blocks, by_multipliers, joined, joint

MATERIAL = Isotropic(200.0, 0.25)


def tied_model(lower: Divisions, upper: Divisions, kind: str = "hex8") -> Model:
    """Clamped below, two loads at the top and a moved corner there."""
    mesh = blocks(lower, upper, kind=kind)
    fixed = np.isclose(mesh.points[:, 2:], 0.0).repeat(3, axis=1)
    corner = select_nodes(mesh, bounds={"x_min": 2.0, "y_min": 3.0, "z_min": 2.0})[0]
    fixed[corner, 1] = True
    prescribed = np.zeros((2, *mesh.points.shape))
    prescribed[1, corner, 1] = 0.01
    top = select_faces(mesh, bounds={"z_min": 2.0})
    forces = np.stack(
        [face_force(mesh, top, total) for total in ((1.0, 0.0, 0.5), (0.0, 2.0, 0.0))]
    )
    return Model(mesh, MATERIAL, fixed, forces, prescribed=prescribed, constraints=[joined(mesh)])


@pytest.mark.parametrize("kind", ["hex8", "tet4"])
def test_the_matrix_is_that_of_the_congruence(kind: str) -> None:
    model = tied_model((2, 3, 1), (3, 4, 1), kind)
    found = eliminate(model)
    assert found is not None
    rows = assemble(model, resolve_formulation(model, None)).rows
    wanted = (found.matrix.T @ stiffness(model) @ found.matrix).toarray()
    np.testing.assert_allclose(
        block_matrix(reduced_rows(rows, found)).toarray(), wanted, atol=1e-12 * wanted.max()
    )


@pytest.mark.parametrize("kind", ["hex8", "tet4", "tet10", "hex20"])
def test_a_constant_stress_passes_a_tie(kind: str) -> None:
    """The patch test: the following mesh divides the faces of the other."""
    mesh = blocks((2, 3, 1), (4, 6, 2), kind=kind)
    fixed = np.isclose(mesh.points, 0.0)
    pull = traction(mesh, select_faces(mesh, bounds={"z_min": 2.0}), (0.0, 0.0, 3.0))
    pull += traction(mesh, select_faces(mesh, bounds={"x_min": 2.0}), (-1.0, 0.0, 0.0))
    model = Model(mesh, MATERIAL, fixed, pull, constraints=[joined(mesh)])
    solution = solve(model, backend="numpy", tolerance=1e-10)
    strain = np.array([-1.0 - 0.75, 0.25 - 0.75, 3.0 + 0.25]) / 200.0
    wanted = mesh.points * strain
    assert np.abs(solution.u - wanted).max() <= 1e-9 * np.abs(wanted).max()
    found = stress(model, solution.u).cell
    np.testing.assert_allclose(
        found, np.broadcast_to([-1.0, 0, 3, 0, 0, 0], found.shape), atol=3e-9
    )


@pytest.mark.parametrize("method", ["direct", "multigrid"])
@pytest.mark.parametrize("kind", ["hex8", "tet10"])
def test_solutions_and_their_errors(method: str, kind: str) -> None:
    model = tied_model((3, 4, 2), (5, 7, 3), kind)
    wanted = by_multipliers(model)
    for tolerance in (1e-4, 1e-9):
        solution = solve(model, backend="numpy", method=method, tolerance=tolerance)
        assert solution.converged and solution.method == method
        for u, right in zip(solution.u, wanted, strict=True):
            error = np.linalg.norm(u - right) / np.linalg.norm(right)
            assert error <= solution.error_estimate + 1e-12
        assert solution.energy_balance <= 10 * tolerance


def test_forces_of_supports_and_ties_hold_the_load() -> None:
    model = tied_model((3, 4, 2), (5, 7, 3))
    assert model.fixed is not None and model.forces is not None
    solution = solve(model, backend="numpy", tolerance=1e-10)
    total = model.forces.sum(axis=1)
    supports = np.where(model.fixed, solution.reactions, 0.0).sum(axis=1)
    np.testing.assert_allclose(supports, -total, atol=1e-9)
    below, above = (one.node_numbers() for one in joint(model.mesh))
    # what the tie does to one side it does to the other
    np.testing.assert_allclose(
        solution.reactions[:, below].sum(axis=1), -solution.reactions[:, above].sum(axis=1),
        atol=1e-9,
    )  # fmt: skip
    touched = np.zeros(len(model.mesh.points), dtype=bool)
    touched[np.concatenate([below, above])] = True
    assert not solution.reactions[:, ~touched & ~model.fixed.any(axis=1)].any()


def test_only_the_kept_unknowns_are_counted() -> None:
    solution = solve(tied_model((3, 4, 2), (5, 7, 3)), backend="numpy")
    assert solution.unknowns == 3 * (4 * 5 * 2 + 6 * 8 * 3) - 1


def test_a_device_solves_them_as_the_host_does(device: Device) -> None:
    """Rows of ties add up to zero, those of a slanted support don't."""
    tied = tied_model((3, 4, 2), (5, 7, 3))
    node = int(select_nodes(tied.mesh, bounds={"x_min": 2.0, "y_max": 0.0, "z_min": 2.0})[0])
    slanted = equations(tied.mesh, [([(node, "x", 1.0), (node, "z", 2.0)], 0.01)])
    model = replace(tied, constraints=[*tied.constraints, slanted])
    on_device: dict[str, Any] = {"device": device}
    on_host: dict[str, Any] = {"backend": "numpy"}
    found, wanted = (
        solve(model, method="multigrid", tolerance=1e-9, **where) for where in (on_device, on_host)
    )
    assert (found.backend, wanted.backend) == ("gpu", "numpy")
    assert found.converged and abs(found.iterations - wanted.iterations) <= 1
    np.testing.assert_allclose(found.u, wanted.u, atol=3e-9 * np.abs(wanted.u).max())


def test_turned_supports_against_a_turned_model() -> None:
    """A bar on slanted rollers along its axes, against the same bar turned to the axes."""
    turn = Rotation.from_rotvec([0.3, -0.5, 0.4]).as_matrix()
    straight = box((4.0, 1.0, 0.7), (8, 2, 2))
    rollers = np.isclose(straight.points, [0.0, 0.0, 0.35])
    moved = np.where(rollers, [0.02, 0.0, 0.0], 0.0)
    end = select_faces(straight, name="x_max")
    force = face_force(straight, end, (1.0, 2.0, -3.0))
    wanted = solve(
        Model(straight, MATERIAL, rollers, force, prescribed=moved),
        backend="numpy",
        tolerance=1e-10,
    )
    mesh = Mesh(straight.points @ turn.T, dict(straight.cells))
    rows = [
        ([3 * node + k for k in range(3)], turn[:, axis].tolist(), float(moved[node, axis]))
        for node, axis in np.argwhere(rollers).tolist()
    ]
    held = Equations.build(rows, mesh.points.size)
    model = Model(mesh, MATERIAL, forces=force @ turn.T, constraints=[held])
    for method in ("direct", "multigrid"):
        found = solve(model, backend="numpy", method=method, tolerance=1e-10)
        size = np.abs(wanted.u).max()
        np.testing.assert_allclose(found.u @ turn, wanted.u, atol=2e-9 * size)
        np.testing.assert_allclose(found.reactions @ turn, wanted.reactions, atol=1e-6)


def test_a_node_of_no_cell_spreads_its_force() -> None:
    """It moves as the mean of an end, whose nodes get equal shares of its force."""
    whole = box((2.0, 1.0, 1.0), (4, 2, 2))
    mesh = Mesh(np.concatenate([whole.points, [[5.0, 0.0, 0.0]]]), dict(whole.cells))
    last = whole.node_count
    end = select_nodes(mesh, bounds={"x_min": 2.0})
    rows = [
        ([3 * last + k, *(3 * end + k).tolist()], [9.0, *[-1.0] * 9], 0.0) for k in range(3)
    ]  # fmt: skip
    fixed = np.isclose(mesh.points[:, :1], 0.0).repeat(3, axis=1)
    forces, shared = np.zeros((2, *mesh.points.shape))
    forces[last] = [1.0, -2.0, 0.5]
    shared[end] = forces[last] / 9.0
    spread = Equations.build(rows, mesh.points.size)
    found = solve(Model(mesh, MATERIAL, fixed, forces, constraints=[spread]), backend="numpy")
    wanted = solve(Model(mesh, MATERIAL, fixed, shared), backend="numpy")
    np.testing.assert_allclose(found.u[:last], wanted.u[:last], atol=1e-6 * np.abs(wanted.u).max())
    np.testing.assert_allclose(found.u[last], found.u[end].mean(axis=0), atol=1e-15)


def periodic_rows(mesh: Mesh, gradient: Float) -> list[tuple[list[int], list[float], float]]:
    """The end at x = 2 moves as that at x = 0, and by 2 ``gradient`` more."""
    pairs = zip(
        select_nodes(mesh, bounds={"x_max": 0.0}), select_nodes(mesh, bounds={"x_min": 2.0}),
        strict=True,
    )  # fmt: skip
    return [
        ([3 * far + k, 3 * near + k], [1.0, -1.0], 2.0 * gradient[k])
        for near, far in pairs
        for k in range(3)
    ]


def test_right_sides_pull_a_periodic_cell() -> None:
    """u(2) - u(0) = 2 e: a uniform strain along x, held at one node and against turning."""
    mesh = box((2.0, 1.0, 1.0), (4, 2, 2))
    held = Equations.build(periodic_rows(mesh, np.array([0.01, 0.0, 0.0])), mesh.points.size)
    fixed = np.zeros(mesh.points.shape, dtype=bool)
    fixed[0] = True
    fixed[select_nodes(mesh, bounds={"x_max": 0.0, "y_min": 1.0, "z_max": 0.0}), 2] = True
    model = Model(mesh, MATERIAL, fixed, constraints=[held])
    for method in ("direct", "multigrid"):
        u = solve(model, backend="numpy", method=method, tolerance=1e-10).u
        np.testing.assert_allclose(u, mesh.points * [0.01, -0.0025, -0.0025], atol=1e-11)


def test_a_tie_across_a_slender_bar_keeps_its_digits() -> None:
    """Two halves whose meshes match, tied: what one bar does, a thousand times as long as thick."""
    whole = bar((1000.0, 1.0, 0.7), (100, 1, 1))
    wanted = reference_solution(whole, {"hex8": "incompatible"}).u
    cut = np.flatnonzero(np.isclose(whole.mesh.points[:, 0], 500.0))
    cells = whole.mesh.cells["hex8"].copy()
    right = whole.mesh.points[cells].mean(axis=1)[:, 0] > 500.0
    again = np.arange(whole.mesh.node_count)
    again[cut] = whole.mesh.node_count + np.arange(len(cut))
    cells[right] = again[cells[right]]
    points = np.concatenate([whole.mesh.points, whole.mesh.points[cut]])
    assert whole.fixed is not None
    fixed, forces = np.zeros(points.shape, dtype=bool), np.zeros((2, *points.shape))
    fixed[: len(whole.fixed)], forces[:, : len(whole.fixed)] = whole.fixed, whole.load_cases
    mesh = Mesh(points, {"hex8": cells})
    faces = select_faces(mesh, bounds={"x_min": 500.0, "x_max": 500.0}, normal="+x")
    held = tie(mesh, faces, again[cut])
    found = solve(Model(mesh, whole.materials, fixed, forces, constraints=[held]), backend="numpy")
    for u, one in zip(found.u, wanted, strict=True):
        error = np.abs(u[: len(whole.fixed)] - one).max() / np.abs(one).max()
        assert error <= found.error_estimate <= 1e-6
