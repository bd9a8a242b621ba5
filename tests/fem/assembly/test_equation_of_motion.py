"""Products, forces and shifted solvers of the equation of motion, against dense matrices."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt
import pytest

import gpusim as gs
from gpusim.errors import InputError
from gpusim.fem.assembly import node_graph
from gpusim.fem.assembly.equation_of_motion import EquationOfMotion
from gpusim.fem.krylov.truncated_cg import truncated_cg
from gpusim.fem.linear.shifted_solver import ShiftedSolver
from gpusim.fem.linear.solve_plan import Clock, Options
from gpusim.fem.model.mass import mass_matrix
from gpusim.fem.model.model import resolve_formulation
from tests.support.element_meshes import linear_mesh
from tests.support.fem_reference import stiffness

Float = npt.NDArray[np.float64]
STEEL = gs.Isotropic(50.0, 0.3, density=2.0)


def brick() -> gs.Mesh:
    return gs.mesh.box(size=(2.0, 1.0, 1.0), divisions=(4, 2, 2))


def shuffled() -> gs.Mesh:
    """Numbered so badly that nodes are numbered anew inside."""
    mesh = gs.mesh.quadratic(linear_mesh("tet4", (5, 4, 4), 0.03))
    order = np.random.default_rng(1).permutation(mesh.node_count)
    place = np.argsort(order)
    return gs.Mesh(mesh.points[order], {"tet10": place[mesh.cells["tet10"]]})


MESHES: dict[str, Callable[[], gs.Mesh]] = {
    "lattice": brick,
    "shaken": lambda: linear_mesh("hex8", (5, 4, 3), 0.03),
    "tet10": lambda: gs.mesh.quadratic(linear_mesh("tet4", (3, 2, 2))),
}


def clamped(mesh: gs.Mesh, **more: object) -> gs.Model:
    x = mesh.points[:, 0]
    fixed = np.repeat((x < x.min() + 1e-9)[:, None], 3, axis=1)
    return gs.Model(mesh, STEEL, fixed, **more)  # type: ignore[arg-type]


def equation_of(model: gs.Model, rule: str = "exact") -> EquationOfMotion:
    return EquationOfMotion.of(model, resolve_formulation(model, None), rule)


@pytest.mark.parametrize("name", MESHES)
def test_products_are_those_of_the_matrices(name: str) -> None:
    model = clamped(MESHES[name]())
    equation = equation_of(model)
    free = ~model.fixed.ravel()  # type: ignore[union-attr]
    x = np.where(free, np.random.default_rng(0).normal(size=(2, free.size)), 0.0)
    for product, matrix in (
        (equation.stiffness, stiffness(model)),
        (equation.stiffness_by_deformation, stiffness(model)),
        (equation.inertia, mass_matrix(model)),
    ):
        expected = np.where(free, (matrix @ x.T).T / equation.scale, 0.0)
        assert np.abs(product(x) - expected).max() <= 1e-12 * np.abs(expected).max()
    assert (equation.unknowns(equation.displacements(x)) == x).all()


def test_vectors_are_in_the_models_own_numbers(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(node_graph, "_FEW", 100)
    model = clamped(shuffled())
    equation = equation_of(model)
    assert equation._numbering is not None
    force = gs.fem.body_force(model.mesh, model.densities, (1.0, 2.0, 3.0))
    x = equation.unknowns(model.mesh.points[None])
    u = equation.displacements(x)
    held = np.where(model.fixed, 0.0, model.mesh.points)
    assert (u[0] == held).all()
    work = float(np.vdot(equation.forces(force[None]), x)) * equation.scale
    assert abs(work - float(np.vdot(force, held))) <= 1e-12 * abs(work)
    whole = u.reshape(-1) @ mass_matrix(model) @ u.reshape(-1)
    assert abs(np.vdot(x, equation.inertia(x)) * equation.scale - whole) <= 1e-12 * whole


@pytest.mark.parametrize("tied", [False, True])
def test_products_are_those_of_matrices(tied: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of any two vectors, in which what is tied moves with what it is tied to."""
    monkeypatch.setattr(node_graph, "_FEW", 100)
    mesh = brick() if tied else shuffled()
    tie = gs.fem.equations(mesh, [([(4, "x", 1.0), (14, "x", -0.5)], 0.0)])
    model = clamped(mesh, constraints=[tie] if tied else [])
    equation = equation_of(model)
    random = np.random.default_rng(0).normal(size=(6, equation.unknown.size))
    x = np.where(equation.unknown, random, 0.0)
    moved = equation.displacements(x)
    assert not tied or (moved[:, 4, 0] == 0.5 * moved[:, 14, 0]).all()
    u = moved.reshape(6, -1)
    for product, matrix in (
        (equation.stiffness, stiffness(model)),
        (equation.inertia, mass_matrix(model)),
    ):
        whole = u @ (matrix @ u.T)
        found = x @ product(x).T * equation.scale
        assert np.abs(found - whole).max() <= 1e-12 * np.abs(whole).max()


@pytest.mark.parametrize("name", MESHES)
@pytest.mark.parametrize("method", ["direct", "multigrid"])
def test_shifted_solvers(name: str, method: str) -> None:
    model = clamped(MESHES[name]())
    equation = equation_of(model)
    formulation = resolve_formulation(model, None)
    options = Options(method, None, "numpy", 1e-8, None, None, None, formulation, Clock())
    solver = ShiftedSolver(equation, 40.0, options)
    assert solver.exact == (method == "direct")
    x = np.where(
        equation.unknown, np.random.default_rng(0).normal(size=(2, equation.unknown.size)), 0.0
    )

    def product(v: Float) -> Float:
        return equation.stiffness(v) + 40.0 * equation.inertia(v)

    if solver.exact:
        found = solver.apply(product(x))
    else:
        solved = truncated_cg(product, solver.preconditioner, product(x), 1e-10)
        assert solved is not None and solved[1] <= 40
        found = solved[0]
    assert np.abs(found - x).max() <= 1e-8 * np.abs(x).max()


def test_at_an_equilibrium_stress_stiffens() -> None:
    mesh = gs.mesh.box(size=(10.0, 1.0, 1.0), divisions=(10, 1, 1))
    pull = gs.fem.traction(mesh, gs.mesh.select_faces(mesh, name="x_max"), (0.5, 0.0, 0.0))
    model = clamped(mesh, forces=pull)
    solution = gs.fem.solve(model, geometry="nonlinear")
    formulation = resolve_formulation(model, None)
    at_rest = EquationOfMotion.of(model, formulation, "exact")
    pulled = EquationOfMotion.at(solution, formulation, "exact")
    bent = np.zeros((1, *mesh.points.shape))
    bent[0, :, 2] = (mesh.points[:, 0] / 10.0) ** 2
    bent[0, :, 0] = -(mesh.points[:, 2] - 0.5) * 2.0 * mesh.points[:, 0] / 100.0
    x = at_rest.unknowns(bent)
    more = np.vdot(x, pulled.stiffness(x)) * pulled.scale
    more -= np.vdot(x, at_rest.stiffness(x)) * at_rest.scale
    # N times the integral of the slope's square
    assert abs(more / (0.5 * 4.0 / 30.0) - 1.0) <= 0.05


def test_materials_without_density_are_refused() -> None:
    model = gs.Model(brick(), gs.Isotropic(1.0, 0.3))
    with pytest.raises(InputError, match="has no density"):
        equation_of(model)
