"""The equation of equilibrium: residuals and tangents of whole models."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

import gpusim as gs
from gpusim.fem.assembly.assembly import assemble
from gpusim.fem.assembly.element_responses import element_responses
from gpusim.fem.assembly.equation import Equation
from gpusim.fem.elements.element_response import Want
from gpusim.fem.model.model import resolve_formulation
from gpusim.fem.sparse.block_rows import block_matrix
from tests.support.element_meshes import linear_mesh, mixed_mesh
from tests.support.element_responses import tensors

Float = npt.NDArray[np.float64]
STEEL = gs.Isotropic(200.0, 0.3, expansion=1e-3)
RUBBER = gs.NeoHookean(3.0, 0.4, expansion=2e-3)


def clamped(mesh: gs.Mesh, materials: Any, **others: Any) -> gs.Model:
    """Held where x is least."""
    x = mesh.points[:, 0]
    fixed = np.repeat((x < x.min() + 1e-9)[:, None], 3, axis=1)
    return gs.Model(mesh, materials, fixed, **others)


def equation(model: gs.Model, formulation: Any = None) -> Equation:
    return Equation(model, element_responses(model, resolve_formulation(model, formulation)))


def two_laws(mesh: gs.Mesh) -> gs.Model:
    """Steel and rubber, pressed and warm."""
    number = np.arange(mesh.cell_count, dtype=np.int32) % 2
    load = gs.fem.FollowerPressure(gs.mesh.boundary_faces(mesh), 0.2)
    heat = 20.0 * mesh.points[:, 1]
    return clamped(mesh, [STEEL, RUBBER], material_of_cell=number, loads=load, temperature=heat)


def motion(mesh: gs.Mesh, size: float = 0.03) -> Float:
    """Bending, a turn and some noise."""
    x, y, z = (mesh.points - mesh.points.mean(axis=0)).T
    smooth = np.stack([-x * z - 0.5 * y, 0.5 * x + 0.1 * y * z, x * x], axis=1)
    return 0.3 * smooth + size * np.random.default_rng(2).normal(size=mesh.points.shape)


MESHES = {
    "hex8": lambda: linear_mesh("hex8", (2, 2, 2), 0.05),
    "mixed": lambda: mixed_mesh(0.02),
    "hex20": lambda: gs.mesh.quadratic(linear_mesh("hex8", (2, 1, 1), 0.05)),
}


def change_of_the_residual(of: Equation, u: Float, factors: Float, step: Float) -> Float:
    """Derivative along ``step``, by differences of fourth order."""

    def residual(h: float) -> Float:
        return of.linearised(u + h * step, factors).residual

    h = 1e-4
    first = (residual(h) - residual(-h)) / (2.0 * h)
    second = (residual(2 * h) - residual(-2 * h)) / (4.0 * h)
    return (4.0 * first - second) / 3.0


@pytest.mark.parametrize("name", MESHES)
def test_the_tangent_is_minus_the_derivative_of_the_residual(name: str) -> None:
    model = two_laws(MESHES[name]())
    # modes have residual forces of their own, that condensed ones don't show: tested by element
    of = equation(model, {"hex8": "bbar"})
    u, factors = motion(model.mesh), np.array([0.8])
    step = np.random.default_rng(6).normal(size=u.shape)
    linearised = of.linearised(u, factors)
    # all around a body a pressure has a potential
    assert linearised.skew is None
    tangent = block_matrix(linearised.assembled.rows)
    derivative = change_of_the_residual(of, u, factors, step)
    found = -(tangent @ step.ravel()).reshape(-1, 3)
    assert np.abs(found - derivative).max() <= 1e-7 * np.abs(derivative).max()
    assert abs(tangent - tangent.T).max() <= 1e-14 * abs(tangent).max()
    # and one wrong number would be seen
    tangent.data[3, 1, 1] *= 1.001
    wrong = -(tangent @ step.ravel()).reshape(-1, 3)
    assert np.abs(wrong - derivative).max() > 1e-7 * np.abs(derivative).max()


@pytest.mark.parametrize("name", MESHES)
def test_a_pressure_with_free_edges_has_a_skew_part(name: str) -> None:
    mesh = MESHES[name]()
    pressed = gs.fem.FollowerPressure(gs.mesh.select_faces(mesh, normal="+x"), 5.0)
    model = clamped(mesh, RUBBER, loads=pressed)
    of = equation(model, {"hex8": "bbar"})
    u, factors = motion(mesh), np.array([0.8])
    step = np.where(of.free, np.random.default_rng(6).normal(size=u.shape), 0.0)
    tangent = of.linearised(u, factors)
    assert tangent.skew is not None
    assert abs(tangent.skew + tangent.skew.T).max() <= 1e-14 * abs(tangent.skew).max()
    symmetric = block_matrix(tangent.assembled.rows) @ step.ravel()
    derivative = np.where(of.free, change_of_the_residual(of, u, factors, step), 0.0)
    part, whole = (
        np.where(of.free, -one.reshape(-1, 3), 0.0)
        for one in (symmetric, symmetric + tangent.skew @ step.ravel())
    )
    assert np.abs(whole - derivative).max() <= 1e-7 * np.abs(derivative).max()
    assert np.abs(part - derivative).max() > 1e-3 * np.abs(derivative).max()
    # nothing is left of it where all edges are held, or slide in planes that they lie in
    points = mesh.points
    side = np.isclose(points, points.min(axis=0)) | np.isclose(points, points.max(axis=0))
    held = np.repeat(side[:, 1:].any(axis=1)[:, None], 3, axis=1)
    for other in (held, side & [False, True, True]):
        closed = equation(replace(model, fixed=model.fixed | other))
        assert closed.skew_stiffness(np.zeros_like(u), factors) is None


def test_the_skew_part_is_that_of_what_constraints_leave() -> None:
    mesh = MESHES["hex8"]()
    end = np.flatnonzero(mesh.points[:, 0] == mesh.points[:, 0].max())
    # one node follows two others across, by halves
    rows = [
        ([(end[0], axis, 1.0), (end[1], axis, -0.5), (end[2], axis, -0.5)], 0.0) for axis in "yz"
    ]
    pressed = gs.fem.FollowerPressure(gs.mesh.select_faces(mesh, normal="+x"), 5.0)
    model = clamped(mesh, RUBBER, loads=pressed, constraints=[gs.fem.equations(mesh, rows)])
    of = equation(model, {"hex8": "bbar"})
    assert of.elimination is not None
    u, factors = of.elimination.displacements(motion(mesh)[None])[0], np.array([0.8])
    step = np.where(of.unknown, np.random.default_rng(6).normal(size=u.shape), 0.0)
    whole = of.elimination.displacements(step[None])[0]
    tangent = of.linearised(u, factors)
    assert tangent.skew is not None
    symmetric = (block_matrix(tangent.assembled.rows) @ whole.ravel()).reshape(-1, 3)
    found = -of.unbalanced(symmetric) - (tangent.skew @ step.ravel()).reshape(-1, 3)
    derivative = of.unbalanced(change_of_the_residual(of, u, factors, whole))
    assert np.abs(found - derivative).max() <= 1e-7 * np.abs(derivative).max()
    plain = equation(replace(model, constraints=()), {"hex8": "bbar"}).skew_stiffness(u, factors)
    assert abs(tangent.skew - plain).max() > 1e-2 * abs(plain).max()


def test_at_rest_the_tangent_is_the_stiffness_of_linear_statics() -> None:
    mesh = linear_mesh("hex8", (3, 2, 2), 0.05)
    number = np.arange(mesh.cell_count, dtype=np.int32) % 2
    laws = [STEEL, gs.SaintVenantKirchhoff(3.0, 0.2)]
    model = clamped(mesh, laws, material_of_cell=number)
    linear = replace(model, materials=[STEEL, gs.Isotropic(3.0, 0.2)])
    for formulation in ("incompatible", "bbar", "full"):
        names = {"hex8": formulation}
        rows = equation(model, names).linearised(np.zeros_like(mesh.points), np.ones(1)).assembled
        wanted = block_matrix(assemble(linear, names).rows)
        assert abs(block_matrix(rows.rows) - wanted).max() <= 1e-13 * abs(wanted).max()


def test_a_pattern_filled_again_is_that_of_a_fresh_equation() -> None:
    model = two_laws(linear_mesh("hex8", (2, 2, 2), 0.05))
    used = equation(model)
    used.linearised(motion(model.mesh, 0.01), np.array([0.3]))
    u, factors = motion(model.mesh), np.array([0.9])
    again, fresh = used.linearised(u, factors), equation(model).linearised(u, factors)
    assert (again.residual == fresh.residual).all()
    assert (again.assembled.rows.table == fresh.assembled.rows.table).all()


def test_residuals_come_with_the_tangent_and_alone() -> None:
    model = two_laws(mixed_mesh(0.02))
    of = equation(model)
    u, factors = motion(model.mesh), np.array([0.7])
    both = of.linearised(u, factors).residual
    alone = of.external(u, factors) - of.internal(u, factors)
    assert np.abs(both - alone).max() <= 1e-12 * np.abs(both).max()


def test_the_material_part_is_definite_where_the_tangent_is_not() -> None:
    mesh = linear_mesh("hex8", (2, 2, 2))
    model = clamped(mesh, STEEL)
    of = equation(model)
    pressed = mesh.points * [-0.6, 0.0, 0.0]
    free = of.free.ravel()

    def least(want: Want) -> float:
        rows = of.linearised(pressed, np.ones(1), want).assembled.rows
        matrix = block_matrix(rows).toarray()[np.ix_(free, free)]
        return float(np.linalg.eigvalsh(matrix)[0])

    assert least(Want.TANGENT) < 0.0 < least(Want.MATERIAL)


def test_loads_and_supports_follow_their_factors() -> None:
    mesh = linear_mesh("hex8", (2, 1, 1))
    forces = np.random.default_rng(1).normal(size=(2, *mesh.points.shape))
    model = clamped(mesh, STEEL, forces=forces)
    prescribed = np.where(model.fixed, 0.1, 0.0) * np.array([1.0, 2.0])[:, None, None]
    of = equation(replace(model, prescribed=prescribed))
    factors = np.array([0.5, -2.0])
    zero = np.zeros_like(mesh.points)
    assert np.allclose(of.external(zero, factors), 0.5 * forces[0] - 2.0 * forces[1])
    assert np.allclose(of.prescribed(factors), 0.5 * prescribed[0] - 2.0 * prescribed[1])


class Fibres(gs.Hencky):
    """A user's own, which heat stretches otherwise along axes of its own."""

    def expansion_strain(self) -> Float:
        return np.array([1e-3, -5e-4, 2e-3, 4e-4, -3e-4, 1e-3])


