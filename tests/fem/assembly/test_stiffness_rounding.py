"""Forces by deformation: what turned elements' rounded matrices don't reach."""

from __future__ import annotations

import itertools
from fractions import Fraction
from functools import cache

import numpy as np
import numpy.typing as npt
import pytest

from benchmarks.solver.element_matrices import element_matrices
from benchmarks.solver.reference import reference_solution
from benchmarks.stability.hard_bodies import STEEL, bar, contrast
from gpusim.arrays.error_free_sums import high_half, two_sum
from gpusim.fem import Isotropic, Model, solve
from gpusim.fem.assembly.assembly import assemble
from gpusim.fem.assembly.element_batches import DistinctGroup, Group
from gpusim.fem.assembly.stiffness_rounding import Deformation, condition, deformation
from gpusim.fem.assembly.system import System
from gpusim.fem.elements.element_matrix import element_stiffness
from gpusim.fem.model.model import resolve_formulation
from gpusim.fem.sparse.stiffness_product import apply_stiffness
from gpusim.gpu import Device
from gpusim.mesh import Mesh, box, quadratic

Float = npt.NDArray[np.float64]

EPS = np.finfo(np.float64).eps


def parts(mesh: Mesh, material: npt.NDArray[np.int32] | None = None) -> tuple[Model, Deformation]:
    materials = [STEEL, Isotropic(3e9, 0.4)]
    none = np.zeros(mesh.points.shape, dtype=bool)
    model = Model(mesh, materials, none, material_of_cell=material)
    groups = assemble(model, resolve_formulation(model, None)).groups
    return model, Deformation(groups, mesh.points)


def moved(mesh: Mesh) -> Mesh:
    return mesh.moved(0.03 * np.random.default_rng(3).normal(size=mesh.points.shape))


def tets(mesh: Mesh) -> Mesh:
    """Five tetrahedra to a brick."""
    corners = [[0, 1, 3, 4], [1, 2, 3, 6], [1, 4, 5, 6], [3, 4, 6, 7], [1, 3, 4, 6]]
    return Mesh(mesh.points, {"tet4": mesh.cells["hex8"][:, corners].reshape(-1, 4)})


def mixed() -> Mesh:
    """Bricks, one of them cut into two wedges."""
    mesh = box((3.0, 1.0, 1.0), (3, 1, 1))
    bricks = mesh.cells["hex8"]
    wedges = bricks[-1][[[0, 1, 3, 4, 5, 7], [1, 2, 3, 5, 6, 7]]]
    return Mesh(mesh.points, {"hex8": bricks[:-1], "wedge6": wedges})


def test_sums_and_halves_are_exact() -> None:
    rng = np.random.default_rng(0)
    a, b = rng.normal(size=(2, 200)) * 10.0 ** rng.integers(-12, 12, size=(2, 200))
    total, lost = two_sum(a, b)
    high = high_half(a)
    for x, y, t, r, h in zip(*(v.tolist() for v in (a, b, total, lost, high)), strict=True):
        assert Fraction(x) + Fraction(y) == Fraction(t) + Fraction(r)
        assert Fraction(h) * Fraction(x - h) == Fraction(h * (x - h))
        assert Fraction(h) * Fraction(h) == Fraction(h * h)


def test_a_rigid_motion_deforms_nothing() -> None:
    # numbers of few digits, so that the motion itself is exact
    rng = np.random.default_rng(1)
    points = np.round(rng.random((50, 8, 3)) * 2**18) / 2**18 + 1024.0
    turn = rng.integers(1, 2**9, size=(50, 1, 3)) / 2**9
    u = np.cross(turn, points - 1024.0) + 4096.0
    assert np.abs(np.cross(turn, points - 1024.0)).max() > 0.9
    assert not deformation(points, u).any()


