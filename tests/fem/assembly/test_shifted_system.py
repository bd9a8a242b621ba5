"""K + s M: as a product, and solved by every solver."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt
import pytest

import gpusim as gs
from gpusim.fem.assembly.assembly import Assembled, assemble
from gpusim.fem.assembly.shifted_system import Shift, shifted_system
from gpusim.fem.assembly.system import System, make_system
from gpusim.fem.linear.linear_solver import solve_system
from gpusim.fem.linear.solve_plan import Clock, Options, plan_solve
from gpusim.fem.model.mass import ElementMass, mass_matrix, scalar_mass
from gpusim.fem.model.model import resolve_formulation
from gpusim.fem.sparse.block_rows import block_matrix
from tests.support.element_meshes import linear_mesh

Float = npt.NDArray[np.float64]
MESHES: dict[str, Callable[[], gs.Mesh]] = {
    "lattice": lambda: gs.mesh.box(size=(2.0, 1.0, 1.0), divisions=(8, 4, 4)),
    "shaken": lambda: linear_mesh("hex8", (5, 4, 3), 0.03),
    "tet10": lambda: gs.mesh.quadratic(linear_mesh("tet4", (3, 2, 2))),
}


def model_of(mesh: gs.Mesh, moved: bool = False) -> gs.Model:
    x = mesh.points[:, 0]
    fixed = np.repeat((x < x.min() + 1e-9)[:, None], 3, axis=1)
    forces = np.random.default_rng(3).normal(size=(2, *mesh.points.shape))
    prescribed = np.where(fixed, [0.3, -0.1, 0.2], 0.0) if moved else None
    return gs.Model(
        mesh, gs.Isotropic(50.0, 0.3, density=2.0), fixed, forces, prescribed=prescribed
    )


def shifted(model: gs.Model) -> tuple[Assembled, System, Float]:
    """And the same as a dense matrix."""
    formulation = resolve_formulation(model, None)
    assembled = assemble(model, formulation)
    elements = ElementMass(model, formulation, "exact")
    shift = Shift(elements, scalar_mass(elements), 40.0)
    dense = block_matrix(assembled.rows).toarray() + 40.0 * mass_matrix(model).toarray()
    return (*shifted_system(assembled, make_system(model, assembled), shift), dense)


@pytest.mark.parametrize("name", MESHES)
def test_rows_and_product_are_those_of_the_sum(name: str) -> None:
    assembled, system, dense = shifted(model_of(MESHES[name]()))
    found = block_matrix(assembled.rows).toarray()
    assert np.abs(found - dense).max() <= 1e-13 * np.abs(dense).max()
    u = np.random.default_rng(1).normal(size=system.right.shape)
    image = (u.reshape(2, -1) @ dense).reshape(u.shape)
    for product in (system.apply(u) * system.scale, system.elements.product(u)):
        assert np.abs(product - image).max() <= 1e-12 * np.abs(image).max()
    # a motion without strain isn't without force any more
    assert np.abs(system.apply(np.ones_like(u))).max() > 1e-3 * np.abs(system.apply(u)).max()


@pytest.mark.parametrize("name", MESHES)
@pytest.mark.parametrize("method", ["direct", "multigrid"])
@pytest.mark.parametrize("moved", [False, True])
def test_every_solver_takes_it(name: str, method: str, moved: bool) -> None:
    model = model_of(MESHES[name](), moved)
    assembled, system, dense = shifted(model)
    formulation = resolve_formulation(model, None)
    options = Options(method, None, "numpy", 1e-8, None, None, None, formulation, Clock())
    plan = plan_solve(model, assembled, system, options)
    outcome = solve_system(plan, model, assembled, system, options)
    free = system.free.ravel()
    given = np.where(system.free, 0.0, model.prescribed_cases[0]).ravel()
    right = model.load_cases.reshape(2, -1) - dense @ given
    exact = np.tile(given, (2, 1))
    exact[:, free] = np.linalg.solve(dense[np.ix_(free, free)], right[:, free].T).T
    difference = np.abs(outcome.u.reshape(2, -1) - exact).max()
    assert outcome.converged and difference <= 1e-7 * np.abs(exact).max()