def test_warm_material_is_free_of_stress_however_it_turns() -> None:
    mesh = linear_mesh("hex8", (2, 2, 2), 0.05)
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    warm = gs.Isotropic(5.0, 0.2, expansion=1e-3)
    for law in (STEEL, RUBBER, gs.J2(warm, 1.0), Fibres(5.0, 0.2)):
        model = clamped(mesh, law, temperature=50.0)
        stretch = np.eye(3) + 50.0 * tensors(law.expansion_strain(), 0.5)
        u = mesh.points @ (turn @ stretch).T - mesh.points
        of = equation(model)
        cold = np.abs(of.internal(u, np.zeros(1))).max()
        assert np.abs(of.internal(u, np.ones(1))).max() <= 1e-12 * cold


@pytest.mark.parametrize("formulation", ["incompatible", "bbar", "full"])
def test_material_parts_of_flowing_metal_are_definite_far_from_equilibrium(
    formulation: str,
) -> None:
    # stress that is far beyond what hardens makes the law's own moduli indefinite
    mesh = linear_mesh("hex8", (2, 2, 2))
    law = gs.J2(gs.Isotropic(200e3, 0.3), yield_stress=250.0, hardening=10.0)
    model = clamped(mesh, law)
    of = equation(model, {"hex8": formulation})
    pulled = mesh.points * [0.05, 0.0, 0.0]
    moduli = law.update(np.array([0.05, 0.0, 0.0, 0.0, 0.0, 0.0]), None, moduli=True).moduli
    assert moduli is not None and np.linalg.eigvalsh(moduli)[0] < 0.0
    rows = of.linearised(pulled, np.ones(1), Want.MATERIAL).assembled.rows
    free = of.free.ravel()
    matrix = block_matrix(rows).toarray()[np.ix_(free, free)]
    assert np.linalg.eigvalsh(matrix)[0] > 0.0