def test_what_is_taken_off_is_a_rigid_motion() -> None:
    """In rational numbers: the distances between nodes change, to first order, as they did."""
    rng = np.random.default_rng(2)
    points = rng.random((4, 5, 3)) * [1.0, 1e-3, 1e-2] + 1e6
    u = np.cross(rng.normal(size=(4, 1, 3)), points - 1e6) + 1e-9 * rng.normal(size=points.shape)
    left = deformation(points, u)
    assert np.abs(left).max() <= 1e-7 * np.abs(u).max()
    for x, moves, strained in zip(points.tolist(), u.tolist(), left.tolist(), strict=True):
        for i in range(5):
            for j in range(i):
                arm = [Fraction(p) - Fraction(q) for p, q in zip(x[i], x[j], strict=True)]
                change, wanted = (
                    sum(
                        a * (Fraction(p) - Fraction(q))
                        for a, p, q in zip(arm, v[i], v[j], strict=True)
                    )
                    for v in (strained, moves)
                )
                size = max(map(abs, arm)) * Fraction(max(map(abs, strained[i] + strained[j])))
                assert abs(change - wanted) <= Fraction(4 * EPS) * size


def test_nodes_on_a_line_and_at_a_point_give_numbers() -> None:
    line = np.linspace(0.0, 1.0, 4)[None, :, None] * np.ones(3)
    u = np.random.default_rng(4).normal(size=line.shape)
    np.testing.assert_array_equal(deformation(line, u), u - u[:, :1])
    np.testing.assert_array_equal(deformation(np.zeros_like(line), u), u - u[:, :1])


MESHES = {
    "lattice": box((3.0, 1.0, 0.8), (6, 3, 2)),
    "moved bricks": moved(box((3.0, 1.0, 0.8), (6, 3, 2))),
    "bricks of 20 nodes": quadratic(box((3.0, 1.0, 0.8), (3, 2, 2))),
    "tetrahedra": tets(box((3.0, 1.0, 0.8), (3, 1, 1))),
    "moved quadratic tetrahedra": quadratic(tets(moved(box((3.0, 1.0, 0.8), (3, 1, 1))))),
    "mixed": mixed(),
}


@pytest.mark.parametrize("name", MESHES)
def test_products_are_those_of_the_assembled_rows(name: str) -> None:
    mesh = MESHES[name]
    material = (np.arange(mesh.cell_count) % 2).astype(np.int32)
    model, elements = parts(mesh, material)
    rows = assemble(model, resolve_formulation(model, None)).rows
    u = np.random.default_rng(5).normal(size=(2, *mesh.points.shape))
    wanted = apply_stiffness(rows, u)
    assert np.abs(elements.product(u) - wanted).max() <= 1e-13 * np.abs(wanted).max()


@pytest.mark.parametrize("name", MESHES)
def test_the_turn_of_a_body_leaves_no_forces(name: str) -> None:
    mesh = MESHES[name]
    # numbers of few digits, so that the motion itself is exact
    mesh = mesh.moved(np.round(mesh.points * 2**18) / 2**18 - mesh.points)
    model, elements = parts(mesh)
    rows = assemble(model, resolve_formulation(model, None)).rows
    turn = np.cross([0.3125, -0.71875, 0.625], mesh.points)[None]
    assert not elements.product(turn).any()
    assert apply_stiffness(rows, turn).any()


def test_what_rounding_can_do_covers_what_it_does() -> None:
    mesh = moved(box((3.0, 1.0, 0.8), (6, 3, 2)))
    model, elements = parts(mesh)
    (group,) = assemble(model, resolve_formulation(model, None)).groups
    assert isinstance(group, DistinctGroup)
    matrices = group.at(np.arange(len(group.cells)))
    rng = np.random.default_rng(7)
    noise = 1.0 + EPS * rng.choice([-1.0, 1.0], size=matrices.shape)
    kind = np.arange(len(matrices))
    exact, off = (
        Deformation([Group("hex8", group.cells, kind, one)], mesh.points)
        for one in (matrices, matrices * noise)
    )
    u = np.cross([1.0, 2.0, -1.0], mesh.points)[None] + 1e-6 * rng.normal(
        size=(1, *mesh.points.shape)
    )
    change = np.abs(exact.product(u) - off.product(u))
    assert (change <= elements.rounding(u)).all()
    assert change.max() >= 0.01 * elements.rounding(u).max()


