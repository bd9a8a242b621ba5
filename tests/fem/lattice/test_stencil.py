"""Products by stencil against the assembled matrix: any numbering, holes, several materials."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest

from gpusim import fem
from gpusim.fem.assembly.assembly import Assembled, assemble
from gpusim.fem.lattice.lattice_runs import RowSums
from gpusim.fem.lattice.stencil import StencilProduct, stencil_of
from gpusim.fem.model.model import resolve_formulation
from gpusim.fem.sparse.block_rows import block_matrix
from gpusim.fem.sparse.stiffness_product import apply_stiffness
from gpusim.mesh import Mesh, box

SOFT, HARD = fem.Isotropic(1.0, 0.3), fem.Isotropic(3.0, 0.2)


def assembled(mesh: Mesh, material_of_cell: np.ndarray | None = None) -> Assembled:
    model = fem.Model(
        mesh,
        [SOFT, HARD],
        material_of_cell=material_of_cell,
        fixed=np.zeros(mesh.points.shape, dtype=bool),
    )
    return assemble(model, resolve_formulation(model, None))


def shuffled(mesh: Mesh) -> Mesh:
    """The same body with its nodes numbered at random."""
    number = np.random.default_rng(2).permutation(mesh.node_count)
    points = np.empty_like(mesh.points)
    points[number] = mesh.points
    return Mesh(points, {"hex8": number[mesh.cells["hex8"]]})


def holed(mesh: Mesh) -> Mesh:
    """Without the cells in a corner and in a tunnel; no node is left over."""
    centre = mesh.points[mesh.cells["hex8"]].mean(axis=1)
    gone = (centre > 0.7).all(axis=1) | (np.abs(centre[:, :2] - 0.4) < 0.1).all(axis=1)
    cells = mesh.cells["hex8"][~gone]
    used, number = np.unique(cells, return_inverse=True)
    return Mesh(mesh.points[used], {"hex8": number.reshape(cells.shape)})


PLAIN = box((1.0, 1.1, 1.2), (17, 19, 23))


MESHES = {
    "box": PLAIN,
    "any": shuffled(PLAIN),
    "holes": holed(box((1.0, 1.1, 1.2), (70, 19, 23))),
}


@pytest.mark.parametrize("mesh", MESHES.values(), ids=MESHES.keys())
def test_the_product_is_that_of_the_assembled_matrix(mesh: Mesh) -> None:
    parts = assembled(mesh)
    assert parts.lattice is not None
    stencil = stencil_of(parts.rows, parts.lattice, 2.0)
    product = StencilProduct.of(stencil)
    assert product is not None
    matrix = block_matrix(parts.rows, 2.0)
    x = np.random.default_rng(1).normal(size=(2, product.unknowns))
    wanted = np.stack([matrix @ one for one in x])
    for _ in range(2):  # the work space is left as it was found
        assert np.abs(product(x) - wanted).max() <= 1e-14 * np.abs(wanted).max() * 27
    assert abs(stencil.matrix - matrix).max() <= 1e-15 * abs(matrix).max()


def test_layers_of_two_materials() -> None:
    mesh = box((1.0, 1.1, 1.2), (21, 17, 24))
    layer = mesh.points[mesh.cells["hex8"]].mean(axis=1)[:, 2] > 0.5
    parts = assembled(mesh, layer.astype(np.int32))
    assert parts.lattice is not None
    product = StencilProduct.of(stencil_of(parts.rows, parts.lattice, 1.0))
    assert product is not None
    x = np.random.default_rng(1).normal(size=(1, product.unknowns))
    wanted = block_matrix(parts.rows) @ x[0]
    assert np.abs(product(x)[0] - wanted).max() <= 1e-13 * np.abs(wanted).max()


def test_rows_that_hardly_repeat_are_left_to_the_matrix() -> None:
    mesh = box((1.0, 1.1, 1.2), (17, 19, 23))
    mixed = np.random.default_rng(3).integers(0, 2, mesh.cell_count).astype(np.int32)
    parts = assembled(mesh, mixed)
    assert parts.lattice is not None
    assert StencilProduct.of(stencil_of(parts.rows, parts.lattice, 1.0)) is None
    model = fem.Model(
        mesh,
        [SOFT, HARD],
        material_of_cell=mixed,
        fixed=np.repeat(mesh.points[:, :1] == 0.0, 3, axis=1),
        forces=np.where(mesh.points[:, :1] == 1.0, [0.0, 0.0, 1.0], 0.0),
    )
    direct = fem.solve(model, method="direct")
    iterated = fem.solve(model, method="multigrid", backend="numpy")
    assert np.abs(iterated.u - direct.u).max() <= 1e-6 * np.abs(direct.u).max()


@pytest.mark.parametrize("shape", [lambda mesh: mesh, holed])
def test_differences_in_runs_keep_the_digits_of_bodies_that_move_as_a_whole(shape) -> None:
    mesh = shape(box((1.0, 0.3, 0.4), (21, 15, 14)))
    parts = assembled(mesh)
    product = StencilProduct.of(stencil_of(parts.rows, parts.lattice, 1.0))
    x, y, z = mesh.points.T
    strained = np.stack([1e-3 * x * x, 1e-3 * z * z, x * y], axis=1)[None]
    moved = strained + np.array([1e6, -3e6, 5e5])
    exact = apply_stiffness(parts.rows, strained)
    # what rounding the sum of both leaves of the small one
    left = float(np.abs(apply_stiffness(parts.rows, moved) - exact).max())
    assert np.abs(product.in_differences(moved) - exact).max() <= 3.0 * left
    assert np.abs(product(moved.reshape(1, -1)).reshape(moved.shape) - exact).max() > 10.0 * left


def test_differences_in_runs_arent_offered_where_nodes_are_missing() -> None:
    mesh = box((1.0, 0.8, 0.9), (21, 15, 14))
    centre = mesh.points[mesh.cells["hex8"]].mean(axis=1)
    cells = mesh.cells["hex8"][~((centre[:, 0] > 0.5) & (centre[:, 1] > 0.5))]
    used, number = np.unique(cells, return_inverse=True)
    parts = assembled(Mesh(mesh.points[used], {"hex8": number.reshape(-1, 8)}))
    product = StencilProduct.of(stencil_of(parts.rows, parts.lattice, 1.0))
    assert product is not None
    assert product.in_differences is None


@pytest.mark.parametrize("shape", [(1100, 1, 1), (1, 2, 900), (21, 15, 14)])
def test_differences_in_runs_dont_feel_what_rows_add_up_to(shape) -> None:
    mesh = box(tuple(0.7 * n for n in shape), shape)
    parts = assembled(mesh)
    stencil = stencil_of(parts.rows, parts.lattice, 1.0)
    # far more than rounding leaves, so that it shows
    own = np.random.default_rng(5).normal(size=stencil.diagonal.shape)
    stencil.blocks[:, 13] *= 1.0 + 1e-6 * (own + own.transpose(0, 2, 1))
    product = StencilProduct.of(stencil)
    u = np.random.default_rng(6).normal(size=(1, *mesh.points.shape))
    exact = apply_stiffness(parts.rows, u)
    assert np.abs(product.in_differences(u) - exact).max() <= 1e-13 * np.abs(exact).max()
    assert np.abs(product(u.reshape(1, -1)) - exact.reshape(1, -1)).max() >= 1e-8


def test_sums_of_rows_have_twice_the_digits() -> None:
    rng = np.random.default_rng(7)
    matrices = rng.normal(size=(2, 3, 54, 12)) * 10.0 ** rng.integers(-8, 8, (2, 3, 54, 12))
    sums = RowSums.of(matrices)
    terms = matrices.reshape(2, 3, 18, 3, 12)
    for kind, row, axis, column in np.ndindex(2, 3, 3, 12):
        these = terms[kind, row, :, axis, column].tolist()
        exact = sum(map(Fraction, these))
        high, low = sums.beside[kind, row, axis, column], sums.rest[kind, row, axis, column]
        left = exact - Fraction(float(high)) - Fraction(float(low))
        # Ogita, Rump & Oishi, SIAM J. Sci. Comput. 26 (2005) 1955, proposition 4.5
        assert abs(left) <= (17.01 * 2.0**-53) ** 2 * sum(map(abs, these))
    for kind, k, axis, column in np.ndindex(2, 4, 3, 3):
        exact = sum(map(Fraction, terms[kind, :, :, axis, 3 * k + column].ravel().tolist()))
        got = sums.own[kind, 3 * k + axis, 3 * k + column]
        assert got == pytest.approx(float(exact), rel=1e-15)
    assert np.count_nonzero(sums.own) == 2 * 4 * 9
