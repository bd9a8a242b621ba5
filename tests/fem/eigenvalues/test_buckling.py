"""Load factors against columns, heat, and dense eigenvalues with a geometric stiffness by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt
import pytest
from scipy.linalg import eigh

import gpusim as gs
from gpusim.errors import InputError, NotConverged
from gpusim.fem.eigenvalues import buckling as procedure
from gpusim.fem.elements.element import ELEMENTS
from gpusim.fem.elements.strain import point_stress
from gpusim.fem.model.elimination import eliminate
from tests.support.element_meshes import linear_mesh, mesh_of
from tests.support.fem_reference import direct, stiffness

Float = npt.NDArray[np.float64]
SOFT = gs.Isotropic(1000.0, 0.3)


def pushed(
    mesh: gs.Mesh, load: tuple[float, float, float], material: gs.Isotropic = SOFT, **more: object
) -> gs.Model:
    fixed = np.repeat(mesh.points[:, :1] < 1e-9, 3, axis=1)
    end = float(mesh.points[:, 0].max()) - 1e-9
    force = gs.fem.traction(
        mesh, gs.mesh.select_faces(mesh, normal="+x", bounds={"x_min": end}), load
    )
    return gs.Model(mesh, material, fixed, force, **more)  # type: ignore[arg-type]


def column(load: float = -1.0) -> gs.Model:
    return pushed(gs.mesh.box((1.0, 0.1, 0.1), (30, 3, 3)), (load, 0, 0), gs.Isotropic(1000.0, 0.0))


def geometric(model: gs.Model, formulation: dict[str, str], u: Float) -> Float:
    """(3N,3N), cell by cell and point by point."""
    count = model.mesh.node_count
    total = np.zeros((count, count))
    for kind, _, cells in model.mesh.blocks():
        rule = ELEMENTS[kind].rule(formulation[kind])
        moduli = model.materials[0].stiffness()
        for cell in cells:
            nodes = model.mesh.points[cell]
            stress, _ = point_stress(kind, formulation[kind], nodes[None], u[cell][None], moduli)
            for point, weight in enumerate(rule.weight):
                jacobian = nodes.T @ rule.gradient[point]
                slope = rule.gradient[point] @ np.linalg.inv(jacobian)
                xx, yy, zz, xy, yz, zx = stress[0, point]
                s = np.array([[xx, xy, zx], [xy, yy, yz], [zx, yz, zz]])
                part = slope @ s @ slope.T * np.linalg.det(jacobian) * weight
                total[np.ix_(cell, cell)] += part
    return np.kron(total, np.eye(3))


def dense(model: gs.Model, formulation: dict[str, str]) -> Float:
    """All factors."""
    u = direct(model, formulation)
    k, g = stiffness(model, formulation).toarray(), geometric(model, formulation, u)
    assert model.fixed is not None
    free = np.flatnonzero(~model.fixed.ravel())
    mu = eigh(-g[np.ix_(free, free)], k[np.ix_(free, free)], eigvals_only=True)
    return 1.0 / mu[np.abs(mu) > 1e-8 * np.abs(mu).max()]


def test_a_column_buckles_as_engesser_says() -> None:
    found = gs.buckling(column(), 3)
    euler = np.pi**2 * 1000.0 * 0.1**4 / 12.0 / 4.0
    by_shear = euler / (1.0 + euler / (5.0 / 6.0 * 500.0 * 0.01))
    assert found.converged
    assert np.allclose(found.factors[:2] * 0.01, by_shear, rtol=3e-3)
    assert found.reversed_factor == -np.inf
    assert np.isclose(np.abs(found.shapes).max(axis=(1, 2)), 1.0).all()
    # the shape of half a cosine
    x = found.model.mesh.points[:, 0]  # type: ignore[union-attr]
    side = np.linalg.norm(found.shapes[0][:, 1:], axis=1)
    assert np.abs(side / side.max() - (1.0 - np.cos(0.5 * np.pi * x))).max() <= 0.01


def test_a_heated_column_held_at_both_ends() -> None:
    """4 pi^2 E I / L^2 = E A alpha T."""
    mesh = gs.mesh.box((1.0, 0.02, 0.02), (40, 2, 2))
    ends = np.isclose(mesh.points[:, :1] % 1.0, 0.0)
    warm = gs.Isotropic(1000.0, 0.0, expansion=1e-5)
    model = gs.Model(mesh, warm, np.repeat(ends, 3, axis=1), temperature=2.0)
    critical = 4.0 * np.pi**2 * 0.02**2 / 12.0 / 1e-5 / 2.0
    assert gs.buckling(model, 1).factors[0] == pytest.approx(critical, rel=5e-3)


CASES = [
    ("hex8", "incompatible"), ("hex8", "full"), ("hex8", "bbar"), ("hex20", "full"),
    ("hex20", "reduced"), ("tet4", "full"), ("tet10", "full"), ("wedge15", "full"),
    ("pyramid5", "full"),
]  # fmt: skip


@pytest.mark.parametrize(("kind", "formulation"), CASES)
def test_elements_against_dense_eigenvalues(kind: str, formulation: str) -> None:
    """Pushed to one side: of both signs."""
    model = pushed(mesh_of(kind, (2, 2, 3), 0.05), (-1.0, 1.5, 0.0))
    found = gs.buckling(model, 4, formulation={kind: formulation})
    factors = dense(model, {kind: formulation})
    positive = np.sort(factors[factors > 0.0])
    assert found.converged
    assert np.abs(found.factors / positive[:4] - 1.0).max() <= 1e-6
    # of this load the other way around a bound, of that one the other way around the factor
    least = factors[factors < 0.0].max()
    assert 1.05 * least <= found.reversed_factor <= least * (1.0 - 1e-6)
    assert model.forces is not None
    back = gs.buckling(replace(model, forces=-model.forces), 1, formulation={kind: formulation})
    assert back.reversed_factor == pytest.approx(-positive[0], rel=1e-6)


def test_multigrid_finds_the_same() -> None:
    model = pushed(linear_mesh("hex8", (6, 5, 5), 0.02), (-1.0, 0.2, 0.0))
    one, other = (gs.buckling(model, 3, method=method) for method in ("direct", "multigrid"))
    assert other.method == "multigrid"
    assert model.forces is not None
    with pytest.raises(NotConverged, match=f"buckles the body at {-one.factors[0]:.4g} times"):
        gs.buckling(replace(model, forces=-model.forces), 1, method="multigrid")
    assert other.converged
    assert np.abs(one.factors / other.factors - 1.0).max() <= 1e-6


def test_constraints_and_prescribed_displacements() -> None:
    """A column shortened by its end, whose nodes move alike: clamped, and guided."""
    mesh = gs.mesh.box((1.0, 0.05, 0.05), (30, 2, 2))
    ends = [np.flatnonzero(np.isclose(mesh.points[:, 0], x)) for x in (0.0, 1.0)]
    fixed = np.zeros((mesh.node_count, 3), dtype=bool)
    fixed[ends[0]] = True
    fixed[ends[1][0], 0] = True
    given = np.zeros(fixed.shape)
    given[ends[1][0], 0] = -1e-3
    alike = [
        ([(n, axis, 1.0), (ends[1][0], axis, -1.0)], 0.0) for axis in "xyz" for n in ends[1][1:]
    ]
    model = gs.Model(
        mesh, gs.Isotropic(1000.0, 0.0), fixed, prescribed=given,
        constraints=gs.fem.equations(mesh, alike),
    )  # fmt: skip
    assert eliminate(model) is not None
    critical = np.pi**2 * 0.05**2 / 12.0 / 1e-3
    found = gs.buckling(model, 1)
    assert found.factors[0] == pytest.approx(critical, rel=0.02)
    assert found.warnings == ("factors multiply the displacements of supports, too",)


def test_what_doesnt_buckle_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    model = column()
    with pytest.raises(NotConverged, match="no positive load factor"):
        gs.buckling(column(1.0), 2)
    still = gs.Model(model.mesh, SOFT, model.fixed)
    with pytest.raises(InputError, match="no stress"):
        gs.buckling(still)
    with pytest.raises(InputError, match="no stress"):
        gs.buckling(gs.Model(model.mesh, SOFT, model.fixed, 1e-200 * model.load_cases))
    twice = gs.Model(model.mesh, SOFT, model.fixed, np.repeat(model.load_cases, 2, axis=0))
    with pytest.raises(InputError, match="one load case"):
        gs.buckling(twice)
    with pytest.raises(InputError, match="can move freely"):
        gs.buckling(gs.Model(model.mesh, SOFT, None, model.forces))
    for wrong, text in (({"count": 0}, "at least 1"), ({"progress": 1}, "a function")):
        with pytest.raises(InputError, match=text):
            gs.buckling(model, **wrong)  # type: ignore[arg-type]
    tiny = pushed(gs.mesh.box((1.0, 0.1, 0.1), (1, 1, 1)), (-1.0, 0.0, 0.0))
    monkeypatch.delattr(procedure, "solve")
    with pytest.raises(InputError, match="buckling: count; got 13; expected at most 12"):
        gs.buckling(tiny, 13)
