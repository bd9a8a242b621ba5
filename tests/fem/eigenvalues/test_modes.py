"""Modes against dense eigenvalues of every element type, theory, and hostile models."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq

import gpusim as gs
from gpusim.errors import InputError, NotConverged
from gpusim.fem.assembly import node_graph
from gpusim.fem.eigenvalues import davidson as iteration
from gpusim.fem.eigenvalues import modes as procedure
from gpusim.fem.elements.element import ELEMENTS
from gpusim.fem.linear import solve_plan
from tests.support.dense_modes import STEEL, agree, dense, held, together
from tests.support.element_meshes import mesh_of

EVERY = [(kind, name) for kind, one in ELEMENTS.items() for name in one.formulations]


@pytest.mark.parametrize(("kind", "formulation"), EVERY)
def test_every_element_against_dense_eigenvalues(kind: str, formulation: str) -> None:
    model = held(mesh_of(kind, (2, 2, 3), 0.05))
    found = gs.modes(model, 6, formulation={kind: formulation})
    agree(found, model, formulation={kind: formulation})


def comb(teeth: int) -> gs.Mesh:
    """Equal teeth on a common base: a cluster of as many modes."""
    mesh = gs.mesh.box((9.0 * teeth, 30.0, 4.0), (3 * teeth, 10, 1))
    middle = mesh.points[mesh.cells["hex8"]].mean(axis=1)
    keep = (middle[:, 1] < 6.0) | (middle[:, 0] % 9.0 < 3.0)
    used, cells = np.unique(mesh.cells["hex8"][keep], return_inverse=True)
    return gs.Mesh(mesh.points[used], {"hex8": cells.reshape(-1, 8)})


def tied(free: bool = False) -> gs.Model:
    lower = gs.mesh.box(size=(2, 2, 1), divisions=(2, 2, 1))
    both = together(lower, gs.mesh.box(size=(2, 2, 1), divisions=(3, 3, 2), origin=(0, 0, 1)))
    level = {"z_min": 1.0, "z_max": 1.0}
    joint = [gs.mesh.select_faces(both, bounds=level, normal=n) for n in ("+z", "-z")]
    fixed = np.repeat(both.points[:, 2:] == 0.0, 3, axis=1) & (not free)
    return gs.Model(both, STEEL, fixed, constraints=gs.fem.tie(both, *joint))


def on_base(mesh: gs.Mesh) -> gs.Model:
    return gs.Model(mesh, STEEL, np.repeat(mesh.points[:, 1:2] == 0.0, 3, axis=1))


CUBE = gs.mesh.box((1.0, 1.0, 1.0), (5, 5, 5))
MODELS: dict[str, tuple[Callable[[], gs.Model], int]] = {
    "rod whose modes are pairs": (lambda: held(gs.mesh.box((8, 1, 1), (20, 3, 3))), 9),
    "cube whose modes are triples": (lambda: gs.Model(CUBE, STEEL), 15),
    "comb, a cluster of six": (lambda: on_base(comb(6)), 8),
    "free plate": (lambda: gs.Model(gs.mesh.box((10, 10, 0.3), (10, 10, 1)), STEEL), 12),
    "tied": (tied, 7),
    "tied and free": (lambda: tied(free=True), 10),
    "all modes that it has": (lambda: held(gs.mesh.box((1, 1, 1), (1, 1, 1))), 12),
    "all but one": (lambda: held(gs.mesh.box((2, 1, 1), (2, 1, 1))), 23),
}


@pytest.mark.parametrize("method", ["direct", "multigrid"])
@pytest.mark.parametrize("name", MODELS)
def test_doubles_and_clusters_are_complete(name: str, method: str) -> None:
    build, count = MODELS[name]
    model = build()
    agree(gs.modes(model, count, method=method), model)


@pytest.mark.parametrize("rule", ["calculix", "lumped"])
def test_mass_rules(rule: str) -> None:
    model = held(mesh_of("tet10", (2, 2, 2)))
    found = gs.modes(model, 5, mass=rule)
    frequencies, _ = dense(model, rule=rule)
    assert np.abs(found.frequencies / frequencies[:5] - 1.0).max() <= 1e-8


def test_effective_masses_of_a_cantilever() -> None:
    """Euler-Bernoulli: 61.3, 18.8 and 6.5 per cent in the first three modes of bending."""
    mesh = gs.mesh.box((20.0, 0.2, 0.1), (60, 1, 1))
    fixed = np.repeat(mesh.points[:, :1] == 0.0, 3, axis=1)
    fixed[:, 1] = True
    material = gs.Isotropic(210e9, 0.0, density=7850.0)
    found = gs.modes(gs.Model(mesh, material, fixed), 4)
    bending = found.effective_mass[:, 2] / found.total_mass[2]
    assert np.allclose(np.sort(bending)[::-1][:3], [0.6131, 0.1883, 0.0647], atol=1e-3)
    assert np.allclose(found.angular, 2.0 * np.pi * found.frequencies)


def cantilever(load: float) -> gs.Model:
    """Of Euler's load P = 1.0; pulled with ``load`` times it."""
    mesh = gs.mesh.box((10.0, 0.1, 0.1), (60, 1, 1))
    fixed = np.repeat(mesh.points[:, :1] == 0.0, 3, axis=1)
    fixed[:, 1] = True
    euler = np.pi**2 * 210e9 * 0.1**4 / 12.0 / (4.0 * 10.0**2)
    pull = gs.fem.traction(
        mesh, gs.mesh.select_faces(mesh, name="x_max"), (load * euler / 0.01, 0.0, 0.0)
    )
    return gs.Model(mesh, gs.Isotropic(210e9, 0.0, density=7850.0), fixed, pull)


