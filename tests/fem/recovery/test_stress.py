"""Stress recovery, thermal strain and the error indicator, by closed forms."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

from gpusim.errors import InputError
from gpusim.fem import (
    Isotropic,
    Model,
    Orthotropic,
    Stress,
    pressure,
    principal,
    stress,
    symmetry,
    thermal,
    von_mises,
)
from gpusim.fem.elements.element import ELEMENTS
from gpusim.fem.elements.element_matrix import element_stiffness
from gpusim.fem.elements.strain import internal_force, point_stress
from gpusim.mesh import Mesh, boundary_faces, box, quadratic
from gpusim.mesh.shape_functions import reference_nodes
from tests.support.fem_reference import bar, direct

Float = npt.NDArray[np.float64]
STEEL = Isotropic(200.0, 0.3, expansion=1e-3)
EVERY = [(kind, name) for kind, element in ELEMENTS.items() for name in element.formulations]


def skewed() -> Orthotropic:
    axes, _ = np.linalg.qr(np.array([[1.0, 2.0, 0.5], [0.3, -1.0, 2.0], [2.0, 0.1, -0.7]]))
    axes[2] *= np.linalg.det(axes)
    return Orthotropic((10.0, 2.0, 1.0), (0.3, 0.2, 0.02), (3.0, 1.0, 0.5), axes=axes)  # type: ignore[arg-type]


@pytest.mark.parametrize(("kind", "formulation"), EVERY)
@pytest.mark.parametrize("material", [STEEL, skewed()], ids=["isotropic", "orthotropic"])
def test_stress_belongs_to_the_stiffness(
    kind: str, formulation: str, material: Isotropic | Orthotropic
) -> None:
    """B^T s dV of the recovered stress is K u, internal modes and B-bar included."""
    rng = np.random.default_rng(2)
    base = reference_nodes(kind)
    nodes = base + 0.05 * rng.normal(size=(4, *base.shape)) + 10.0
    u = rng.normal(size=nodes.shape)
    moduli = material.stiffness()
    matrix = element_stiffness(kind, nodes, moduli, formulation)
    expected = (matrix @ u.reshape(4, -1, 1)).reshape(u.shape)
    found, volume = point_stress(kind, formulation, nodes, u, moduli)
    forces = internal_force(kind, formulation, nodes, found)
    assert np.abs(forces - expected).max() <= 1e-13 * np.abs(expected).max()
    # and half of u.K u is the energy of that stress
    energy = 0.5 * np.einsum("mqi,ij,mqj,mq->m", found, np.linalg.inv(moduli), found, volume)
    np.testing.assert_allclose(energy, 0.5 * (u * expected).sum(axis=(1, 2)), rtol=1e-12)
    per_cell, _ = point_stress(kind, formulation, nodes, u, np.repeat(moduli[None], 4, axis=0))
    np.testing.assert_allclose(per_cell, found, rtol=0, atol=1e-13 * np.abs(found).max())


@pytest.mark.parametrize(("kind", "formulation"), EVERY)
def test_constant_stress_is_exact(kind: str, formulation: str) -> None:
    mesh = bar(kind, (2.0, 1.0, 0.5), (2, 1, 1))
    shape = np.array([[1.0, 0.1, 0.0], [0.2, 1.0, 0.1], [0.0, -0.1, 1.0]])
    mesh = Mesh(mesh.points @ shape, mesh.cells)
    gradient = np.array([[0.01, 0.02, -0.01], [0.0, -0.005, 0.03], [0.02, 0.01, 0.004]])
    model = Model(mesh, [STEEL])
    found = stress(model, mesh.points @ gradient.T + 0.5, formulation)
    g = gradient
    strain = [g[0, 0], g[1, 1], g[2, 2], g[0, 1] + g[1, 0], g[1, 2] + g[2, 1], g[2, 0] + g[0, 2]]
    exact = STEEL.stiffness() @ strain
    for values in (found.nodal, found.cell, found.points[kind].reshape(-1, 6)):
        assert np.abs(values - exact).max() <= 1e-12
    assert np.abs(found.strains - strain).max() <= 1e-14
    volume = float(np.linalg.det(shape))
    assert abs(found.volume.sum() - volume) <= 1e-13
    assert abs(found.energy.sum() - 0.5 * exact @ strain * volume) <= 1e-12
    assert found.error_relative <= 1e-12


def bent(kind: str) -> tuple[Model, Float]:
    """A bar in pure bending: ends turned against each other, free on its sides."""
    mesh = bar(kind, (10.0, 1.0, 1.0), (10, 2, 2))
    x, y, z = (mesh.points - [0.0, 0.5, 0.5]).T
    k, nu = 0.01, STEEL.nu
    exact = [k * x * z, -nu * k * y * z, -0.5 * k * x**2 - 0.5 * nu * k * (z**2 - y**2)]
    u = np.stack(exact, axis=1)
    fixed = np.zeros(u.shape, bool)
    fixed[(x == 0.0) | (x == 10.0), 0] = True
    at = np.abs(mesh.points - [0.0, 0.5, 0.5]).max(axis=1) < 1e-9
    fixed[at] = True
    fixed[np.abs(mesh.points - [0.0, 1.0, 0.5]).max(axis=1) < 1e-9, 2] = True
    return Model(mesh, [STEEL], fixed, prescribed=np.where(fixed, u, 0.0)), 200.0 * k * z


@pytest.mark.parametrize("kind", ["hex8", "hex20", "hex27", "wedge15", "tet10"])
def test_bending_stress_is_exact(kind: str) -> None:
    model, exact = bent(kind)
    u = direct(model)
    found = stress(model, u)
    assert np.abs(found.nodal[:, 0] - exact).max() <= 1e-9
    assert np.abs(found.nodal[:, 1:]).max() <= 1e-9
    assert found.error_relative <= 1e-9
    np.testing.assert_allclose(found.von_mises, np.abs(exact), atol=1e-9)
    np.testing.assert_allclose(
        found.principal[:, [0, 2]], np.stack([np.maximum(exact, 0), np.minimum(exact, 0)], 1),
        atol=1e-9,
    )  # fmt: skip


def test_plain_hexahedra_are_stiff_in_bending() -> None:
    """What the internal modes are good for: without them the indicator sees the error."""
    model, exact = bent("hex8")
    found = stress(model, direct(model, "full"), "full")
    assert np.abs(found.nodal[:, 0] - exact).max() >= 0.05
    assert found.error_relative >= 0.1


def quarter_tube(kind: str, n: int) -> Mesh:
    """Inner radius 1, outer radius 2; midside nodes on the circles."""
    flat = box((1.0, np.pi / 2, 0.5), (n, 2 * n, 1), (1.0, 0.0, 0.0))
    flat = flat if kind == "hex8" else quadratic(flat, serendipity=kind == "hex20")
    r, angle, z = flat.points.T
    return Mesh(np.stack([r * np.cos(angle), r * np.sin(angle), z], axis=1), flat.cells)


def tube(kind: str, n: int) -> tuple[Model, Stress, Float]:
    """Thick tube under inner pressure 1 in plane strain, and each node's radius."""
    mesh = quarter_tube(kind, n)
    faces = boundary_faces(mesh)
    normals, middle = faces.normals, faces.centroids
    fixed = symmetry(mesh, faces[normals[:, 0] < -0.999])
    for rows in (normals[:, 1] < -0.999, normals[:, 2] < -0.999, normals[:, 2] > 0.999):
        fixed |= symmetry(mesh, faces[rows])
    inner = faces[(normals[:, :2] * middle[:, :2]).sum(axis=1) < -0.5]
    model = Model(mesh, [STEEL], fixed, pressure(mesh, inner, 1.0))
    radius = np.hypot(mesh.points[:, 0], mesh.points[:, 1])
    return model, stress(model, direct(model)), radius