@pytest.mark.parametrize(
    "model",
    [
        pytest.param(bar((1000.0, 1.0, 0.7), (100, 1, 1)), id="a slenderness of 1000"),
        pytest.param(bar((4.0, 0.004, 0.003), (4, 4, 3)), id="needles"),
        pytest.param(bar((1.0, 1.0, 0.001), (6, 5, 2)), id="flat cells"),
        pytest.param(contrast(1e8, "soft root"), id="a soft root"),
    ],
)
def test_what_float64_could_only_tell_is_right(
    model: Model, monkeypatch: pytest.MonkeyPatch
) -> None:
    wanted = reference_solution(model, {"hex8": "incompatible"}).u
    solution = solve(model, method="direct", backend="numpy")
    assert solution.converged and solution.error_estimate <= 1e-6
    size = np.abs(wanted).max(axis=(1, 2))
    assert (np.abs(solution.u - wanted).max(axis=(1, 2)) <= 1e-7 * size).all()
    monkeypatch.setattr(System, "by_deformation", lambda self: self)
    assert not solve(model, method="direct", backend="numpy").converged


@cache
def soft_root_reference() -> Float:
    return reference_solution(contrast(1e8, "soft root"), {"hex8": "incompatible"}).u


@pytest.mark.parametrize("backend", ["numpy", "gpu"])
def test_conjugate_gradients_go_on_by_deformation(
    backend: str, device: Device, monkeypatch: pytest.MonkeyPatch
) -> None:
    model = contrast(1e8, "soft root")
    wanted = soft_root_reference()
    own = device if backend == "gpu" else None
    solution = solve(model, own, method="multigrid", backend=backend, tolerance=1e-7)
    assert solution.converged and solution.error_estimate <= 1e-7
    size = np.abs(wanted).max(axis=(1, 2))
    assert (np.abs(solution.u - wanted).max(axis=(1, 2)) <= 1e-7 * size).all()
    monkeypatch.setattr(System, "by_deformation", lambda self: self)
    assert not solve(model, own, method="multigrid", backend=backend, tolerance=1e-7).converged


def test_a_turned_support_carries_what_acts(monkeypatch: pytest.MonkeyPatch) -> None:
    """Reactions balance the loads though the whole body was turned far beyond its strains."""
    model = bar((1000.0, 1.0, 0.7), (100, 1, 1))
    assert model.fixed is not None
    given = np.where(model.fixed, np.cross([0.0, 0.5, 0.2], model.mesh.points), 0.0)
    turned = Model(model.mesh, model.materials, model.fixed, model.forces, prescribed=given)
    wanted = reference_solution(turned, {"hex8": "incompatible"}).u

    def found() -> tuple[Float, float]:
        """Relative errors (L,) of displacements, and what reactions and loads don't balance."""
        solution = solve(turned, method="direct", backend="numpy")
        error = np.abs(solution.u - wanted).max(axis=(1, 2)) / np.abs(wanted).max(axis=(1, 2))
        total = solution.reactions.sum(axis=1) + model.load_cases.sum(axis=1)
        return error, float(np.abs(total).max())

    error, left = found()
    # loads of 1 beside 210e9 times displacements of 500, each rounded to 1e-16 of itself
    assert error.max() <= 1e-9 and left <= 1e-4
    monkeypatch.setattr(System, "by_deformation", lambda self: self)
    by_rows = found()
    assert by_rows[0].max() > 1e-8 and by_rows[1] > 100.0 * left