def beam_value(load: float) -> float:
    """beta^4 of the lowest mode of a cantilever of unit length, stiffness and mass per length under
    a tension of ``load`` times Euler's, that keeps its direction at the end."""
    tension = load * np.pi**2 / 4.0

    def determinant(value: float) -> float:
        root = np.sqrt(0.25 * tension**2 + value)
        a, b = np.sqrt(root + 0.5 * tension), np.sqrt(root - 0.5 * tension)
        # w = A (cosh ax - cos bx) + B (sinh ax - a/b sin bx): w'' = 0 and w''' = T w' at the end
        m = [
            [a**2 * np.cosh(a) + b**2 * np.cos(b), a**2 * np.sinh(a) + a * b * np.sin(b)],
            [
                (a**3 - tension * a) * np.sinh(a) - (b**3 + tension * b) * np.sin(b),
                (a**3 - tension * a) * np.cosh(a) + a / b * (b**3 + tension * b) * np.cos(b),
            ],
        ]
        return float(m[0][0] * m[1][1] - m[0][1] * m[1][0])

    guess = 3.516**2 * (1.0 + load)
    return float(brentq(determinant, 0.6 * guess + 1e-9, 1.7 * guess))


@pytest.mark.parametrize("load", [-0.9, -0.5, 0.5, 2.0])
@pytest.mark.parametrize("geometry", ["linear", "nonlinear"])
def test_prestress_softens_and_stiffens_as_beam_theory_says(load: float, geometry: str) -> None:
    model = cantilever(load)
    state = gs.fem.solve(model, geometry=geometry, tolerance=1e-8)
    stressed = gs.modes(model, 1, prestress=state).frequencies[0]
    expected = np.sqrt(beam_value(load) / beam_value(0.0))
    assert stressed / gs.modes(model, 1).frequencies[0] == pytest.approx(expected, rel=3e-3)


@pytest.mark.parametrize("quadratic", [False, True])
@pytest.mark.parametrize("finite", [False, True])
def test_linear_theory_stresses_a_bent_body_as_the_equilibrium_does(
    quadratic: bool, finite: bool
) -> None:
    """Membrane stress of second order, which linear displacements would make, isn't there: it would
    double the first frequency."""
    mesh = gs.mesh.box((1.0, 0.1, 0.05), (8, 2, 2))
    mesh = gs.mesh.quadratic(mesh) if quadratic else mesh
    end = gs.mesh.select_faces(mesh, name="x_max")
    model = replace(held(mesh), forces=gs.fem.face_force(mesh, end, total=(0, 0, -2e4)))
    linear, bent = (gs.fem.solve(model, geometry=one) for one in ("linear", "nonlinear"))
    assert linear.u[:, 2].min() < -0.028
    if finite:
        law = gs.fem.SaintVenantKirchhoff(STEEL.E, STEEL.nu, density=STEEL.density)
        linear = replace(linear, model=replace(model, materials=[law]))
    found = gs.modes(linear.model, 4, prestress=linear).frequencies
    assert np.abs(found / gs.modes(model, 4, prestress=bent).frequencies - 1.0).max() <= 1e-3


def test_the_error_of_a_prestress_is_stated() -> None:
    """Near buckling frequencies change by 500 times what stress changes by."""
    model = cantilever(-1.0)
    assert model.forces is not None
    critical = 0.999 * gs.buckling(model, 1).factors[0]
    model = replace(model, forces=critical * model.forces)
    state = gs.fem.solve(model, tolerance=1e-10)
    off = replace(state, u=state.u * (1.0 - 1e-6), error_estimate=1e-6)
    right, found = (gs.modes(model, 2, prestress=one) for one in (state, off))
    moved = np.abs(found.frequencies / right.frequencies - 1.0)
    assert moved[0] > 4e-4
    assert np.allclose(found.error_estimate, moved, rtol=0.01)
    assert found.converged and right.error_estimate.max() <= 1e-7
    (said,) = found.warnings
    assert "known to 4.8e-04 alone, by the error of the prestress" in said