def polar(mesh: Mesh, values: Float, radius: Float) -> tuple[Float, Float]:
    """Radial and hoop stress."""
    x, y = (mesh.points[:, :2] / radius[:, None]).T
    shear = 2.0 * values[:, 3] * x * y
    radial = values[:, 0] * x**2 + values[:, 1] * y**2 + shear
    return radial, values[:, 0] * y**2 + values[:, 1] * x**2 - shear


def test_thick_tube_under_pressure() -> None:
    """Lame: sr = A (1 - b^2/r^2), st = A (1 + b^2/r^2), A = p a^2 / (b^2 - a^2)."""
    errors = []
    for n in (2, 4, 8):
        model, found, radius = tube("hex20", n)
        radial, hoop = polar(model.mesh, found.nodal, radius)
        errors.append(
            max(
                np.abs(radial - (1 - 4 / radius**2) / 3).max(),
                np.abs(hoop - (1 + 4 / radius**2) / 3).max(),
            )
        )
    # the greatest stress, 5/3 at the hole, to 1 % with 8 elements; of second order there
    assert errors[2] <= 0.01 * 5 / 3
    assert errors[0] / errors[1] >= 3.0 and errors[1] / errors[2] >= 3.0


@pytest.mark.parametrize(("kind", "best", "order"), [("hex8", 0.02, 0.95), ("hex20", 0.3, 1.9)])
def test_error_indicator_is_effective(kind: str, best: float, order: float) -> None:
    """Estimated over true energy error on a refinement sequence."""
    # work of the pressure: p u(a) a (pi/2) h / 2 with Lame's u
    nu = STEEL.nu
    inward = (1 + nu) / 200.0 / 3.0 * ((1 - 2 * nu) + 4.0)
    exact = 0.5 * inward * np.pi / 2 * 0.5
    true, estimated = [], []
    for n in (2, 4, 8):
        _, found, _ = tube(kind, n)
        true.append(np.sqrt(1.0 - found.energy.sum() / exact))
        estimated.append(found.error_relative)
        assert abs(np.sqrt((found.error_share**2).sum()) - found.error_relative) <= 1e-14
    effectivity = np.array(estimated) / np.array(true)
    assert np.abs(effectivity - 1.0).max() <= best
    assert np.log2(true[1] / true[2]) >= order
    # it gets better as the mesh does
    assert abs(effectivity[2] - 1.0) <= abs(effectivity[0] - 1.0)


