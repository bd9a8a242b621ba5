"""Lattices and geometric coarsening: against plain assembly and against P^T A P."""

from __future__ import annotations

import numpy as np
import pytest

from gpusim.fem import Isotropic, Model, solve
from gpusim.fem.assembly.assembly import (
    assemble_groups,
    assemble_lattice,
    group_matrix,
    lattice_stencil,
)
from gpusim.fem.assembly.element_batches import lattice_group, masked, model_groups
from gpusim.fem.lattice.lattice import find_lattice
from gpusim.fem.multigrid.geometric_coarsening import drop_midsides, drop_planes
from gpusim.fem.multigrid.transfer import NodeTransfer
from gpusim.fem.sparse.block_rows import block_matrix
from gpusim.fem.sparse.matrix_product import Product
from gpusim.mesh import CELL_TYPES, Mesh, box, crane, quadratic, split

STEEL = Isotropic(2.0, 0.3)


def shuffled(mesh: Mesh, seed: int = 4) -> Mesh:
    """The same body with nodes, cells and corners in another order."""
    rng = np.random.default_rng(seed)
    order = rng.permutation(mesh.node_count)
    number = np.empty_like(order)
    number[order] = np.arange(len(order))
    cells = rng.permutation(number[mesh.cells["hex8"]])
    # a quarter turn about the cell's own axis keeps it right-handed
    turned = cells[:, [1, 2, 3, 0, 5, 6, 7, 4]]
    cells = np.where((np.arange(len(cells)) % 2 == 0)[:, None], cells, turned)
    return Mesh(mesh.points[order], {"hex8": cells})


def held(mesh: Mesh) -> np.ndarray:
    fixed = np.zeros(mesh.points.shape, dtype=bool)
    fixed[mesh.points[:, 0] <= mesh.points[:, 0].min()] = True
    fixed[7, 1] = True
    return fixed


def test_a_lattice_is_found_in_any_order_and_gives_the_same_matrix() -> None:
    mesh = shuffled(box((1.0, 0.8, 0.5), (5, 4, 3)))
    model = Model(mesh, [STEEL], held(mesh))
    lattice = find_lattice(mesh.points, mesh.cells["hex8"])
    assert lattice is not None and lattice.node.shape == (6, 5, 4)
    group = lattice_group(model, lattice, {"hex8": "incompatible"})
    rows = assemble_lattice(group, lattice)
    plain = assemble_groups(model_groups(model, {"hex8": "incompatible"}), mesh.node_count)
    one, two = block_matrix(rows).toarray(), block_matrix(plain).toarray()
    np.testing.assert_allclose(one, two, atol=1e-14 * np.abs(two).max())
    assert rows.class_count == 27 < plain.class_count


def test_nodes_between_equal_layers_are_alike_and_no_others() -> None:
    # a hole, a layer of another material, and single cells of it: against every node's own cells
    mesh = shuffled(box((1.0, 0.8, 0.5), (9, 7, 6)))
    centre = mesh.points[mesh.cells["hex8"]].mean(axis=1)
    kept = ~((centre[:, 0] > 0.4) & (centre[:, 0] < 0.7) & (centre[:, 2] > 0.2))
    cells, centre = mesh.cells["hex8"][kept], centre[kept]
    used, cells = np.unique(cells, return_inverse=True)
    mesh = Mesh(mesh.points[used], {"hex8": cells.reshape(-1, 8)})
    of_cell = ((centre[:, 1] > 0.5) | (np.arange(len(centre)) % 97 == 5)).astype(np.int32)
    model = Model(mesh, [STEEL, Isotropic(3.0, 0.2)], material_of_cell=of_cell)
    lattice = find_lattice(mesh.points, mesh.cells["hex8"])
    assert lattice is not None
    group = lattice_group(model, lattice, {"hex8": "incompatible"})
    rows = assemble_lattice(group, lattice)
    around = lattice.around(lattice.grid(group.matrix_of))
    distinct, number = np.unique(around, axis=0, return_inverse=True)
    assert rows.class_count == len(distinct) < mesh.node_count
    # one class of ours to each of theirs
    pairs = np.unique(np.stack([rows.row_class, number.ravel()], axis=1), axis=0)
    assert len(pairs) == len(distinct)
    plain = assemble_groups(model_groups(model, {"hex8": "incompatible"}), mesh.node_count)
    one, two = block_matrix(rows).toarray(), block_matrix(plain).toarray()
    np.testing.assert_allclose(one, two, atol=1e-14 * np.abs(two).max())