def test_a_support_moved_far_along_a_beam_is_right() -> None:
    """The beam's underside follows, and is free to slide: what is prescribed is far larger than
    what strains, in the same elements as what is solved for."""
    mesh = box((1000.0, 1.0, 0.7), (100, 1, 1))
    below = mesh.points[:, 2] == 0.0
    fixed = np.repeat(mesh.points[:, :1] == 0.0, 3, axis=1)
    fixed[below, 2] = True
    given = np.where(fixed, [0.0, 0.0, 1e5], 0.0)
    forces = np.zeros((1, *mesh.points.shape))
    model = Model(mesh, [Isotropic(1.0, 0.3)], fixed, forces, prescribed=given)
    wanted = reference_solution(model, {"hex8": "incompatible"}).u
    for method, tolerance in itertools.product(("direct", "multigrid"), (1e-4, 1e-6, 1e-8)):
        solution = solve(model, method=method, backend="numpy", tolerance=tolerance)
        error = np.abs(solution.u - wanted).max() / np.abs(wanted).max()
        assert error <= tolerance or not solution.converged
        assert error <= 10.0 * solution.error_estimate


CORNERS = {
    "hex8": box((1.0, 1.0, 1.0), (1, 1, 1)).points[
        box((1.0, 1.0, 1.0), (1, 1, 1)).cells["hex8"][0]
    ],
    "tet4": np.eye(4, 3, -1),
}


@pytest.mark.skipif(np.finfo(np.longdouble).eps > 1e-18, reason="no longer floats than float64")
@pytest.mark.parametrize("name", CORNERS)
@pytest.mark.parametrize("aspect", [1.0, 1e-1, 1e-3])
def test_turned_needles_are_known_to_be_rounded_more(name: str, aspect: float) -> None:
    """What their matrices are off by, against 80 bits."""
    rng = np.random.default_rng(8)
    turn, _ = np.linalg.qr(rng.normal(size=(20, 3, 3)))
    turn[:, 0] *= np.sign(np.linalg.det(turn))[:, None]
    straight = CORNERS[name] + 0.15 * rng.uniform(-1.0, 1.0, (20, *CORNERS[name].shape))
    straight = straight * [1.0, aspect, aspect]
    moduli = STEEL.stiffness()
    for points in (straight, straight @ turn):
        found = element_stiffness(name, points, moduli, "full")
        longer = points.astype(np.longdouble), moduli.astype(np.longdouble)
        exact = element_matrices(name, *longer, "full", np.dtype(np.longdouble))
        strained = rng.normal(size=(20, found.shape[1], 1))
        off = np.abs((found - exact).astype(np.float64) @ strained)[..., 0].max(axis=1)
        size = EPS * (np.abs(found) @ np.abs(strained))[..., 0].max(axis=1)
        assert (off <= 4.0 * condition(name, points) * size).all()
    assert condition(name, straight).max() < 3.0
    assert np.median(condition(name, straight @ turn)) > 0.4 / aspect


def test_soft_modes_are_seen_beside_supports_that_move_far() -> None:
    """One iteration was enough for the load to be small beside the motion: 1.8e-3 off at a stated
    3.2e-5."""
    model = bar((1000.0, 1.0, 0.7), (100, 1, 1))
    assert model.fixed is not None
    fixed, given = model.fixed.copy(), np.zeros(model.mesh.points.shape)
    fixed[:, 2], given[:, 2] = True, 1e4
    forces = np.zeros(given.shape)
    forces[model.mesh.points[:, 0] == 1000.0, 1] = 250.0
    moved = Model(model.mesh, model.materials, fixed, forces, prescribed=given)
    wanted = reference_solution(moved, {"hex8": "incompatible"}).u[0]
    solution = solve(moved, method="multigrid", backend="numpy", tolerance=1e-4)
    assert solution.converged
    assert np.abs(solution.u - wanted).max() <= 1e-4 * np.abs(wanted).max()