def test_material_borders_are_not_smeared() -> None:
    """Two bars side by side, stretched alike: each keeps its own stress up to the border."""
    mesh = bar("hex8", (2.0, 1.0, 1.0), (2, 2, 1))
    soft = Isotropic(10.0, 0.0)
    stiff = Isotropic(100.0, 0.0)
    centre = mesh.points[mesh.cells["hex8"]].mean(axis=1)[:, 1]
    material = (centre > 0.5).astype(np.int32)
    model = Model(mesh, [soft, stiff], material_of_cell=material)
    found = stress(model, mesh.points * [0.01, 0.0, 0.0])
    border = mesh.points[:, 1] == 0.5
    np.testing.assert_allclose(found.of_material(0)[border, 0], 0.1, rtol=1e-13)
    np.testing.assert_allclose(found.of_material(1)[border, 0], 1.0, rtol=1e-13)
    np.testing.assert_allclose(found.nodal[border, 0], 1.0, rtol=1e-13)
    np.testing.assert_allclose(found.nodal[mesh.points[:, 1] == 0.0, 0], 0.1, rtol=1e-13)
    assert np.isnan(found.of_material(1)[mesh.points[:, 1] == 0.0]).all()
    assert len(found.values) == mesh.node_count + border.sum()
    assert found.error_relative <= 1e-13


