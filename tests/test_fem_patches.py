"""Patches as smoothers of nearly incompressible bodies."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.sparse import csr_matrix
from scipy.sparse.linalg import splu

from gpusim.fem import Isotropic, Model, solve
from gpusim.fem.assembly.assembly import assemble, lattice_stencil
from gpusim.fem.assembly.block_rows import block_matrix
from gpusim.fem.model.formulation import resolve_formulation
from gpusim.fem.multigrid.patches import make_patches
from gpusim.mesh import box


def rubber(size: int, nu: float = 0.4999) -> Model:
    mesh = box((1.0, 1.1, 0.9), (size, size, size - 1))
    fixed = np.zeros(mesh.points.shape, dtype=bool)
    fixed[mesh.points[:, 0] == 0.0] = True
    forces = np.zeros(mesh.points.shape)
    forces[mesh.points[:, 0] == 1.0] = (0.3, 1.0, 0.0)
    return Model(mesh, [Isotropic(1.0, nu)], fixed, forces)


def test_patches_are_exact_local_solutions() -> None:
    model = rubber(6)
    parts = assemble(model, resolve_formulation(model, "bbar"))
    assert parts.lattice is not None and model.fixed is not None
    free = ~model.fixed
    matrix = block_matrix(parts.rows)
    np.testing.assert_allclose(
        lattice_stencil(parts.groups[0], parts.lattice).matrix.toarray(),
        matrix.toarray(),
        atol=1e-12,
    )
    patches = make_patches(matrix, parts.groups[0], parts.lattice, free)
    assert patches is not None
    dense = csr_matrix(matrix).toarray()
    r = np.random.default_rng(2).normal(size=(2, 3 * model.mesh.node_count))
    wanted = np.zeros_like(r)
    lattice = parts.lattice
    for corner in np.ndindex(*((n + 1) // 2 for n in lattice.node.shape)):
        box_of = tuple(slice(max(2 * k - 1, 0), 2 * k + 2) for k in corner)
        nodes = lattice.node[box_of].ravel()
        unknowns = (3 * nodes[:, None] + np.arange(3)).ravel()
        unknowns = unknowns[free.ravel()[unknowns]]
        local = np.linalg.inv(dense[np.ix_(unknowns, unknowns)])
        wanted[:, unknowns] += r[:, unknowns] @ local
    np.testing.assert_allclose(patches.apply(r), wanted, atol=1e-9 * np.abs(wanted).max())


def test_nearly_incompressible_bodies_converge_in_few_iterations(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    model = rubber(12)
    # pressures would be cheaper here
    monkeypatch.setattr("gpusim.fem.methods.mixed_solver", lambda *_: None)
    solution = solve(model, backend="numpy", method="multigrid", formulation="bbar")
    assert solution.converged and "patches" in solution.message
    assert solution.iterations <= 60  # Jacobi smoothing takes 240
    rows = assemble(model, resolve_formulation(model, "bbar")).rows
    free = ~model.fixed.ravel()  # type: ignore[union-attr]
    exact = splu(block_matrix(rows).tocsr()[free][:, free].tocsc()).solve(
        model.load_cases[0].ravel()[free]
    )
    error = np.abs(solution.u.ravel()[free] - exact).max() / np.abs(exact).max()
    assert error <= solution.error_estimate <= 1e-6


def test_ordinary_materials_do_without() -> None:
    solution = solve(rubber(10, 0.3), backend="numpy", method="multigrid")
    assert solution.converged and "patches" not in solution.message