def test_an_unstable_state_has_no_modes() -> None:
    model = cantilever(-1.2)
    state = gs.fem.solve(model)
    with pytest.raises(NotConverged, match=r"isn't stable .*expected less load"):
        gs.modes(model, 2, prestress=state)


def test_bands() -> None:
    model = held(gs.mesh.box((1, 0.1, 0.1), (8, 1, 1)))
    every = gs.modes(model, 20).frequencies
    inside = (every > 500.0) & (every < 3000.0)
    assert np.allclose(gs.modes(model, 2, band=(500.0, 3000.0)).frequencies, every[inside])
    assert gs.modes(model, band=(100.0, 200.0)).shapes.shape == (0, 36, 3)
    free = gs.modes(gs.Model(model.mesh, STEEL), band=(0.0, 600.0))
    assert len(free.rigid) == 6 < len(free.frequencies)


def test_bands_with_too_many_modes_are_refused_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    model = held(gs.mesh.box((1, 0.5, 0.5), (14, 7, 7)))
    with pytest.raises(InputError, match="more than 1000 below its upper end"):
        gs.modes(model, band=(0.0, 1e6))
    # where that isn't foreseen
    monkeypatch.setattr(procedure, "_MOST", 15)
    monkeypatch.setattr(procedure, "_least_count", lambda *_: 0.0)
    with pytest.raises(InputError, match="more than 15"):
        gs.modes(model, 4, band=(0.0, 1e6))


def test_nearly_incompressible_bodies_take_factors() -> None:
    rubber = gs.Isotropic(2e6, 0.4999, density=1000.0)
    model = held(gs.mesh.box((1, 0.5, 0.5), (8, 4, 4)), rubber)
    found = gs.modes(model, 5, formulation="bbar")
    assert found.method == "direct"
    agree(found, model, formulation="bbar")
    cycles = gs.modes(model, 5, formulation="bbar", method="multigrid")
    assert not cycles.converged
    assert "estimated errors" in cycles.message
    assert cycles.error_estimate.max() > 1e-6


def test_an_uneven_body() -> None:
    mesh = gs.mesh.box((4, 1, 1), (12, 3, 3))
    of_cell = (mesh.points[mesh.cells["hex8"]].mean(axis=1)[:, 0] > 2.0).astype(np.int32)
    soft = gs.Isotropic(210e4, 0.3, density=100.0)
    fixed = np.repeat(mesh.points[:, :1] == 0.0, 3, axis=1)
    model = gs.Model(mesh, [STEEL, soft], fixed, material_of_cell=of_cell)
    agree(gs.modes(model, 8, method="multigrid"), model)


def test_results_are_in_the_models_own_numbers(monkeypatch: pytest.MonkeyPatch) -> None:
    """Also where nodes are numbered anew inside: of modes, of stressed ones, of buckling."""
    mesh = mesh_of("tet10", (4, 3, 3), 0.03)
    order = np.random.default_rng(1).permutation(mesh.node_count)
    cells = np.argsort(order)[mesh.cells["tet10"]]

    def results(mesh: gs.Mesh) -> tuple[gs.Modes, gs.Modes, gs.Buckling]:
        forces = np.where(mesh.points[:, :1] > 0.99, [-1e7, 3e5, 0.0], 0.0)
        model = held(mesh, forces=forces)
        state = gs.solve(model, tolerance=1e-9)
        return gs.modes(model, 3), gs.modes(model, 3, prestress=state), gs.buckling(model, 2)

    plain = results(mesh)
    monkeypatch.setattr(node_graph, "_FEW", 100)
    for one, other in zip(
        plain, results(gs.Mesh(mesh.points[order], {"tet10": cells})), strict=True
    ):
        for shape, expected in zip(other.shapes, one.shapes[:, order], strict=True):
            off = min(np.abs(shape - expected).max(), np.abs(shape + expected).max())
            assert off <= 1e-4 * np.abs(expected).max()
        if isinstance(one, gs.Modes) and isinstance(other, gs.Modes):
            assert np.allclose(other.frequencies, one.frequencies, rtol=1e-9)
            assert np.allclose(other.effective_mass, one.effective_mass, rtol=1e-4, atol=1e-3)
            assert np.allclose(other.total_mass, one.total_mass, rtol=1e-12)
    assert np.allclose(plain[0].centre, [0.5, 0.4, 0.65])