def test_rows_that_all_differ_are_numbered_as_their_nodes() -> None:
    # what takes their table for the matrix relies on that
    mesh = shuffled(box((1.0, 0.8, 0.5), (5, 4, 3)))
    materials = [Isotropic(1.0 + k, 0.3) for k in range(mesh.cell_count)]
    of_cell = np.arange(mesh.cell_count, dtype=np.int32)
    model = Model(mesh, materials, material_of_cell=of_cell, fixed=held(mesh))
    lattice = find_lattice(mesh.points, mesh.cells["hex8"])
    assert lattice is not None
    rows = assemble_lattice(lattice_group(model, lattice, {"hex8": "full"}), lattice)
    assert (rows.row_class == np.arange(mesh.node_count)).all()
    plain = block_matrix(assemble_groups(model_groups(model, {"hex8": "full"}), mesh.node_count))
    product = Product.of_rows(rows, 1.0)
    x = np.random.default_rng(2).normal(size=(1, 3 * mesh.node_count))
    wanted = plain @ x[0]
    assert np.abs(product(x)[0] - wanted).max() <= 1e-14 * np.abs(wanted).max()


def test_planes_that_few_nodes_lie_on_are_found() -> None:
    # one column of cells stands out: the planes of its top hold four nodes each
    mesh = box((1.0, 1.0, 1.0), (12, 12, 3))
    tall = box((1.0 / 12.0, 1.0 / 12.0, 9.0), (1, 1, 27))
    points = np.concatenate([mesh.points, tall.points])
    cells = np.concatenate([mesh.cells["hex8"], tall.cells["hex8"] + mesh.node_count])
    _, first, number = np.unique(
        np.rint(1e6 * points).astype(int), axis=0, return_index=True, return_inverse=True
    )
    cells = np.unique(number.ravel()[cells], axis=0)
    lattice = find_lattice(points[first], cells)
    assert lattice is not None and lattice.node.shape == (13, 13, 28)


