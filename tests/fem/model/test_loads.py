"""Consistent loads on every element: totals, moments, rotation, lines, symmetry, and refusals."""

from __future__ import annotations

import numpy as np
import pytest

from gpusim.errors import InputError
from gpusim.fem import (
    Isotropic,
    Model,
    body_force,
    centrifugal,
    face_force,
    line_force,
    pressure,
    stress,
    symmetry,
    traction,
)
from gpusim.fem.elements.element import ELEMENTS
from gpusim.mesh import Mesh, boundary_faces, box, quadratic, select_faces, select_nodes
from tests.support.fem_reference import bar, direct

SIZE = (2.0, 1.0, 0.5)
CENTRE = np.array([1.0, 0.5, 0.25])


@pytest.mark.parametrize("kind", list(ELEMENTS))
def test_totals_and_moments(kind: str) -> None:
    mesh = bar(kind, SIZE, (3, 2, 1))
    end = select_faces(mesh, normal="+x")
    pull = traction(mesh, end, (1.0, 2.0, 3.0))
    np.testing.assert_allclose(pull.sum(axis=0), [0.5, 1.0, 1.5], rtol=1e-13)
    np.testing.assert_allclose(pull[:, 0] @ mesh.points, 0.5 * np.array([2, 0.5, 0.25]), rtol=1e-13)
    np.testing.assert_allclose(face_force(mesh, end, (1.0, 2.0, 3.0)), 2.0 * pull, atol=1e-14)
    everywhere = pressure(mesh, boundary_faces(mesh), 3.0)
    assert np.abs(everywhere.sum(axis=0)).max() <= 1e-14
    assert np.abs(np.cross(mesh.points, everywhere).sum(axis=0)).max() <= 1e-14
    # but with each point's own direction, pressure does the work of a volume change: -3 x 3 V
    assert abs((everywhere * mesh.points).sum() + 9.0) <= 1e-13
    weight = body_force(mesh, 2.0, (1.0, 2.0, 3.0))
    moment = np.einsum("ni,nj->ij", weight, mesh.points)
    np.testing.assert_allclose(moment, np.outer([2.0, 4.0, 6.0], CENTRE), rtol=1e-13)


@pytest.mark.parametrize("kind", list(ELEMENTS))
def test_rotation_pulls_outward(kind: str) -> None:
    mesh = bar(kind, SIZE, (3, 2, 1))
    force = centrifugal(mesh, 2.0, (0.3, -0.2, 7.0), (0.0, 0.0, -2.0), 3.0)
    arm = CENTRE - [0.3, -0.2, 0.25]
    np.testing.assert_allclose(force.sum(axis=0), 2.0 * 9.0 * arm, rtol=1e-13, atol=1e-13)
    # against a uniform stretch about the centre: rho w^2 V times the box's L^2 / 12
    second = 2.0 * 9.0 * np.array(SIZE[:2]) ** 2 / 12.0
    about_centre = (force[:, :2] * (mesh.points - CENTRE)[:, :2]).sum(axis=0)
    np.testing.assert_allclose(about_centre, second, rtol=1e-12)


def test_a_rule_of_the_stiffness_may_be_asked_for() -> None:
    mesh = bar("tet10", SIZE, (1, 1, 1))
    exact = centrifugal(mesh, 1.0, (0, 0, 0), (0, 0, 1), 1.0)
    coarse = centrifugal(mesh, 1.0, (0, 0, 0), (0, 0, 1), 1.0, formulation={"tet10": "full"})
    np.testing.assert_allclose(coarse.sum(axis=0), exact.sum(axis=0), rtol=1e-12)
    assert np.abs(coarse - exact).max() > 1e-4


@pytest.mark.parametrize("kind", ["hex8", "hex20"])
def test_spinning_bar(kind: str) -> None:
    """nu = 0, held at its middle: s(x) = rho w^2 (L^2 - x^2) / 2 and u(L) = rho w^2 L^3 / (3 E)."""
    mesh = bar(kind, (2.0, 0.1, 0.1), (16, 1, 1))
    fixed = np.zeros(mesh.points.shape, bool)
    fixed[:, 1:] = True
    fixed[mesh.points[:, 0] == 0.0, 0] = True
    force = centrifugal(mesh, 3.0, (0.0, 0.05, 0.05), (0.0, 0.0, 1.0), 2.0)
    model = Model(mesh, [Isotropic(100.0, 0.0)], fixed, force)
    u = direct(model)
    end = np.abs(u[mesh.points[:, 0] == 2.0, 0]).max()
    assert abs(end / (3.0 * 4.0 * 8.0 / 300.0) - 1.0) <= 1e-12
    exact = 3.0 * 4.0 * (4.0 - mesh.points[:, 0] ** 2) / 2.0
    error = np.abs(stress(model, u).nodal[:, 0] - exact).max() / exact.max()
    assert error <= (0.07 if kind == "hex8" else 0.003)


def annulus(n: int) -> Mesh:
    """A quarter of a thin disc with a hole, hex20 with midside nodes on the circles."""
    flat = quadratic(box((1.0, np.pi / 2, 0.05), (n, 2 * n, 1), (1.0, 0.0, 0.0)))
    r, angle, z = flat.points.T
    points = np.stack([r * np.cos(angle), r * np.sin(angle), z], axis=1)
    return Mesh(points, flat.cells)