def test_what_cant_vibrate_is_told() -> None:
    mesh = gs.mesh.box((1, 0.1, 0.1), (8, 1, 1))
    model = held(mesh)
    with pytest.raises(InputError, match=r"materials\[0\] has no density"):
        gs.modes(held(mesh, gs.Isotropic(210e9, 0.3)))
    of_cell = np.arange(8, dtype=np.int32) // 4
    part = gs.Model(mesh, [STEEL, gs.Isotropic(1e9, 0.3)], model.fixed, material_of_cell=of_cell)
    with pytest.raises(InputError, match=r"materials\[1\] has no density"):
        gs.modes(part)
    for wrong, text in (
        ({"count": 0}, "at least 1"),
        ({"count": 97}, "at most 96"),
        ({"count": np.nan}, "whole number"),
        ({"band": (3.0, 1.0)}, "0 <= low < high"),
        ({"band": (0.0, np.nan)}, "0 <= low < high"),
        ({"mass": "diagonal"}, "'exact'"),
        ({"tolerance": 0.0}, r"a number in \(0, 1\)"),
        ({"progress": 3}, "a function"),
    ):
        with pytest.raises(InputError, match=text):
            gs.modes(model, **wrong)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="one of another model; expected a Solution of this"):
        gs.modes(model, prestress=gs.fem.solve(held(mesh)))
    with pytest.raises(InputError, match="got 3; expected a Solution of this model"):
        gs.modes(model, prestress=3)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="got NoneType; expected a Model"):
        gs.modes(None)  # type: ignore[arg-type]
    row = held(gs.mesh.quadratic(mesh, serendipity=True))
    with pytest.raises(NotConverged, match="'reduced'"):
        gs.modes(row, 4, formulation="reduced")


def test_a_material_that_no_cell_has_doesnt_count() -> None:
    mesh = gs.mesh.box((1, 0.2, 0.3), (6, 2, 3))
    alone, beside = gs.Model(mesh, STEEL), gs.Model(mesh, [STEEL, gs.Isotropic(1e-3, 0.3)])
    assert np.array_equal(gs.modes(beside, 8).frequencies, gs.modes(alone, 8).frequencies)


def test_a_prestress_that_hasnt_converged_is_none() -> None:
    mesh = gs.mesh.box((1, 0.1, 0.1), (8, 1, 1))
    end = gs.mesh.select_faces(mesh, name="x_max")
    pushed = replace(held(mesh), forces=gs.fem.traction(mesh, end, (-1e8, 0, 0)))
    poor = replace(gs.fem.solve(pushed), converged=False, message="no luck")
    with pytest.raises(NotConverged, match=r"prestress: the solution; got no luck"):
        gs.modes(pushed, 2, prestress=poor)


def test_factors_take_over_where_cycles_fail(monkeypatch: pytest.MonkeyPatch) -> None:
    """Here they aren't given the time."""
    model = held(gs.mesh.box((1, 1, 0.1), (8, 8, 1)))
    monkeypatch.setattr(solve_plan, "_cheaper", lambda *_: (("multigrid", "direct"), "as asked"))
    monkeypatch.setattr(iteration, "_STEPS", 1)
    monkeypatch.setattr(iteration, "_STEPS_OF_EACH", 1)
    found = gs.modes(model, 4)
    assert found.method == "direct"
    agree(found, model)


def test_motions_without_mass_are_told() -> None:
    """The three free nodes have the same shares at both points of the rule."""
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [0, 1, 1.0]])
    mesh = gs.Mesh(points, {"wedge6": np.arange(6)[None]})
    model = gs.Model(mesh, STEEL, np.repeat(points[:, 2:] == 0.0, 3, axis=1))
    assert len(gs.modes(model, 3, mass="calculix", formulation="exact").frequencies) == 3
    with pytest.raises(InputError, match="at most 3 that have mass"):
        gs.modes(model, 9, mass="calculix", formulation="exact")


def test_memory_is_asked_for_before_work(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(procedure, "host_memory", lambda: 100_000)
    with pytest.raises(InputError, match="50% of the free memory"):
        gs.modes(held(gs.mesh.box((1, 0.1, 0.1), (8, 1, 1))), 10)


def test_progress_tells_steps_and_errors() -> None:
    told: list[tuple[int, float]] = []
    model = held(gs.mesh.box((1, 0.1, 0.1), (8, 1, 1)))
    found = gs.modes(model, 4, progress=lambda *one: told.append(one))
    assert [step for step, _ in told] == list(range(1, found.steps))
    assert told[-1][1] <= 1e-4
