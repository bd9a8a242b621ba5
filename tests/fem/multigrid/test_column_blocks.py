"""Columns across flat cells: where they stand, their inverse, and what they do for thin bodies."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import gpusim.fem.multigrid.column_blocks as columns
import gpusim.fem.multigrid.hierarchy as hierarchy
from gpusim import fem
from gpusim.fem.assembly.assembly import assemble
from gpusim.fem.assembly.element_batches import Elements
from gpusim.fem.assembly.system import make_system
from gpusim.fem.krylov.multigrid_preconditioner import Multigrid
from gpusim.fem.model.model import resolve_formulation
from gpusim.fem.model.supports import rigid_modes
from gpusim.fem.multigrid.column_blocks import Columns, columns_across, thin_axes
from gpusim.fem.multigrid.hierarchy import build_hierarchy
from gpusim.fem.multigrid.smoothed_aggregation import galerkin, prolongator
from gpusim.fem.sparse.block_rows import block_matrix
from gpusim.fem.sparse.matrix_product import Product
from gpusim.mesh import Mesh, box, plate_with_hole
from gpusim.mesh.builders.conversion import split


def plate(kind: str, cells: tuple[int, int, int] = (14, 12, 3), thickness: float = 0.5) -> Mesh:
    """A plate of cells about six times as long as thick: on a lattice, moved, turned, of wedges."""
    mesh = box((float(cells[0]), float(cells[1]), thickness), cells)
    if kind == "wedge6":
        return split(mesh, "wedge6")
    if kind == "moved":
        inner = (mesh.points[:, :1] > 0.0) & (mesh.points[:, :1] < cells[0])
        move = np.random.default_rng(2).uniform(-0.03, 0.03, mesh.points.shape)
        return mesh.moved(move * inner)
    if kind == "turned":
        # every other cell begins at another corner, so that its axes have other numbers
        blocks = mesh.cells["hex8"].copy()
        blocks[::2] = blocks[::2][:, [1, 5, 6, 2, 0, 4, 7, 3]]
        return Mesh(mesh.points, {"hex8": blocks})
    return mesh


def model_of(mesh: Mesh) -> fem.Model:
    x, y = (mesh.points - mesh.bounds[0])[:, :2].T
    fixed = np.zeros(mesh.points.shape, dtype=bool)
    fixed[x < 1e-9] = True
    fixed[y < 1e-9, 1] = True
    forces = np.zeros(mesh.points.shape)
    end = x > x.max() - 1e-9
    forces[end] = np.array([0.2, 0.1, -1.0]) / end.sum()
    return fem.Model(mesh, [fem.Isotropic(210e3, 0.3)], fixed=fixed, forces=forces)


def groups_of(mesh: Mesh) -> list[Elements]:
    model = model_of(mesh)
    return list(assemble(model, resolve_formulation(model, None)).groups)


@pytest.mark.parametrize("kind", ["lattice", "moved", "turned", "wedge6"])
def test_columns_stand_across_the_thickness(kind: str) -> None:
    mesh = plate(kind)
    column = columns_across(groups_of(mesh), mesh.points)
    assert column is not None
    assert column.max() + 1 == 15 * 13
    assert (np.bincount(column) == 4).all()
    # a column's nodes lie above one another
    lowest = np.full((15 * 13, 2), np.inf)
    np.minimum.at(lowest, column, mesh.points[:, :2])
    assert np.abs(mesh.points[:, :2] - lowest[column]).max() <= 0.07


def test_there_are_none_in_cubes_thick_bodies_and_tetrahedra() -> None:
    for mesh in (
        box((6.0, 5.0, 4.0), (6, 5, 4)),
        box((20.0, 20.0, 4.0), (5, 5, 16)),
        split(box((6.0, 5.0, 0.5), (6, 5, 3)), "tet4"),
    ):
        assert columns_across(groups_of(mesh), mesh.points) is None


@pytest.mark.parametrize("apart", [False, True])
def test_the_inverse_is_that_of_each_columns_block(apart: bool) -> None:
    mesh = plate("moved", (6, 5, 3))
    model = model_of(mesh)
    parts = assemble(model, resolve_formulation(model, None))
    assert model.fixed is not None
    free, column = ~model.fixed, columns_across(parts.groups, mesh.points)
    assert column is not None
    dense = block_matrix(parts.rows, 4.0).toarray()
    matrix = Product.of_rows(parts.rows, 4.0) if apart else Product(block_matrix(parts.rows, 4.0))
    r = np.random.default_rng(3).normal(size=(2, free.size))
    wanted = np.zeros_like(r)
    for one in range(column.max() + 1):
        unknowns = np.flatnonzero(np.repeat(column == one, 3) & free.ravel())
        wanted[:, unknowns] = np.linalg.solve(dense[np.ix_(unknowns, unknowns)], r[:, unknowns].T).T
    got = Columns(matrix, free, column)
    assert np.abs(got.apply(r) - wanted).max() <= 1e-12 * np.abs(wanted).max()
    # a node in the wrong column is seen
    column[[20, 21]] = column[[21, 20]]
    wrong = Columns(matrix, free, column).apply(r)
    assert np.abs(wrong - wanted).max() > 1e-3 * np.abs(wanted).max()


def test_aggregates_keep_columns_together() -> None:
    mesh = plate("moved")
    model = model_of(mesh)
    parts = assemble(model, resolve_formulation(model, None))
    assert model.fixed is not None
    free, column = ~model.fixed, columns_across(parts.groups, mesh.points)
    assert column is not None
    near_null = rigid_modes(mesh.points, mesh.points.mean(axis=0), 7.0) * free[:, :, None]
    forms = []
    for matrix in (Product.of_rows(parts.rows, 1.0), Product(block_matrix(parts.rows, 1.0))):
        smoother = Columns(matrix, free, column)
        p, coarse_null, _ = prolongator(matrix, smoother, 2.6, near_null, free, False)
        forms.append(p.toarray())
        # the same matrix, whether by aggregates' P or by the plain product
        dense = block_matrix(parts.rows, 1.0).toarray()
        product = forms[-1].T @ dense @ forms[-1]
        coarse = galerkin(matrix, p).toarray()
        assert np.abs(coarse - product).max() <= 1e-12 * np.abs(product).max()
    assert np.abs(forms[0] - forms[1]).max() <= 1e-12 * np.abs(forms[0]).max()
    # rigid motions stay rigid away from what is held
    made = (forms[0] @ coarse_null.reshape(-1, 6)).reshape(-1, 3, 6)
    far = (mesh.points[:, 0] > 1.5) & (mesh.points[:, 1] > 1.5)
    assert np.abs(made - near_null)[far].max() <= 1e-9 * np.abs(near_null).max()


@pytest.mark.parametrize("single", [False, True])
def test_half_a_cycle_tells_the_energy_of_a_symmetric_one(single: bool) -> None:
    close = 1e-6 if single else 1e-12
    mesh = plate("lattice", (24, 20, 3))
    model = model_of(mesh)
    parts = assemble(model, resolve_formulation(model, None))
    assert model.fixed is not None
    system = replace(make_system(model, parts), stencil=None)
    made = build_hierarchy(parts, system, mesh.points, uneven_stiffness=not single)
    assert isinstance(made.levels[0].smoother, Columns)
    cycle = Multigrid(made)
    r = np.random.default_rng(4).normal(size=(2, model.fixed.size)) * ~model.fixed.ravel()
    z = cycle.apply(r)
    assert np.isclose(r[0] @ z[1], r[1] @ z[0], rtol=close)
    np.testing.assert_allclose(cycle.down(r, [0, 1]), np.einsum("ln,ln->l", r, z), rtol=close)
    np.testing.assert_allclose(cycle.up([0, 1]), z, atol=1e-13 * np.abs(z).max())


@pytest.mark.parametrize("kind", ["lattice", "moved", "wedge6"])
def test_thin_plates_take_a_fraction_of_the_iterations(
    kind: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    model = model_of(plate(kind, (20, 20, 4), 0.6))
    exact = fem.solve(model, method="direct").u
    iterations = []
    for _ in range(2):
        found = fem.solve(model, tolerance=1e-6, method="multigrid", backend="numpy")
        error = np.linalg.norm(found.u - exact) / np.linalg.norm(exact)
        assert error <= found.error_estimate <= 1e-6 or not iterations == []
        iterations.append(found.iterations)
        monkeypatch.setattr(hierarchy, "columns_across", lambda *_: None)
    assert iterations[0] <= 40
    assert iterations[0] <= iterations[1] / 3


def with_hole(through: int = 3, thickness: float = 1.0) -> Mesh:
    """Near the hole cells are shorter along the surface than across, at the border they aren't."""
    return plate_with_hole(40.0, 16.0, thickness, 4.0, around=48, radial=20, through=through)