def test_rotating_disc() -> None:
    """Thin annular disc: hoop stress at the hole (Timoshenko & Goodier, Theory of Elasticity)."""
    mesh = annulus(6)
    faces = boundary_faces(mesh)
    fixed = symmetry(mesh, faces[faces.normals[:, 0] < -0.999])
    fixed |= symmetry(mesh, faces[faces.normals[:, 1] < -0.999])
    fixed |= symmetry(mesh, faces[faces.normals[:, 2] < -0.999])
    nu, rho, omega, a, b = 0.3, 2.0, 3.0, 1.0, 2.0
    force = centrifugal(mesh, rho, (0, 0, 0), (0, 0, 1), omega)
    model = Model(mesh, [Isotropic(100.0, nu)], fixed, force)
    u = direct(model)
    found = stress(model, u)
    radius = np.hypot(mesh.points[:, 0], mesh.points[:, 1])
    x, y = (mesh.points[:, :2] / radius[:, None]).T
    s = found.nodal
    hoop = s[:, 0] * y**2 + s[:, 1] * x**2 - 2.0 * s[:, 3] * x * y
    factor = (3.0 + nu) / 8.0 * rho * omega**2
    exact = factor * (
        a**2 + b**2 + (a * b / radius) ** 2 - (1.0 + 3.0 * nu) / (3.0 + nu) * radius**2
    )
    assert np.abs(hoop - exact).max() <= 0.01 * exact.max()
    outer = np.abs(radius - b) < 1e-9
    growth = (u[:, 0] * x + u[:, 1] * y)[outer]
    np.testing.assert_allclose(growth, b / 100.0 * exact[outer], rtol=5e-4)


@pytest.mark.parametrize(
    ("kind", "shares"), [("hex8", [1.5, 1.5, 3.0]), ("hex20", [0.5, 0.5, 1.0, 2.0, 2.0])]
)
def test_line_force(kind: str, shares: list[float]) -> None:
    mesh = bar(kind, SIZE, (3, 2, 1))
    edge = select_nodes(mesh, bounds={"x_min": 2.0, "z_min": 0.5})
    force = line_force(mesh, edge, (0.0, 0.0, 6.0))
    assert sorted(force[edge, 2]) == pytest.approx(shares)
    assert abs(force[:, 2] @ mesh.points[:, 1] - 3.0) <= 1e-13
    assert not force[:, :2].any() and abs(force.sum() - 6.0) <= 1e-13


def test_line_force_goes_by_length() -> None:
    mesh = box((1.0, 1.0, 1.0), (2, 1, 1))
    mesh = mesh.moved(np.where(np.abs(mesh.points[:, :1] - 0.5) < 0.1, [[0.25, 0.0, 0.0]], 0.0))
    edge = select_nodes(mesh, bounds={"y_max": 0.0, "z_max": 0.0})
    force = line_force(mesh, edge[::-1], (8.0, 0.0, 0.0))
    np.testing.assert_allclose(force[edge, 0], [3.0, 4.0, 1.0], rtol=1e-14)


def test_what_is_no_line_is_refused() -> None:
    mesh = box((1.0, 1.0, 1.0), (2, 2, 1))
    total = (0.0, 0.0, 1.0)
    with pytest.raises(InputError, match="form an area or branches, not a line; got 4 edges"):
        line_force(mesh, select_nodes(mesh, bounds={"z_max": 0.0}), total)
    with pytest.raises(InputError, match=r"2 nodes aren't joined .* got node 0 at \[0.0, 0.0, 0"):
        line_force(mesh, np.array([0, mesh.node_count - 1]), total)
    with pytest.raises(InputError, match="expected 0 … 17"):
        line_force(mesh, np.array([0, 18]), total)
    with pytest.raises(InputError, match="integer node numbers"):
        line_force(mesh, np.array([0.5]), total)
    with pytest.raises(InputError, match="line_force: total"):
        line_force(mesh, np.array([0, 1]), (0.0, np.nan, 1.0))


def test_symmetry_holds_the_normal_only() -> None:
    mesh = bar("wedge15", SIZE, (2, 1, 1))
    fixed = symmetry(mesh, select_faces(mesh, normal="-y"))
    on_plane = mesh.points[:, 1] == 0.0
    np.testing.assert_array_equal(fixed[:, 1], on_plane)
    assert not fixed[:, [0, 2]].any()


def test_symmetry_needs_a_plane_across_an_axis() -> None:
    mesh = box(SIZE, (2, 1, 1))
    with pytest.raises(InputError, match="aren't in one plane across an axis"):
        symmetry(mesh, boundary_faces(mesh))
    turned = Mesh(mesh.points @ np.array([[0.8, 0.6, 0], [-0.6, 0.8, 0], [0, 0, 1.0]]), mesh.cells)
    with pytest.raises(InputError, match=r"a normal \(0.8, 0.6, 0\); expected a flat selection"):
        symmetry(turned, select_faces(turned, normal=(0.8, 0.6, 0.0), angle=0.01))
    with pytest.raises(InputError, match="no faces"):
        symmetry(mesh, boundary_faces(mesh)[np.zeros(0, np.int64)])


def test_wrong_rotation_is_refused() -> None:
    mesh = box(SIZE, (1, 1, 1))
    with pytest.raises(InputError, match="axis; got"):
        centrifugal(mesh, 1.0, (0, 0, 0), (0, 0, 0), 1.0)
    with pytest.raises(InputError, match="omega"):
        centrifugal(mesh, 1.0, (0, 0, 0), (0, 0, 1), np.inf)
    with pytest.raises(InputError, match="centrifugal: density"):
        centrifugal(mesh, np.ones(3), (0, 0, 0), (0, 0, 1), 1.0)
