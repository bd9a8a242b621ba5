"""What every element owes, whatever its type, formulation and kinematics."""

from __future__ import annotations

import numpy as np
import pytest

from gpusim.errors import InputError, NotConverged
from gpusim.fem.elements.element_matrix import element_stiffness
from gpusim.fem.elements.element_response import ElementBlock, Want
from gpusim.mesh import Mesh
from gpusim.parallel.threads import shared
from tests.support.element_meshes import SIZE, mesh_of
from tests.support.element_responses import (
    FORMS,
    HEXAHEDRA,
    NU,
    ROTATION,
    Body,
    E,
    Float,
    Flowing,
    NeoHooke,
    SaintVenantKirchhoff,
    elements,
    motion_of,
    settle,
    single,
    tangent_errors,
)

Form = tuple[str, str, str]
ONE = np.array([0])


def one(form: Form, **given: object) -> tuple[object, Float]:
    nodes = single(form[1])
    return elements(form, nodes, np.arange(len(nodes))[None], **given), nodes  # type: ignore[arg-type]


@pytest.mark.parametrize("form", FORMS)
def test_at_rest_it_is_the_linear_element(form: Form) -> None:
    own, nodes = one(form)
    linear = element_stiffness(form[1], nodes[None], SaintVenantKirchhoff().stiffness(), form[2])
    rest = np.zeros_like(nodes)
    for want in (Want.TANGENT, Want.MATERIAL):
        forces, tangent = own.response(ONE, rest, want)
        assert np.abs(tangent - linear).max() <= 1e-13 * np.abs(linear).max()
        assert np.abs(forces).max() == 0.0
    # a motion of 1e-12 of the cell's size, far from the origin too: ten digits of the linear answer
    small = 1e-12 * motion_of(nodes, 0.3)
    expected = linear[0] @ small.ravel()
    far = elements(form, nodes + np.array([1024.0, -2048.0, 512.0]), np.arange(len(nodes))[None])
    for these in (own, far):
        found = these.response(ONE, small, Want.FORCES)[0][0]
        assert np.abs(found - expected).max() <= 1e-10 * np.abs(expected).max()


@pytest.mark.parametrize("form", FORMS)
def test_tangents_are_derivatives_of_forces_and_symmetric(form: Form) -> None:
    own, nodes = one(form)
    path = [(nodes, motion_of(nodes)), (nodes, motion_of(nodes, 0.05, seed=2))]
    # after a second step, too
    assert max(tangent_errors(form, path)) <= 1e-9
    settle(own, path[0][1])
    tangent = own.response(ONE, path[0][1], Want.TANGENT)[1][0]
    assert np.abs(tangent - tangent.T).max() <= 1e-14 * np.abs(tangent).max()


@pytest.mark.parametrize("form", [form for form in HEXAHEDRA if form[0] == "finite"])
@pytest.mark.parametrize("law", [NeoHooke(), Flowing()])
def test_tangents_of_other_laws(form: Form, law: SaintVenantKirchhoff) -> None:
    nodes = single("hex8")
    path = [(nodes, motion_of(nodes)), (nodes, motion_of(nodes, 0.05, seed=2))]
    # flow sets in with a kink: small differences, and strains beyond it
    assert max(tangent_errors(form, path, law, 1e-5)) <= 1e-8


@pytest.mark.parametrize("form", HEXAHEDRA)
def test_tangents_of_warm_cells(form: Form) -> None:
    nodes = single("hex8")
    free = np.array([0.02, -0.01, 0.03, 0.01, 0.02, -0.01])
    path = [(nodes, motion_of(nodes)), (nodes, motion_of(nodes, 0.05, seed=2))]
    assert max(tangent_errors(form, path, free=free)) <= 1e-9


@pytest.mark.parametrize("form", [form for form in HEXAHEDRA if form[0] == "finite"])
def test_a_wrong_tangent_is_seen(form: Form) -> None:
    nodes = single("hex8")
    wrong = SaintVenantKirchhoff(error=1e-6)
    assert tangent_errors(form, [(nodes, motion_of(nodes))], wrong)[0] > 1e-7


