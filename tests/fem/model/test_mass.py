"""Mass matrices of every element, by total mass, rigid motion and a bar's eigenfrequencies."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import eigh
from scipy.sparse.linalg import eigsh

from gpusim.errors import InputError
from gpusim.fem import Isotropic, Model, lumped_mass, mass_matrix
from gpusim.fem.elements.element import ELEMENTS
from tests.support.fem_reference import bar, one_cell, stiffness

STEEL = Isotropic(200.0, 0.3, density=2.0)


@pytest.mark.parametrize("kind", list(ELEMENTS))
def test_mass_and_kinetic_energy_of_a_rigid_body(kind: str) -> None:
    model = Model(bar(kind, (2.0, 1.0, 0.5), (3, 2, 1)), [STEEL])
    matrix, lumped = mass_matrix(model), lumped_mass(model)
    assert abs(matrix.sum() / 3 - 2.0) <= 1e-13 and abs(lumped.sum() - 2.0) <= 1e-13
    assert lumped.min() > 0.0
    spin, slide = np.array([0.3, -0.4, 0.7]), np.array([0.2, 0.5, -0.1])
    inertia = 2.0 / 12.0 * np.array([1.25, 4.25, 5.0])
    centre = np.array([1.0, 0.5, 0.25])
    velocity = (slide + np.cross(spin, model.mesh.points - centre)).ravel()
    energy = 0.5 * velocity @ matrix @ velocity
    exact = 0.5 * 2.0 * slide @ slide + 0.5 * (inertia * spin**2).sum()
    assert abs(energy - exact) <= 1e-13 * exact
    assert abs(matrix - matrix.T).max() <= 1e-16


@pytest.mark.parametrize("kind", list(ELEMENTS))
def test_a_single_cell_has_positive_mass(kind: str) -> None:
    model = Model(one_cell(kind), [STEEL])
    assert np.linalg.eigvalsh(mass_matrix(model).toarray()).min() > 0.0


def test_two_materials_weigh_their_own() -> None:
    mesh = bar("hex8", (2.0, 1.0, 1.0), (2, 1, 1))
    model = Model(mesh, [STEEL, Isotropic(1.0, 0.0, 5.0)], material_of_cell=np.array([1, 0]))
    left = lumped_mass(model)[mesh.points[:, 0] == 0.0]
    np.testing.assert_allclose(left, 5.0 / 8.0, rtol=1e-14)
    assert abs(mass_matrix(model).sum() / 3 - 7.0) <= 1e-13


@pytest.mark.parametrize(("kind", "tolerance"), [("hex8", 1.1e-3), ("hex20", 1e-6)])
def test_free_bar_vibrates_as_it_should(kind: str, tolerance: float) -> None:
    """Longitudinal modes of a free bar (nu = 0): omega_n = n pi / L sqrt(E / rho)."""
    length, divisions = 10.0, 40
    material = Isotropic(200.0, 0.0, 2.0)
    model = Model(bar(kind, (length, 0.5, 0.5), (divisions, 1, 1)), [material])
    # motion along x only: with nu = 0 it is one of the full system, free of bending modes
    stiff, mass = stiffness(model, "full")[::3, ::3], mass_matrix(model)[::3, ::3]
    values = eigsh(stiff, k=5, M=mass, sigma=-0.1, which="LM", return_eigenvectors=False)
    values = np.sort(values)
    exact = (np.arange(5) * np.pi / length) ** 2 * 200.0 / 2.0
    assert abs(values[0]) <= 1e-10 * exact[1]
    # consistent mass never underestimates
    assert (values[1:3] >= exact[1:3] * (1 - 1e-9)).all()
    assert np.abs(values[1:3] / exact[1:3] - 1.0).max() <= 2 * tolerance


def test_bending_of_a_slender_bar() -> None:
    """Free-free beam: omega_1 = 22.3733 sqrt(E I / (rho A L^4)), shear and rotation < 0.3 %."""
    model = Model(bar("hex8", (20.0, 0.4, 0.5), (40, 1, 1)), [STEEL])
    stiff, mass = stiffness(model).toarray(), mass_matrix(model).toarray()
    values = eigh(stiff, mass, eigvals_only=True)[:8]
    assert np.abs(values[:6]).max() <= 1e-8 * values[6]
    for found, height in zip(np.sqrt(values[6:8]), (0.4, 0.5), strict=True):
        exact = 22.3733 / 20.0**2 * np.sqrt(200.0 / 2.0 * height**2 / 12.0)
        assert abs(found / exact - 1.0) <= 4e-3


def test_no_density_is_an_error() -> None:
    mesh = bar("hex8", (1.0, 1.0, 1.0), (2, 1, 1))
    for function in (mass_matrix, lumped_mass):
        with pytest.raises(InputError, match=r"materials\[1\] has no density"):
            function(Model(mesh, [STEEL, Isotropic(1.0, 0.3)], material_of_cell=np.array([0, 1])))
        with pytest.raises(InputError, match="expected a Model"):
            function(mesh)  # type: ignore[arg-type]