@pytest.mark.parametrize("spoil", ["moved node", "missing node plane", "crack"])
def test_what_is_no_lattice_is_refused(spoil: str) -> None:
    mesh = box((1.0, 0.8, 0.5), (5, 4, 3))
    points, cells = mesh.points.copy(), mesh.cells["hex8"].copy()
    if spoil == "moved node":
        points[30] += 1e-3
    elif spoil == "missing node plane":
        points[points[:, 0] == 0.2, 0] = 0.2001
        points[(points[:, 0] == 0.2001) & (points[:, 1] < 0.1), 0] = 0.2
    else:
        # two nodes at one place: the cells on either side aren't joined there
        points = np.concatenate([points, points[[40]]])
        cells[cells.shape[0] // 2] = np.where(
            cells[cells.shape[0] // 2] == 40, len(points) - 1, cells[cells.shape[0] // 2]
        )
        cells[:4] = np.where(cells[:4] == 40, len(points) - 1, cells[:4])
        if not (cells == len(points) - 1).any():
            cells[np.argwhere(cells == 40)[0][0]][:] = cells[np.argwhere(cells == 40)[0][0]]
            first = np.argwhere(cells == 40)[0]
            cells[first[0], first[1]] = len(points) - 1
    assert find_lattice(points, cells) is None


def galerkin_matches(weights, fine, coarse, free, kept) -> None:  # type: ignore[no-untyped-def]
    transfer = NodeTransfer(weights, free, kept).matrix.tocsr()
    wanted = (transfer.T @ fine @ transfer).toarray()
    np.testing.assert_allclose(coarse.toarray(), wanted, atol=1e-13 * np.abs(wanted).max())


@pytest.mark.parametrize("graded", [False, True])
def test_planes_left_out_give_the_galerkin_matrix(graded: bool) -> None:
    mesh = box((1.0, 0.9, 0.8), (10, 9, 8))
    if graded:
        mesh = mesh.moved(0.15 * mesh.points**2)
    free = ~held(mesh)
    model = Model(mesh, [STEEL], ~free)
    lattice = find_lattice(mesh.points, mesh.cells["hex8"])
    assert lattice is not None
    group = lattice_group(model, lattice, {"hex8": "incompatible"})
    coarser = drop_planes(group, lattice, free)
    assert coarser is not None and coarser.lattice is not None
    assert coarser.lattice.node.shape == (6, 6, 5)
    fine = block_matrix(assemble_lattice(group, lattice))
    coarse = lattice_stencil(coarser.groups[0], coarser.lattice).matrix
    galerkin_matches(coarser.interpolation.matrix, fine, coarse, free, coarser.kept)
    # linear displacements are interpolated exactly, graded planes included
    field = mesh.points @ np.array([[1.0, 2.0, -1.0], [0.5, 0.0, 3.0], [0.0, 1.0, 1.0]])
    np.testing.assert_allclose(
        coarser.interpolation.matrix @ field[coarser.kept], field, atol=1e-12
    )


def test_an_l_shape_keeps_its_inner_corner() -> None:
    mesh = box((1.0, 1.0, 1.0), (18, 16, 16))
    cells = mesh.cells["hex8"]
    centre = mesh.points[cells].mean(axis=1)
    cells = cells[~((centre[:, 0] > 0.5) & (centre[:, 2] > 0.5))]
    used = np.unique(cells)
    number = np.full(mesh.node_count, -1)
    number[used] = np.arange(len(used))
    shape = Mesh(mesh.points[used], {"hex8": number[cells]})
    lattice = find_lattice(shape.points, shape.cells["hex8"])
    assert lattice is not None
    free = ~held(shape)
    group = lattice_group(Model(shape, [STEEL], ~free), lattice, {"hex8": "full"})
    coarser = drop_planes(group, lattice, free)
    assert coarser is not None and coarser.lattice is not None
    # 9 cells before the corner: 0 2 4 6 8 9, then 11 … 17 18
    np.testing.assert_allclose(
        coarser.lattice.planes[0] * 18, [0, 2, 4, 6, 8, 9, 11, 13, 15, 17, 18]
    )
    fine = block_matrix(assemble_lattice(group, lattice))
    coarse = lattice_stencil(coarser.groups[0], coarser.lattice).matrix
    galerkin_matches(coarser.interpolation.matrix, fine, coarse, free, coarser.kept)


def slotted(depth: int) -> Mesh:
    """A block 20 cells high with a slot one cell wide and ``depth`` cells deep."""
    mesh = box((3.3, 2.0, 1.0), (33, 20, 10))
    cells = mesh.cells["hex8"]
    centre = mesh.points[cells].mean(axis=1)
    cells = cells[~((np.abs(centre[:, 0] - 1.65) < 0.01) & (centre[:, 1] > 2.0 - 0.1 * depth))]
    used = np.unique(cells)
    number = np.full(mesh.node_count, -1)
    number[used] = np.arange(len(used))
    return Mesh(mesh.points[used], {"hex8": number[cells]})


@pytest.mark.parametrize("thin", ["crane", "plate", "deep slot"])
def test_bodies_with_thin_parts_are_left_to_aggregation(thin: str) -> None:
    mesh = {
        "crane": lambda: crane(element_size=0.006),
        "plate": lambda: box((1.0, 1.0, 0.1), (20, 20, 4)),
        "deep slot": lambda: slotted(18),
    }[thin]()
    lattice = find_lattice(mesh.points, mesh.cells["hex8"])
    assert lattice is not None
    group = lattice_group(Model(mesh, [STEEL]), lattice, {"hex8": "incompatible"})
    assert drop_planes(group, lattice, np.ones(mesh.points.shape, dtype=bool)) is None


def test_a_narrow_slot_in_a_thick_body_is_no_thin_part() -> None:
    mesh = slotted(10)
    lattice = find_lattice(mesh.points, mesh.cells["hex8"])
    assert lattice is not None
    free = ~held(mesh)
    group = lattice_group(Model(mesh, [STEEL], ~free), lattice, {"hex8": "incompatible"})
    coarser = drop_planes(group, lattice, free)
    assert coarser is not None and coarser.lattice is not None
    # both sides of the slot stay, from 1.6 to 1.7
    np.testing.assert_allclose(coarser.lattice.planes[0][8:10], [1.6, 1.7])
    assert len(coarser.kept) < 0.2 * mesh.node_count


@pytest.mark.parametrize("kind", ["tet10", "hex20", "hex27", "wedge15"])
def test_midsides_left_out_give_the_galerkin_matrix(kind: str) -> None:
    linear = box((1.0, 0.9, 0.8), (3, 2, 2))
    if kind in ("tet10", "wedge15"):
        linear = split(linear, {"tet10": "tet4", "wedge15": "wedge6"}[kind])
    mesh = quadratic(linear, serendipity=CELL_TYPES[kind].serendipity)
    assert set(mesh.cells) == {kind}
    free = ~held(mesh)
    model = Model(mesh, [STEEL], ~free)
    groups = model_groups(model, {kind: "full"})
    coarser = drop_midsides(groups, free)
    fine = block_matrix(assemble_groups(groups, mesh.node_count))
    coarse = group_matrix(coarser.groups, len(coarser.kept))
    galerkin_matches(coarser.interpolation, fine, coarse, free, coarser.kept)
    assert len(coarser.kept) == linear.node_count


def test_masked_elements_lose_the_fixed_rows_only() -> None:
    mesh = box((1.0, 0.9, 0.8), (3, 2, 2))
    free = ~held(mesh)
    group = model_groups(Model(mesh, [STEEL], ~free), {"hex8": "full"})[0]
    dense = group_matrix([masked(group, free)], mesh.node_count).toarray()
    whole = group_matrix([group], mesh.node_count).toarray()
    keep = free.ravel()
    np.testing.assert_array_equal(dense[~keep], 0.0)
    np.testing.assert_allclose(dense[np.ix_(keep, keep)], whole[np.ix_(keep, keep)], atol=1e-14)


@pytest.mark.parametrize("kind", ["hex8", "hex20", "tet10"])
def test_iterations_hardly_grow_with_refinement(kind: str) -> None:
    counts = []
    for size in (6, 12) if kind != "hex8" else (12, 24):
        mesh = box((1.0, 1.0, 1.0), (size,) * 3)
        if kind == "tet10":
            mesh = split(mesh, "tet4")
        if kind != "hex8":
            mesh = quadratic(mesh)
        fixed = np.zeros(mesh.points.shape, dtype=bool)
        fixed[mesh.points[:, 0] == 0.0] = True
        forces = np.zeros(mesh.points.shape)
        forces[mesh.points[:, 0] == 1.0, 1] = 1.0
        solution = solve(Model(mesh, [STEEL], fixed, forces), backend="numpy", method="multigrid")
        assert solution.converged
        counts.append(solution.iterations)
    assert counts[1] <= counts[0] + 4 and counts[1] <= 16