@pytest.mark.parametrize("form", FORMS)
def test_internal_forces_are_in_balance_and_turn_with_the_body(form: Form) -> None:
    own, nodes = one(form)
    u = motion_of(nodes)
    settle(own, u)
    forces = own.response(ONE, u, Want.FORCES)[0][0].reshape(-1, 3)
    size = np.abs(forces).max()
    assert size > 1.0
    assert np.abs(forces.sum(axis=0)).max() <= 1e-12 * size
    assert np.abs(np.cross(nodes + u, forces).sum(axis=0)).max() <= 1e-12 * size
    turned = (nodes + u) @ ROTATION.T + [3.0, -2.0, 7.0] - nodes
    settle(own, turned)
    again = own.response(ONE, turned, Want.FORCES)[0][0].reshape(-1, 3)
    assert np.abs(again - forces @ ROTATION.T).max() <= 1e-11 * size
    rigid = nodes @ ROTATION.T - nodes
    settle(own, rigid)
    assert np.abs(own.response(ONE, rigid, Want.FORCES)[0]).max() <= 1e-12 * E


def seven_cells() -> Mesh:
    """A skew hexahedron in the middle of a box, and one on each of its faces."""
    corners = np.array([[x, y, z] for z in (0, 1) for y in (0, 1) for x in (0, 1)], float)
    corners = corners[[0, 1, 3, 2, 4, 5, 7, 6]]
    shift = 0.08 * np.random.default_rng(2).uniform(-1.0, 1.0, (8, 3))
    points = np.concatenate([corners * SIZE, (0.3 + 0.4 * corners + shift) * SIZE])
    faces = [[0, 3, 2, 1], [4, 5, 6, 7], [0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]]
    cells = [[8, 9, 10, 11, 12, 13, 14, 15]]
    cells += [[*[8 + node for node in face], *face] for face in faces]
    return Mesh(points, {"hex8": np.array(cells)})


@pytest.mark.parametrize("form", [*FORMS, *[(*form, "seven") for form in HEXAHEDRA]])
def test_homogeneous_deformation_is_exact_on_distorted_cells(form: tuple[str, ...]) -> None:
    kinematics, kind, name, *seven = form
    mesh = seven_cells() if seven else mesh_of(kind, (3, 2, 2), amount=0.06)
    slope = np.array([[0.08, 0.1, -0.03], [0.02, -0.06, 0.04], [0.0, 0.07, 0.05]])
    gradient = ROTATION @ (np.eye(3) + slope)
    surface = ((mesh.points < 1e-9) | (mesh.points > np.array(SIZE) - 1e-9)).any(axis=1)
    free = np.repeat(~surface[:, None], 3, axis=1)
    exact = mesh.points @ (gradient - np.eye(3)).T
    body = Body(mesh, elements((kinematics, kind, name), mesh.points, mesh.cells[kind]), free)
    # the inner nodes stand aside first
    start = exact + 0.01 * free * np.random.default_rng(6).uniform(-1.0, 1.0, exact.shape)
    u, _ = body.newton(np.zeros_like(exact), start)
    assert free.any() and np.abs(start - exact).max() > 5e-3
    assert np.abs(u - exact).max() <= 1e-9


@pytest.mark.parametrize(
    ("form", "law"),
    [
        *[(form, SaintVenantKirchhoff()) for form in FORMS],
        *[(form, law) for form in HEXAHEDRA[1::2] for law in (NeoHooke(), Flowing())],
    ],
)
def test_newton_converges_quadratically(form: Form, law: SaintVenantKirchhoff) -> None:
    # reduced integration has motions that meet no stress: cells side by side hold them, if pulled
    reduced = form[2] == "reduced"
    mesh = mesh_of(form[1], (2, 2, 2) if reduced else (2, 1, 1), amount=0.05, bulge=0.02)
    free = np.repeat(mesh.points[:, :1] > 1e-9, 3, axis=1)
    body = Body(mesh, elements(form, mesh.points, mesh.cells[form[1]], law), free)
    load = np.zeros_like(mesh.points)
    end = mesh.points[:, 0] > SIZE[0] - 1e-9
    pull = [25.0, 3.0, -5.0] if reduced else [2.0, 5.0, -25.0]
    # plastic flow sets in early
    load[end] = (0.3 if isinstance(law, Flowing) else 1.0) * np.array(pull) / end.sum()
    u, steps = body.newton(load, np.zeros_like(load))
    assert np.abs(u).max() > 0.008
    # the last steps above the rounding: each about a constant times the square of that before
    tail = [step for step in steps if step > 1e-12]
    order = np.log(tail[-1] / tail[-2]) / np.log(tail[-2] / tail[-3])
    assert 1.7 <= order <= 2.8, steps