def loosely_held(mesh: Mesh) -> npt.NDArray[np.bool_]:
    """Six degrees of freedom at three corners: nothing is hindered."""
    fixed = np.zeros(mesh.points.shape, bool)
    low, high = mesh.bounds
    for corner, axes in (
        (low, [0, 1, 2]),
        ([low[0], high[1], low[2]], [0, 2]),
        ([high[0], low[1], low[2]], [2]),
    ):
        fixed[np.abs(mesh.points - corner).max(axis=1) < 1e-9, axes] = True
    return fixed


@pytest.mark.parametrize(("kind", "formulation"), EVERY)
def test_free_expansion_has_no_stress(kind: str, formulation: str) -> None:
    mesh = bar(kind, (2.0, 1.0, 0.5), (3, 2, 2) if kind != "hex20" else (4, 3, 3))
    material = [STEEL if formulation == "bbar" else Isotropic(200.0, 0.3, expansion=1e-3)]
    fixed = loosely_held(mesh)
    force = thermal(mesh, material, 20.0, formulation=formulation)
    assert np.abs(force.sum(axis=0)).max() <= 1e-12
    model = Model(mesh, material, fixed, force)
    if formulation == "reduced":  # hourglass modes: judge the exact displacement
        u = 20e-3 * mesh.points
    else:
        u = direct(model, formulation)
    assert np.abs(u - 20e-3 * mesh.points).max() <= 1e-11
    found = stress(model, u, formulation, temperature=20.0)
    assert np.abs(found.nodal).max() <= 1e-9
    np.testing.assert_allclose(found.strains[:, :3], 20e-3, rtol=1e-9)
    assert found.energy.sum() <= 1e-18


def test_heat_of_the_model_itself_is_no_stress() -> None:
    mesh = bar("hex8", (2.0, 1.0, 0.5), (3, 2, 2))
    material = Isotropic(200.0, 0.3, expansion=1e-3)
    hot = Model(mesh, material, loosely_held(mesh), temperature=20.0)
    u = 20e-3 * mesh.points
    assert np.abs(stress(hot, u).nodal).max() <= 1e-9
    cold = stress(hot, u, temperature=0.0)
    assert cold.nodal[:, 0].min() > 1.0
    forces = np.zeros((2, *mesh.points.shape))
    twice = Model(mesh, material, loosely_held(mesh), forces, temperature=20.0)
    with pytest.raises(InputError, match="stress: temperature; got None, 2 load cases"):
        stress(twice, u)


def test_orthotropic_free_expansion() -> None:
    axes = np.array([[0.6, 0.8, 0.0], [-0.8, 0.6, 0.0], [0.0, 0.0, 1.0]])
    material = Orthotropic(
        (140.0, 10.0, 7.0), (0.3, 0.45, 0.015), (5.0, 3.5, 4.5), expansion=(-1e-3, 3e-3, 2e-3),
        axes=axes,  # type: ignore[arg-type]
    )  # fmt: skip
    mesh = bar("tet10", (2.0, 1.0, 0.5), (2, 1, 1))
    force = thermal(mesh, [material], 10.0)
    model = Model(mesh, [material], loosely_held(mesh), force)
    found = stress(model, direct(model), temperature=10.0)
    assert np.abs(found.nodal).max() <= 1e-10
    expected = 10.0 * axes.T @ np.diag([-1e-3, 3e-3, 2e-3]) @ axes
    np.testing.assert_allclose(found.strains[:, 0], expected[0, 0], rtol=1e-9)
    np.testing.assert_allclose(found.strains[:, 3], 2.0 * expected[0, 1], rtol=1e-9)