@pytest.mark.parametrize("kind", ["hex8", "turned", "wedge6"])
def test_columns_stand_across_thin_bodies_whatever_the_cells_shape(kind: str) -> None:
    mesh = with_hole()
    if kind == "wedge6":
        mesh = split(mesh, "wedge6")
    if kind == "turned":
        blocks = mesh.cells["hex8"].copy()
        blocks[::2] = blocks[::2][:, [1, 5, 6, 2, 0, 4, 7, 3]]
        mesh = Mesh(mesh.points, {"hex8": blocks})
    column = columns_across(groups_of(mesh), mesh.points)
    assert column is not None
    assert (np.bincount(column) == 4).all()
    for axis in (0, 1):
        place = mesh.points[:, axis]
        mean = np.bincount(column, place) / np.bincount(column)
        assert np.abs(place - mean[column]).max() <= 1e-9


def test_shells_are_thin_along_axes_of_their_own() -> None:
    """A tube's wall: cells turn, and so does the way across."""
    flat = box((60.0, 30.0, 2.0), (60, 30, 2))
    angle, radius = flat.points[:, 0] / 60.0 * 1.9 * np.pi, 20.0 + flat.points[:, 2]
    wall = np.stack([radius * np.sin(angle), flat.points[:, 1], radius * np.cos(angle)], axis=1)
    mesh = flat.moved(wall - flat.points)
    found = thin_axes(groups_of(mesh), mesh.points, 6)
    assert found is not None and (found[0] == 2).all()
    column = columns_across(groups_of(mesh), mesh.points)
    assert column is not None and (np.bincount(column) == 3).all()


