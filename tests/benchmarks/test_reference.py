"""The benchmark's own elements, assembly and elimination, against closed forms and the solver."""

from __future__ import annotations

import decimal

import numpy as np
import pytest
from scipy.sparse.linalg import spsolve

from benchmarks.solver.cases import CASES
from benchmarks.solver.element_matrices import ELEMENT_KINDS, element_matrices
from benchmarks.solver.problem import free_matrix
from benchmarks.solver.reference import as_arithmetic, reference_solution
from gpusim.bench.solver_cases import find_cases
from gpusim.errors import InputError
from gpusim.fem import Isotropic, Model, face_force, solve
from gpusim.mesh import box, select_faces

LONG = np.dtype(np.longdouble)


@pytest.mark.parametrize(
    ("kind", "rule"), [(kind, rule) for kind, k in ELEMENT_KINDS.items() for rule in k.rules]
)
def test_rigid_motions_cost_nothing_and_stretching_costs_its_energy(kind: str, rule: str) -> None:
    rng = np.random.default_rng(2)
    corners = np.array(ELEMENT_KINDS[kind].nodes, dtype=np.float64)
    # an affine image: straight edges, where every rule integrates a constant strain exactly
    shape = np.eye(3) + 0.3 * rng.uniform(-1, 1, (3, 3))
    nodes = corners @ shape.T
    steel = Isotropic(2.0, 0.3).stiffness()
    matrix = element_matrices(kind, nodes[None], steel, rule, np.dtype(np.float64))[0]
    spin = np.array([[0.0, -0.4, 0.1], [0.4, 0.0, 0.3], [-0.1, -0.3, 0.0]])
    for motion in (np.ones_like(nodes) * [0.2, -0.5, 0.7], nodes @ spin.T):
        assert np.abs(matrix @ motion.ravel()).max() <= 1e-13
    strain = np.array([0.3, -0.1, 0.2, 0.4, 0.5, -0.2])  # xx yy zz xy yz zx
    e = strain
    gradient = np.array(
        [[e[0], e[3] / 2, e[5] / 2], [e[3] / 2, e[1], e[4] / 2], [e[5] / 2, e[4] / 2, e[2]]]
    )
    u = (nodes @ gradient.T).ravel()
    volume = np.linalg.det(shape) * (8.0 if kind.startswith("hex") else 1.0 / 6.0)
    assert u @ matrix @ u == pytest.approx(volume * strain @ steel @ strain, rel=1e-12)


def test_fifty_digits_and_eighty_bits_agree() -> None:
    nodes = np.array(ELEMENT_KINDS["hex8"].nodes) + 0.1 * np.random.default_rng(5).random((1, 8, 3))
    steel = Isotropic(2.0, 0.3).stiffness()
    long = element_matrices("hex8", nodes.astype(LONG), steel.astype(LONG), "incompatible", LONG)
    exact = np.dtype(object)
    with decimal.localcontext(prec=50):
        digits = element_matrices(
            "hex8", as_arithmetic(nodes, exact), as_arithmetic(steel, exact), "incompatible", exact
        )
    # by way of text: numpy turns a Decimal into 53 bits only
    rounded = np.array([np.longdouble(str(d)) for d in digits.ravel()]).reshape(long.shape)
    assert np.abs(long - rounded).max() <= 1e-17


@pytest.mark.parametrize("rule", ["incompatible", "full", "bbar"])
def test_reference_and_solver_agree_on_a_distorted_block(rule: str) -> None:
    mesh = box((1.5, 1.0, 0.8), (5, 3, 3))
    mesh = mesh.moved(
        0.03 * np.random.default_rng(4).uniform(-1, 1, mesh.points.shape)
        * (mesh.points[:, :1] > 0.0) * (mesh.points[:, :1] < 1.5)
    )  # fmt: skip
    fixed = np.repeat(mesh.points[:, :1] == 0.0, 3, axis=1)
    prescribed = np.where(fixed, 1e-3 * mesh.points, 0.0)
    end = select_faces(mesh, name="x_max")
    forces = np.stack([face_force(mesh, end, f) for f in ((0.0, 0.1, -1.0), (1.0, 0.2, 0.0))])
    model = Model(mesh, [Isotropic(30.0, 0.3)], fixed=fixed, forces=forces, prescribed=prescribed)
    reference = reference_solution(model, {"hex8": rule})
    assert reference.error <= 1e-15
    u = solve(model, backend="numpy", tolerance=1e-11, formulation=rule).u
    assert np.abs(u - reference.u).max() <= 1e-10 * np.abs(u).max()


def test_long_bars_take_more_digits_and_follow_the_beam_formula() -> None:
    mesh = box((1000.0, 1.0, 1.0), (20, 1, 1))
    fixed = np.repeat(mesh.points[:, :1] == 0.0, 3, axis=1)
    end = select_faces(mesh, name="x_max")
    model = Model(
        mesh, [Isotropic(12.0, 0.0)], fixed=fixed, forces=face_force(mesh, end, (0, 0, 1.0))
    )
    reference = reference_solution(model, {"hex8": "incompatible"}, wanted=1e-16)
    assert reference.arithmetic == "50 digits" and reference.error <= 1e-25
    # F L^3 / (3 E I), E I = 1, less what 20 elements of linear curvature leave out
    assert reference.u[0, :, 2].max() == pytest.approx(1000.0**3 / 3.0, rel=1e-3)


def test_a_free_body_has_no_reference() -> None:
    mesh = box((1.0, 1.0, 1.0), (1, 1, 1))
    fixed = np.zeros(mesh.points.shape, dtype=bool)
    fixed[0] = True
    model = Model(mesh, [Isotropic(1.0, 0.3)], fixed=fixed, forces=np.ones(mesh.points.shape))
    with pytest.raises(InputError, match="singular"):
        reference_solution(model, {"hex8": "full"})


@pytest.mark.parametrize("name", ["beam-10k", "cube-nu4999-10k"])
def test_the_matrix_that_peers_get_gives_the_solvers_answer(name: str) -> None:
    (case,) = find_cases("small", name, CASES)
    model = case.model()
    free = ~model.fixed.all(axis=1)
    u = np.zeros(model.mesh.points.shape)
    matrix = free_matrix(case, model).tocsc()
    assert abs(matrix - matrix.T).max() <= 1e-12 * abs(matrix).max()
    if name.startswith("beam"):
        u[free] = spsolve(matrix, model.load_cases[0][free].ravel()).reshape(-1, 3)
        own = solve(model, backend="numpy", formulation=case.rule).u[0]
        assert np.abs(u - own).max() <= 1e-5 * np.abs(u).max()


def test_cases_are_found_by_name_family_and_size() -> None:
    assert [case.name for case in find_cases("full", "beam")] == [
        "beam-10k", "beam-100k", "beam-300k", "beam-1M",
    ]  # fmt: skip
    assert len(find_cases("full", None, CASES)) == len(CASES) > len(find_cases("small"))
    assert [case.name for case in find_cases("small", "cube-3M")] == ["cube-3M"]
    with pytest.raises(InputError, match="expected one of beam, cube"):
        find_cases("small", "sphere")