@pytest.mark.parametrize("form", HEXAHEDRA)
def test_foretold_stress_is_that_of_the_linear_part_of_the_step(form: Form) -> None:
    own, nodes = one(form)
    u = motion_of(nodes)
    direction = motion_of(nodes, 0.2, seed=4) - motion_of(nodes, 0.0)
    settle(own, u)
    start = own.snapshot()

    def tangents(size: float) -> tuple[Float, Float]:
        own.restore(start)
        own.response(ONE, u, Want.TANGENT)
        own.advance(ONE, u, size * direction, True)
        foretold = own.response(ONE, u + size * direction, Want.TANGENT)[1]
        own.forget_foretold()
        return foretold, own.response(ONE, u + size * direction, Want.TANGENT)[1]

    gaps = []
    for size in (0.0, 1e-3, 5e-4):
        foretold, actual = tangents(size)
        gaps.append(np.abs(foretold - actual).max() / np.abs(actual).max())
    # nothing where nothing moves; of second order else, and not nothing
    assert gaps[0] <= 1e-13 and gaps[1] >= 1e-9
    assert gaps[1] / gaps[2] == pytest.approx(4.0, rel=0.05)


@pytest.mark.parametrize("form", HEXAHEDRA)
def test_chunks_on_threads_and_restored_states_answer_the_same(form: Form) -> None:
    mesh = mesh_of("hex8", (5, 4, 3), amount=0.05)
    u = 0.02 * np.random.default_rng(3).uniform(-1.0, 1.0, mesh.points.shape)
    step = 0.3 * u[::-1]
    parts = np.array_split(np.random.default_rng(1).permutation(60), 7)
    whole = elements(form, mesh.points, mesh.cells["hex8"])
    own = elements(form, mesh.points, mesh.cells["hex8"])

    def moved(which: object) -> None:
        own.response(which, u, Want.TANGENT)
        own.advance(which, u, step, True)

    everything = np.arange(60)
    before = own.snapshot()
    first = own.response(everything, u, Want.TANGENT)
    shared(moved, parts)
    whole.response(everything, u, Want.TANGENT)
    whole.advance(everything, u, step, True)
    expected = whole.response(everything, u + step, Want.TANGENT)
    found = shared(lambda which: own.response(which, u + step, Want.TANGENT), parts)
    for which, (forces, tangent) in zip(parts, found, strict=True):
        np.testing.assert_allclose(forces, expected[0][which], rtol=0, atol=1e-12 * E)
        np.testing.assert_allclose(tangent, expected[1][which], rtol=0, atol=1e-12 * E)
    own.restore(before)
    again = own.response(everything, u, Want.TANGENT)
    np.testing.assert_array_equal(again[0], first[0])
    np.testing.assert_array_equal(again[1], first[1])
    assert np.abs(expected[1] - first[1]).max() > 1e-3 * E


@pytest.mark.parametrize("form", HEXAHEDRA)
def test_the_material_part_is_definite_where_the_tangent_is_not(form: Form) -> None:
    own, nodes = one(form)
    pressed = -0.25 * nodes * [1.0, 0.0, 0.0]
    _, tangent = own.response(ONE, pressed, Want.TANGENT)
    _, material = own.response(ONE, pressed, Want.MATERIAL)
    assert np.linalg.eigvalsh(tangent[0])[0] < -1e-3 * E
    assert np.linalg.eigvalsh(material[0])[0] > -1e-12 * E


@pytest.mark.parametrize("form", FORMS)
def test_cells_turned_inside_out_are_counted(form: Form) -> None:
    mesh = mesh_of(form[1], (2, 1, 1), amount=0.02)
    own = elements(form, mesh.points, mesh.cells[form[1]])
    u = -2.0 * mesh.points * [0.0, 0.0, 1.0]
    count = len(own.cells)
    with np.errstate(all="raise"), pytest.raises(NotConverged, match=f"{count} cells are turned"):
        own.response(np.arange(count), u, Want.TANGENT)
    u[0, 0] = np.nan
    with pytest.raises(NotConverged, match="inside out"):
        own.response(np.arange(count), u, Want.FORCES)


def test_cells_inverted_at_rest_are_refused() -> None:
    nodes = single("hex8") * [1.0, 1.0, -1.0]
    with pytest.raises(InputError, match="1 elements are inverted at a quadrature point"):
        ElementBlock("hex8", "full", nodes, np.arange(8)[None].astype(np.int32), NeoHooke(NU))