@pytest.mark.parametrize(
    "mesh",
    [
        box((30.0, 5.0, 4.0), (30, 5, 4)),  # a bar: as thick as wide
        with_hole(through=8, thickness=3.0),  # too many cells across
        split(with_hole(), "tet4"),
    ],
)
def test_bars_thick_plates_and_tetrahedra_have_no_thin_axis(mesh: Mesh) -> None:
    found = thin_axes(groups_of(mesh), mesh.points, 6)
    assert found is None or (found[0] == -1).all()


def test_a_plate_with_fine_cells_at_its_hole_takes_half_the_iterations(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    model = model_of(with_hole(through=2))
    exact = fem.solve(model, method="direct").u
    iterations = []
    for _ in range(2):
        found = fem.solve(model, tolerance=1e-6, method="multigrid", backend="numpy")
        error = np.linalg.norm(found.u - exact) / np.linalg.norm(exact)
        assert error <= found.error_estimate <= 1e-6
        iterations.append(found.iterations)
        monkeypatch.setattr(columns, "thin_axes", lambda *_: None)
    assert iterations[0] <= iterations[1] / 2


def test_levels_below_columns_of_long_cells_dont_fill_up() -> None:
    """Aggregates of two leave levels whose rows have hundreds of blocks."""
    mesh = plate_with_hole(100.0, 40.0, 0.25, 10.0, around=160, radial=60, through=2)
    model = model_of(mesh)
    parts = assemble(model, resolve_formulation(model, None))
    assert model.fixed is not None
    made = build_hierarchy(parts, make_system(model, parts), mesh.points)
    assert isinstance(made.levels[0].smoother, Columns)
    numbers = [level.product.matrix.data.size for level in made.levels]
    assert sum(numbers[1:]) <= 0.1 * numbers[0]