@pytest.mark.parametrize("kind", ["hex8", "hex20", "tet4", "wedge6", "pyramid13"])
def test_clamped_bar_is_pressed(kind: str) -> None:
    """Ends held, sides free: s = -E a dT, nothing else."""
    mesh = bar(kind, (2.0, 1.0, 0.5), (3, 2, 1))
    fixed = loosely_held(mesh)
    fixed[np.isin(mesh.points[:, 0], (0.0, 2.0)), 0] = True
    force = thermal(mesh, [STEEL], 5.0)
    model = Model(mesh, [STEEL], fixed, force)
    found = stress(model, direct(model), temperature=np.full(mesh.node_count, 5.0))
    np.testing.assert_allclose(found.nodal[:, 0], -1.0, rtol=1e-10)
    assert np.abs(found.nodal[:, 1:]).max() <= 1e-10


@pytest.mark.parametrize("kind", ["hex8", "hex20", "tet10", "wedge15"])
def test_temperature_over_the_height_bends_without_stress(kind: str) -> None:
    """Linear over z: curvature a dT/h; exact in hex8 because its modes are condensed as well."""
    mesh = bar(kind, (10.0, 1.0, 1.0), (8, 1, 2))
    change = 3.0 * mesh.points[:, 2] + 1.0
    force = thermal(mesh, [STEEL], change)
    model = Model(mesh, [STEEL], loosely_held(mesh), force)
    u = direct(model)
    found = stress(model, u, temperature=change)
    assert np.abs(found.nodal).max() <= 1e-8
    np.testing.assert_allclose(found.strains[:, 0], 1e-3 * change[found.node_of], atol=1e-11)
    along = np.abs(mesh.points[:, 1:]).max(axis=1) < 1e-9
    x = mesh.points[along, 0]
    np.testing.assert_allclose(u[along, 2], -0.5 * 3e-3 * x * (x - 10.0), atol=1e-10)


def test_invariants() -> None:
    rng = np.random.default_rng(1)
    values = rng.normal(size=(7, 6))
    tensor = values[:, [[0, 3, 5], [3, 1, 4], [5, 4, 2]]]
    deviator = tensor - np.trace(tensor, axis1=1, axis2=2)[:, None, None] / 3 * np.eye(3)
    expected = np.sqrt(1.5 * (deviator**2).sum(axis=(1, 2)))
    np.testing.assert_allclose(von_mises(values), expected, rtol=1e-13)
    np.testing.assert_allclose(principal([3.0, 5.0, 1.0, 0, 0, 0]), [5.0, 3.0, 1.0])
    np.testing.assert_allclose(principal([0, 0, 0, 0, 2.0, 0]), [2.0, 0.0, -2.0], atol=1e-15)
    with pytest.raises(InputError, match=r"expected \(…,6\)"):
        von_mises(np.zeros(3))


def test_dangling_nodes_have_no_stress() -> None:
    mesh = box((1.0, 1.0, 1.0), (1, 1, 1))
    more = Mesh(np.concatenate([mesh.points, [[5.0, 5.0, 5.0]]]), mesh.cells)
    found = stress(Model(more, [STEEL]), more.points * 0.01)
    assert not found.nodal[-1].any() and found.nodal[:-1, 0].min() > 1.0
    assert 8 not in found.node_of


def test_wrong_arguments_are_refused() -> None:
    mesh = box((1.0, 1.0, 1.0), (1, 1, 1))
    model, u = Model(mesh, [STEEL]), np.zeros((8, 3))
    for words, call in {
        "expected a Model": lambda: stress(mesh, u),  # type: ignore[arg-type]
        "one load case": lambda: stress(model, np.zeros((2, 8, 3))),
        "expected .* finite": lambda: stress(model, np.full((8, 3), np.nan)),
        "reduced": lambda: stress(model, u, "reduced"),
        "stress: temperature": lambda: stress(model, u, temperature=np.zeros(3)),
        "thermal: temperature": lambda: thermal(mesh, [STEEL], np.nan),
        "got none": lambda: thermal(mesh, [], 1.0),
    }.items():
        with pytest.raises(InputError, match=words):
            call()
    assert stress(model, u).error_relative == 0.0 and not stress(model, u).error_share.any()
