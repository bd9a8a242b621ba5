"""Nearly incompressible bricks: displacements and pressures together."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from scipy.linalg import eigh

from gpusim.fem import Isotropic, Model, Orthotropic, solve
from gpusim.fem.assembly.assembly import assemble
from gpusim.fem.incompressibility.pressure_preconditioners import PressureChebyshev, PressureScaling
from gpusim.fem.incompressibility.volume_split import VolumeSplit, split_volume
from gpusim.fem.sparse.block_rows import block_matrix
from gpusim.mesh import Mesh, box
from gpusim.parallel.blas_threads import one_blas_thread

Float = npt.NDArray[np.float64]
BBAR = {"hex8": "bbar"}


def loaded(mesh: Mesh, materials: list[Any], of_cell: Any = None, cases: int = 1) -> Model:
    """Clamped at x = 0, pulled askew at the other end; a second case weighs down."""
    fixed = np.repeat(mesh.points[:, :1] == 0.0, 3, axis=1)
    forces = np.zeros((2, *mesh.points.shape))
    forces[0, mesh.points[:, 0] == mesh.points[:, 0].max()] = (0.3, 1.0, -0.2)
    forces[1] = (0.0, 0.0, -0.1)
    return Model(mesh, materials, fixed, forces[:cases], of_cell)


def uneven(divisions: tuple[int, int, int]) -> Mesh:
    mesh = box((1.0, 1.1, 0.7), divisions)
    return mesh.moved(np.stack([0.2 * mesh.points[:, 0] ** 2, *np.zeros((2, mesh.node_count))], 1))


def holed(divisions: tuple[int, int, int]) -> Mesh:
    """A box without the cells in the middle of x and y."""
    mesh = box((1.2, 1.0, 0.7), divisions)
    cells = mesh.cells["hex8"]
    middle = mesh.points[cells].mean(axis=1)
    kept = cells[(np.abs(middle[:, :2] - (0.6, 0.5)) > 0.17).any(axis=1)]
    used, number = np.unique(kept, return_inverse=True)
    return Mesh(mesh.points[used], {"hex8": number.reshape(-1, 8).astype(np.int32)})


def distorted(divisions: tuple[int, int, int], size: tuple[float, float, float]) -> Mesh:
    """A box whose nodes beside the ends have moved."""
    mesh = box(size, divisions)
    steps = 0.15 * np.array(size) / divisions
    inside = (mesh.points[:, :1] > 0.0) & (mesh.points[:, :1] < size[0])
    return mesh.moved(
        np.random.default_rng(4).uniform(-1.0, 1.0, (len(inside), 3)) * steps * inside
    )


def split_of(model: Model) -> VolumeSplit:
    parts = assemble(model, BBAR)
    assert model.fixed is not None
    split = split_volume(model, BBAR, parts.lattice, ~model.fixed)
    assert split is not None
    return split


def dense(model: Model) -> Float:
    assert model.fixed is not None
    held = model.fixed.ravel()
    matrix = block_matrix(assemble(model, BBAR).rows).toarray()
    return np.asarray(np.where(held[:, None] | held, 0.0, matrix))


@pytest.mark.parametrize(
    "mesh", [uneven((4, 3, 2)), distorted((4, 3, 2), (1.0, 1.1, 0.7))], ids=["lattice", "distorted"]
)
def test_stiffness_is_that_of_an_ordinary_body_and_pressures(mesh: Mesh) -> None:
    of_cell = (np.arange(mesh.cell_count) % 3).astype(np.int32)
    materials = [Isotropic(1.0, 0.4999), Isotropic(3.0, 0.25), Isotropic(0.2, 0.49)]
    model = loaded(mesh, materials, of_cell)
    split = split_of(model)
    assert split.model.materials[1] == materials[1]
    assert split.split.sum() == np.count_nonzero(of_cell != 1)
    b = split.divergence.toarray()
    whole = dense(split.model) + b.T @ (b / split.compliance[:, None])
    wanted = dense(model)
    np.testing.assert_allclose(whole, wanted, rtol=0.0, atol=1e-12 * np.abs(wanted).max())


def test_what_is_not_split() -> None:
    mesh = box((1.0, 1.0, 1.0), (2, 2, 2))
    grained = Orthotropic((1.0, 2.0, 3.0), (0.3, 0.2, 0.1), (1.0, 1.0, 1.0))
    for materials, rule in (([grained], "bbar"), ([Isotropic(1.0, 0.4999)], "full")):
        model = loaded(mesh, materials)
        parts = assemble(model, {"hex8": rule})
        assert parts.lattice is not None and model.fixed is not None
        assert split_volume(model, {"hex8": rule}, parts.lattice, ~model.fixed) is None


@pytest.mark.parametrize("mesh", [uneven((7, 8, 6)), holed((12, 10, 6))], ids=["box", "holed"])
def test_pressures_are_scaled_evenly(mesh: Mesh) -> None:
    with one_blas_thread():
        _look_at_pressures(mesh)


def _look_at_pressures(mesh: Mesh) -> None:
    """Eigenvalues of Q^-1 (B A^-1 B^T + C), with the checkerboards and by mass alone."""
    model = loaded(mesh, [Isotropic(1.0, 0.49999)])
    split = split_of(model)
    stiffness = dense(split.model)
    assert model.fixed is not None
    free = np.flatnonzero(~model.fixed.ravel())
    b = split.divergence.toarray()[:, free]
    complement = b @ np.linalg.solve(stiffness[np.ix_(free, free)], b.T)
    complement += np.diag(split.compliance)
    diagonal = stiffness.diagonal().reshape(-1, 3)
    scaling = PressureScaling(split, diagonal)
    inverse = np.stack([scaling.apply(one) for one in np.eye(len(b))])
    np.testing.assert_allclose(inverse, inverse.T, rtol=0.0, atol=1e-12 * np.abs(inverse).max())
    ratio = []
    for scaled in (inverse, np.diag(split.shear / split.volume)):
        values = eigh(complement, np.linalg.inv(scaled), eigvals_only=True)
        ratio.append(values[-1] / values[0])
    # 6 and 69, 8 and 47
    assert ratio[0] <= 20.0 and ratio[1] >= 3.0 * ratio[0]
    chebyshev = PressureChebyshev(split, diagonal)
    inverse = np.stack([chebyshev.apply(one) for one in np.eye(len(b))])
    np.testing.assert_allclose(inverse, inverse.T, rtol=0.0, atol=1e-10 * np.abs(inverse).max())
    values = eigh(complement, np.linalg.inv(0.5 * (inverse + inverse.T)), eigvals_only=True)
    assert values[0] > 0.0 and values[-1] / values[0] <= 20.0
    # the energies of all hat functions are those of the functions themselves, or above
    equal = [1.0]
    for hats, inverses in scaling._hats:
        full = [np.eye(n) if h is None else h for n, h in zip(scaling._shape, hats, strict=True)]
        functions = np.einsum("ia,jb,kc->ijkabc", *full).reshape(-1, inverses.size)[scaling._at]
        forces = split.divergence.T @ functions
        soft = np.divide(1.0, diagonal.ravel(), out=np.zeros(diagonal.size),
                         where=~model.fixed.ravel())  # fmt: skip
        energy = soft @ forces**2 + split.compliance @ functions**2
        told = 0.3 / inverses.ravel()
        if len(scaling._at) == np.prod(scaling._shape):
            np.testing.assert_allclose(told, energy, rtol=1e-10)
        else:
            assert (told >= energy * (1.0 - 1e-10)).all()
            equal.append(np.isclose(told, energy, rtol=1e-9).mean())
    # away from the hole nothing is above
    assert len(equal) == 1 or max(equal[1:]) > 0.2


@pytest.mark.parametrize(
    ("mesh", "materials", "most"),
    [
        (uneven((12, 11, 10)), [Isotropic(1.0, 0.4999)], 70),
        (holed((16, 14, 9)), [Isotropic(1.0, 0.49999)], 65),
        (distorted((12, 11, 10), (1.0, 1.1, 0.9)), [Isotropic(1.0, 0.4999)], 60),
        (distorted((20, 10, 1), (2.0, 1.0, 0.05)), [Isotropic(1.0, 0.4999)], 320),
        (
            distorted((20, 10, 2), (2.0, 1.0, 0.1)),
            [Isotropic(1.0, 0.4999), Isotropic(5.0, 0.3)],
            260,
        ),
        (box((1.0, 1.1, 0.9), (14, 13, 12)), [Isotropic(1.0, 0.4999), Isotropic(9.0, 0.3)], 65),
    ],
    ids=["graded", "holed", "distorted", "thin", "two in one", "two materials"],
)
def test_displacements_within_the_stated_error(
    mesh: Mesh, materials: list[Isotropic], most: int
) -> None:
    of_cell = None
    if len(materials) > 1:
        middle = mesh.points[mesh.cells["hex8"]].mean(axis=1)
        of_cell = (middle[:, 0] > 0.5).astype(np.int32)
    model = loaded(mesh, materials, of_cell, cases=2)
    found = solve(model, method="multigrid", backend="numpy", formulation="bbar")
    exact = solve(model, method="direct", formulation="bbar", tolerance=1e-9).u
    assert found.converged and "pressures" in found.message
    assert found.iterations <= most
    for one, other in zip(found.u, exact, strict=True):
        assert np.abs(one - other).max() <= found.error_estimate * np.abs(other).max()
    assert found.error_estimate <= 1e-6


def test_motions_that_a_load_hardly_feels_count_in_what_is_stated() -> None:
    """A plate pulled along its plane, and a ten-thousandth of that across."""
    mesh = distorted((20, 10, 1), (2.0, 1.0, 0.05))
    model = loaded(mesh, [Isotropic(1.0, 0.4999)])
    forces = np.zeros(mesh.points.shape)
    forces[mesh.points[:, 0] == 2.0] = (1.0, 0.3, 1e-4)
    model = replace(model, forces=forces)
    exact = solve(model, method="direct", formulation="bbar", tolerance=1e-9).u
    for tolerance in (1e-1, 1e-4):
        found = solve(
            model, method="multigrid", backend="numpy", formulation="bbar", tolerance=tolerance
        )
        assert found.converged and "pressures" in found.message
        assert np.abs(found.u - exact).max() <= found.error_estimate * np.abs(exact).max()


def test_iterations_hardly_grow_with_the_mesh() -> None:
    counts = []
    for n in (8, 16):
        model = loaded(box((1.0, 1.0, 1.0), (n, n, n)), [Isotropic(1.0, 0.4999)])
        found = solve(model, method="multigrid", backend="numpy", formulation="bbar")
        assert found.converged and "pressures" in found.message
        counts.append(found.iterations)
    assert counts[1] <= 1.3 * counts[0]


def test_prescribed_displacements_and_a_start_are_taken() -> None:
    mesh = box((1.0, 1.0, 0.8), (8, 8, 6))
    model = loaded(mesh, [Isotropic(1.0, 0.4999)])
    assert model.fixed is not None
    fixed = model.fixed.copy()
    fixed[mesh.points[:, 0] == 1.0] = True
    given = np.zeros(mesh.points.shape)
    given[mesh.points[:, 0] == 1.0] = (0.02, 0.1, -0.03)
    model = replace(model, fixed=fixed, prescribed=given, forces=None)
    exact = solve(model, method="direct", formulation="bbar", tolerance=1e-9).u
    for start in (None, 1.001 * exact):
        found = solve(model, method="multigrid", backend="numpy", formulation="bbar", start=start)
        assert found.converged and "pressures" in found.message
        assert np.abs(found.u - exact).max() <= 1e-6 * np.abs(exact).max()


def test_runs_are_continued_with_the_pressures_that_are_known() -> None:
    """A tolerance that takes several refinements costs the iterations of its digits."""
    model = loaded(box((1.0, 1.1, 0.9), (9, 8, 8)), [Isotropic(1.0, 0.4999)])
    options: dict[str, Any] = {"method": "multigrid", "backend": "numpy", "formulation": "bbar"}
    coarse, fine = (solve(model, tolerance=to, **options) for to in (1e-5, 1e-10))
    exact = solve(model, method="direct", formulation="bbar", tolerance=1e-11).u
    assert fine.converged and "pressures" in fine.message
    assert np.abs(fine.u - exact).max() <= 1e-10 * np.abs(exact).max()
    assert fine.iterations <= 2.5 * coarse.iterations
