"""Every element and formulation: zero-energy modes, reference integrals, patch tests."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

from gpusim import Device
from gpusim.arrays.unique import congruence_classes
from gpusim.errors import InputError
from gpusim.fem import Isotropic, Model, solve
from gpusim.fem.elements.element import ELEMENTS
from gpusim.fem.elements.element_matrix import element_stiffness, strain_matrix
from gpusim.mesh import CELL_TYPES, Mesh
from gpusim.mesh.shape_functions import reference_nodes
from tests.support.element_meshes import SERENDIPITY, SIZE, mesh_of, mixed_mesh, with_middles

Float = npt.NDArray[np.float64]
CASES = [(kind, name) for kind, element in ELEMENTS.items() for name in element.formulations]
# Beside the six rigid motions: what too few points don't see. Neighbours hold these modes.
SPURIOUS = {("hex20", "reduced"): 6, ("wedge6", "full"): 1, ("tet10", "bbar"): 3}
STEEL = Isotropic(210e3, 0.3)
GRADIENT = np.array([[1.0, 0.3, -0.2], [0.5, -0.7, 0.1], [0.4, 0.2, 0.6]]) * 1e-3


def anisotropic() -> Float:
    """Some positive definite moduli without any symmetry."""
    root = np.random.default_rng(4).normal(size=(6, 6))
    return np.asarray(root @ root.T + 3.0 * np.eye(6))


def distorted_cell(kind: str, count: int = 3) -> Float:
    """(M,k,3): the reference cell stretched, sheared, and every node moved at random."""
    stretch = np.array([[1.0, 0.2, 0.0], [0.0, 0.7, 0.1], [0.15, 0.0, 1.4]])
    nodes = reference_nodes(kind) @ stretch.T
    return nodes + 0.04 * np.random.default_rng(7).uniform(-1, 1, (count, *nodes.shape))


def test_every_cell_type_has_an_element() -> None:
    assert tuple(ELEMENTS) == tuple(CELL_TYPES)
    for kind, element in ELEMENTS.items():
        assert element.name == kind and "full" in element.formulations
    with pytest.raises(InputError, match="reduced"):
        ELEMENTS["hex8"].rule("reduced")


@pytest.mark.parametrize(("kind", "name"), CASES)
def test_only_rigid_motions_are_free(kind: str, name: str) -> None:
    for matrix in element_stiffness(kind, distorted_cell(kind), STEEL.stiffness(), name):
        values = np.linalg.eigvalsh(matrix)
        free = np.abs(values) <= 1e-12 * values[-1]
        assert free.sum() == 6 + SPURIOUS.get((kind, name), 0)
        assert values[~free].min() > 1e-5 * values[-1]


def strains(kind: str, nodes: Float, name: str) -> tuple[Float, Float, Float]:
    """Strain matrices (M,Q,6,3k), those of the internal modes (M,Q,6,9), and volumes (M,Q)."""
    rule = ELEMENTS[kind].rule(name)
    jacobian = np.einsum("mki,qkj->mqij", nodes, rule.gradient)
    det = np.linalg.det(jacobian)
    strain = strain_matrix(rule.gradient @ np.linalg.inv(jacobian))
    # the modes 1 - xi^2 …, with the Jacobian of the centre
    centre = np.einsum("mki,kj->mij", nodes, ELEMENTS[kind].centre_gradient)
    modes = -2.0 * rule.points[:, :, None] * np.eye(3)
    scale = (np.linalg.det(centre)[:, None] / det)[..., None, None]
    inner = strain_matrix(modes @ np.linalg.inv(centre)[:, None] * scale)
    return strain, inner, det * rule.weight


@pytest.mark.parametrize(("kind", "name"), CASES)
def test_the_matrix_is_the_integral_of_strain_moduli_strain(kind: str, name: str) -> None:
    """Written the usual way, B^T D B, for moduli without symmetry and one set per element."""
    nodes = distorted_cell(kind)
    moduli = anisotropic() * np.array([1.0, 2.0, 0.5])[:, None, None]
    strain, inner, volume = strains(kind, nodes, name)
    if name == "bbar":
        dilatation = strain[:, :, :3].sum(axis=2)
        mean = np.einsum("mqa,mq->ma", dilatation, volume) / volume.sum(axis=1)[:, None]
        strain[:, :, :3] += (mean[:, None] - dilatation)[:, :, None] / 3.0
    expected = np.einsum("mqra,mrs,mqsb,mq->mab", strain, moduli, strain, volume)
    if name == "incompatible":
        mixed = np.einsum("mqra,mrs,mqsb,mq->mab", inner, moduli, strain, volume)
        own = np.einsum("mqra,mrs,mqsb,mq->mab", inner, moduli, inner, volume)
        expected -= mixed.transpose(0, 2, 1) @ np.linalg.solve(own, mixed)
    matrix = element_stiffness(kind, nodes, moduli, name)
    assert np.abs(matrix - expected).max() <= 1e-12 * np.abs(expected).max()
    np.testing.assert_array_equal(matrix, matrix.transpose(0, 2, 1))
    # in chunks of another size, and far away from the origin
    many = np.concatenate([nodes[:1]] * 700)
    again = element_stiffness(kind, many, moduli[0], name)
    np.testing.assert_allclose(again, np.broadcast_to(matrix[0], again.shape), rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("kind", list(ELEMENTS))
def test_the_mass_rule_is_exact_for_products_of_shape_functions(kind: str) -> None:
    """On a straight cell a higher rule changes nothing (where there is one)."""
    rule = ELEMENTS[kind].mass
    mass = np.einsum("qa,qb,q->ab", rule.shape, rule.shape, rule.weight)
    values = np.linalg.eigvalsh(mass)
    assert values[0] > 1e-4 * values[-1]  # no mode without mass
    # second moments of the reference cell, which only an exact rule gets through N_a N_b
    nodes = reference_nodes(kind)
    for a in range(3):
        for b in range(3):
            exact = np.einsum("q,q,q->", rule.weight, rule.points[:, a], rule.points[:, b])
            assert nodes[:, a] @ mass @ nodes[:, b] == pytest.approx(exact, abs=1e-14)


@pytest.mark.parametrize("kind", list(ELEMENTS))
def test_inverted_elements_are_refused(kind: str) -> None:
    nodes = reference_nodes(kind)[None] * np.array([1.0, 1.0, -1.0])
    with pytest.raises(InputError, match=f"{kind}: 1 elements are inverted"):
        element_stiffness(kind, nodes, STEEL.stiffness())


@pytest.mark.parametrize("kind", list(ELEMENTS))
def test_equal_elements_share_a_class(kind: str) -> None:
    mesh = mesh_of(kind, (6, 3, 4))
    cells = mesh.cells[kind]
    representative, label = congruence_classes(
        mesh.points[cells], np.zeros(len(cells), dtype=np.int32)
    )
    assert len(representative) <= len(cells) / 6  # a box has a few shapes only
    exact = element_stiffness(kind, mesh.points[cells], STEEL.stiffness())
    shared = exact[representative][label]
    assert np.abs(shared - exact).max() <= 1e-10 * np.abs(exact).max()


def patch(mesh: Mesh) -> tuple[Model, Float]:
    """A linear displacement field given on the surface of the box, and the field."""
    exact = mesh.points @ GRADIENT.T + [1e-3, -2e-3, 5e-4]
    surface = ((mesh.points < 1e-9) | (mesh.points > np.array(SIZE) - 1e-9)).any(axis=1)
    assert (~surface).sum() >= 2
    fixed = np.repeat(surface[:, None], 3, axis=1)
    return Model(mesh, [STEEL], fixed=fixed, prescribed=np.where(fixed, exact, 0.0)), exact


def relative(u: Float, exact: Float) -> float:
    return float(np.abs(u - exact).max() / np.abs(exact).max())


@pytest.mark.parametrize(("kind", "name"), CASES)
def test_constant_strain_is_exact_on_distorted_cells(kind: str, name: str) -> None:
    model, exact = patch(mesh_of(kind, (3, 2, 2), amount=0.06))
    solution = solve(model, backend="numpy", formulation={kind: name}, tolerance=1e-11)
    assert solution.converged
    assert relative(solution.u, exact) <= 1e-9


@pytest.mark.parametrize("quadratic", [False, True])
def test_constant_strain_is_exact_across_all_types_together(quadratic: bool) -> None:
    mesh = mixed_mesh(0.06)
    model, exact = patch(with_middles(mesh, SERENDIPITY) if quadratic else mesh)
    solution = solve(model, backend="numpy", tolerance=1e-11)
    assert solution.converged
    assert relative(solution.u, exact) <= 1e-9


@pytest.mark.parametrize(("kind", "name"), CASES)
def test_constant_strain_on_the_device(kind: str, name: str, device: Device) -> None:
    model, exact = patch(mesh_of(kind, (3, 2, 2), amount=0.06))
    # small enough for the direct solver on the host, which isn't what is tested here
    solution = solve(model, device, formulation={kind: name}, tolerance=1e-8, method="multigrid")
    assert solution.converged
    assert relative(solution.u, exact) <= 1e-5


def test_constant_strain_on_the_device_across_all_types_together(device: Device) -> None:
    model, exact = patch(with_middles(mixed_mesh(0.06), SERENDIPITY))
    solution = solve(model, device, tolerance=1e-8, method="multigrid")
    assert solution.converged
    assert relative(solution.u, exact) <= 1e-5


@pytest.mark.parametrize("kind", ["hex27", "tet10", "hex20", "wedge15", "pyramid13"])
def test_quadratic_elements_bend_exactly(kind: str) -> None:
    """Pure bending is quadratic: u = (x z, nu-terms…) is found exactly on straight cells."""
    mesh = mesh_of(kind, (3, 2, 2))
    x, y, z = mesh.points.T
    nu = STEEL.nu
    exact = 1e-3 * np.stack([x * z, -nu * y * z, -0.5 * (x**2 - nu * y**2 + nu * z**2)], axis=1)
    surface = ((mesh.points < 1e-9) | (mesh.points > np.array(SIZE) - 1e-9)).any(axis=1)
    fixed = np.repeat(surface[:, None], 3, axis=1)
    model = Model(mesh, [STEEL], fixed=fixed, prescribed=np.where(fixed, exact, 0.0))
    solution = solve(model, backend="numpy", tolerance=1e-11)
    assert relative(solution.u, exact) <= 1e-9


def harmonic(points: Float) -> Float:
    """The gradient of exp(x) sin(0.6 y) cos(0.8 z), a harmonic function: in balance unloaded."""
    x, y, z = points.T
    size = 1e-3 * np.exp(x)
    return np.stack(
        [
            size * np.sin(0.6 * y) * np.cos(0.8 * z),
            0.6 * size * np.cos(0.6 * y) * np.cos(0.8 * z),
            -0.8 * size * np.sin(0.6 * y) * np.sin(0.8 * z),
        ],
        axis=1,
    )


def harmonic_error(kind: str, name: str, n: int) -> float:
    """RMS error inside a smoothly distorted box, the exact displacement given on its surface."""
    mesh = mesh_of(kind, (n, n, n))
    bump = np.sin(np.pi * mesh.points / np.array(SIZE)).prod(axis=1)
    mesh = Mesh(mesh.points + np.outer(bump, [0.08, -0.06, 0.1]), mesh.cells)
    exact = harmonic(mesh.points)
    surface = ((mesh.points < 1e-9) | (mesh.points > np.array(SIZE) - 1e-9)).any(axis=1)
    fixed = np.repeat(surface[:, None], 3, axis=1)
    model = Model(mesh, [STEEL], fixed=fixed, prescribed=np.where(fixed, exact, 0.0))
    solution = solve(model, backend="numpy", formulation={kind: name}, tolerance=1e-9)
    return float(np.sqrt(((solution.u - exact)[~surface] ** 2).mean()) / np.abs(exact).max())


@pytest.mark.parametrize(("kind", "name"), CASES)
def test_errors_fall_with_the_order_of_the_element(kind: str, name: str) -> None:
    """Half the cell size: a quarter of the error with linear cells, an eighth with quadratic."""
    linear = CELL_TYPES[kind].linear == kind
    coarse, fine = (harmonic_error(kind, name, n) for n in ((3, 6) if linear else (2, 4)))
    assert fine <= 1e-3
    assert np.log2(coarse / fine) >= (2.0 if linear else 3.0)
