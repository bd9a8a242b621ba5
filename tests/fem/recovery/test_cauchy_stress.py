"""Stress and strain of load steps, by closed forms."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from scipy.spatial.transform import Rotation

import gpusim as gs
from gpusim.fem import von_mises
from gpusim.mesh import Mesh, box

Float = npt.NDArray[np.float64]
E, NU, YIELD, SLOPE = 200e9, 0.3, 250e6, 2e9
STEEL = gs.Isotropic(E, NU)
SHAPE = (1.0, 0.2, 0.1)


def stretched(law: Any, stretch: float, factors: list[float], mesh: Mesh | None = None) -> Any:
    """A bar pulled along x to ``stretch``, free to become thinner; its steps."""
    mesh = box(SHAPE, (3, 2, 1)) if mesh is None else mesh
    at_zero, end = np.isclose(mesh.points, 0.0), np.isclose(mesh.points[:, 0], 1.0)
    fixed = at_zero.copy()
    fixed[end, 0] = True
    given = np.zeros_like(mesh.points)
    given[end, 0] = stretch - 1.0
    model = gs.Model(mesh, law, fixed, prescribed=given)
    found = gs.fem.solve(model, geometry="nonlinear", factors=factors, tolerance=1e-10)
    return mesh, end, found.steps


@pytest.mark.parametrize("law", [gs.Hencky(E, NU), gs.NeoHookean(E, NU), STEEL])
def test_stress_of_a_bar_is_its_force_over_its_area(law: Any) -> None:
    mesh, end, steps = stretched(law, 1.02, [0.5, 1.0])
    for step in steps:
        deformed = mesh.points + step.u
        area = np.ptp(deformed[:, 1]) * np.ptp(deformed[:, 2])
        force = step.reactions[end, 0].sum()
        stress = step.stress.nodal
        # the turning element's stress is that of the area at rest
        tolerance = 1e-9 if law is not STEEL else 2.0 * NU * 0.02
        np.testing.assert_allclose(stress[:, 0], force / area, rtol=tolerance)
        assert np.abs(stress[:, 1:]).max() <= 1e-6 * stress[0, 0]
        strain = step.stress.nodal_strain
        sideways = np.log(np.ptp(deformed[:, 1]) / SHAPE[1])
        np.testing.assert_allclose(strain[:, 0], np.log(1.0 + 0.02 * step.factors[0]), rtol=1e-9)
        np.testing.assert_allclose(strain[:, 1], sideways, rtol=2e-2 if law is STEEL else 1e-8)
        assert step.stress.nodal_plastic_strain is None


def test_plastic_strain_is_what_the_elastic_one_leaves() -> None:
    law = gs.J2(STEEL, yield_stress=YIELD, hardening=SLOPE)
    _, _, (small, large, back) = stretched(law, 1.01, [0.1, 1.0, 0.95])
    assert (small.stress.nodal_plastic_strain == 0.0).all()
    plastic = (np.log(1.01) - YIELD / E) / (1.0 + SLOPE / E)
    np.testing.assert_allclose(large.stress.nodal_plastic_strain, plastic, rtol=1e-4)
    np.testing.assert_allclose(von_mises(large.stress.nodal), YIELD + SLOPE * plastic, rtol=2e-3)
    # unloading is elastic
    np.testing.assert_allclose(
        back.stress.nodal_plastic_strain, large.stress.nodal_plastic_strain, rtol=1e-9
    )


@pytest.mark.parametrize("law", [gs.Hencky(E, NU), gs.NeoHookean(E, NU), STEEL])
def test_other_measures_and_energy_of_a_bar(law: Any) -> None:
    # the turning element knows one stress: good where strain is small
    most, tolerance = (0.1, 1e-9) if law is not STEEL else (0.01, 0.02)
    factors = np.linspace(0.0, 1.0, 21)
    mesh, end, steps = stretched(law, 1.0 + most, list(factors[1:]), box(SHAPE, (2, 1, 1)))
    force = np.array([0.0, *(step.reactions[end, 0].sum() for step in steps)])
    for number, step in enumerate(steps, start=1):
        told, along = step.stress.nodal_results, 1.0 + most * factors[number]
        across = np.ptp(mesh.points[:, 1] + step.u[:, 1]) / SHAPE[1]
        green = 0.5 * (np.array([along, across]) ** 2 - 1.0) * np.ones((12, 1))
        found = told["green_lagrange_strain"][:, :2]
        np.testing.assert_allclose(found, green, rtol=tolerance)
        expected = force[number] / (SHAPE[1] * SHAPE[2]) / along
        np.testing.assert_allclose(told["piola_stress"][:, 0], expected, rtol=tolerance)
    # what is stored is the work of the force, by Simpson's rule
    weight = np.array([1.0, *([4.0, 2.0] * 10)[:-1], 1.0]) * most / 60.0
    np.testing.assert_allclose(steps[-1].strain_energy, force @ weight, rtol=1e-7)
    np.testing.assert_allclose(steps[-1].external_work, force @ weight, rtol=1e-3)


@pytest.mark.parametrize("law", [gs.Hencky(E, NU), STEEL])
def test_stress_turns_with_the_body(law: Any) -> None:
    """Turned by 70 degrees it is the stress of the body before, turned; strain stays."""
    mesh = box(SHAPE, (3, 2, 1))
    turn = Rotation.from_rotvec([0.3, -0.9, 0.8]).as_matrix()
    end = np.isclose(mesh.points[:, 0], 0.0) | np.isclose(mesh.points[:, 0], 1.0)
    fixed = np.repeat(end[:, None], 3, axis=1)
    results = []
    for rotation in (np.eye(3), turn):
        strained = mesh.points * [1.003, 1.0, 1.0] + 0.002 * mesh.points[:, [1, 2, 0]]
        given = np.where(fixed, strained @ rotation.T - mesh.points, 0.0)
        model = gs.Model(mesh, law, fixed, prescribed=given)
        start = gs.fem.solve(model, geometry="nonlinear", factors=np.linspace(0.2, 1.0, 5),
                             tolerance=1e-11)  # fmt: skip
        results.append(start.steps[-1].stress)
    before, after = results
    size = np.abs(before.nodal).max()
    expected = np.einsum("ij,njk,lk->nil", turn, _tensor(before.nodal), turn)
    assert np.abs(_tensor(after.nodal) - expected).max() <= 1e-7 * size
    np.testing.assert_allclose(after.nodal_strain, before.nodal_strain, rtol=0, atol=1e-9)
    assert abs(after.error_relative - before.error_relative) <= 1e-7


def test_where_materials_meet_each_has_its_own() -> None:
    """Two bars in series, one that yields: stress goes through, plastic strain doesn't."""
    mesh = box(SHAPE, (4, 1, 1))
    at_zero, end = np.isclose(mesh.points, 0.0), np.isclose(mesh.points[:, 0], 1.0)
    fixed, given = at_zero.copy(), np.zeros_like(mesh.points)
    fixed[end, 0] = True
    given[end, 0] = 0.004
    soft = gs.J2(gs.Isotropic(E, 0.0), yield_stress=YIELD, hardening=SLOPE)
    model = gs.Model(mesh, [gs.Hencky(E, 0.0), soft], fixed, prescribed=given,
                     material_of_cell=np.array([0, 0, 1, 1]))  # fmt: skip
    step = gs.fem.solve(model, geometry="nonlinear", tolerance=1e-10).steps[-1]
    found = step.stress
    flowed = found.results["plastic_strain"]
    middle = np.flatnonzero(np.isclose(mesh.points[:, 0], 0.5))
    rows = np.isin(found.node_of, middle)
    assert rows.sum() == 2 * len(middle)
    hard = rows & (found.material_of == 0)
    assert (flowed[hard] == 0.0).all()
    assert (flowed >= 0.0).all()
    assert (flowed[found.material_of == 1]).max() > 0.002
    assert found.nodal_plastic_strain is not None
    assert (found.nodal_plastic_strain[end] > 0.001).all()


def test_steps_of_a_mesh_in_other_numbers_have_their_stress_at_its_nodes() -> None:
    """Large shuffled meshes are solved in numbers of their own."""
    plain = box(SHAPE, (24, 6, 6))
    rng = np.random.default_rng(3)
    place = rng.permutation(len(plain.points))
    points = np.empty_like(plain.points)
    points[place] = plain.points * (1.0 + 1e-9 * rng.normal(size=plain.points.shape))
    mesh = Mesh(points, {kind: place[block] for kind, block in plain.cells.items()})
    fixed = np.repeat(np.isclose(points[:, :1], 0.0), 3, axis=1)
    forces = np.zeros_like(points)
    forces[np.isclose(points[:, 0], 1.0), 2] = 2e3
    model = gs.Model(mesh, STEEL, fixed, forces)
    step = gs.fem.solve(model, geometry="nonlinear", tolerance=1e-9).steps[-1]
    exact = gs.fem.stress(model, gs.fem.solve(model, tolerance=1e-9).u)
    size = exact.von_mises.max()
    assert np.abs(step.stress.nodal - exact.nodal).max() <= 0.02 * size


def _tensor(stress: Float) -> Float:
    return stress[:, [[0, 3, 5], [3, 1, 4], [5, 4, 2]]]
