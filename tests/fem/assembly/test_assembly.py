"""Assembly of elements no two of which are equal: against plain sums of element matrices."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.sparse import bsr_matrix

from gpusim.errors import InputError
from gpusim.fem import Isotropic, Model, Orthotropic, solve
from gpusim.fem.assembly.assembly import assemble, assemble_groups, group_matrix
from gpusim.fem.assembly.element_batches import DistinctGroup, Group, model_groups, pair_blocks
from gpusim.fem.assembly.node_graph import NodeGraph
from gpusim.fem.assembly.stiffness_rounding import Deformation
from gpusim.fem.elements.element_matrix import element_stiffness
from gpusim.fem.elements.straight_tetrahedra import StraightTets, is_straight
from gpusim.fem.model.supports import rigid_modes
from gpusim.fem.multigrid.geometric_coarsening import drop_midsides
from gpusim.fem.multigrid.smoothed_aggregation import galerkin, prolongator
from gpusim.fem.multigrid.transfer import NodeTransfer, in_single
from gpusim.fem.sparse.block_rows import block_matrix, invert_blocks
from gpusim.fem.sparse.matrix_product import Product
from gpusim.mesh import Mesh, box, quadratic, split

STEEL = Isotropic(2.0, 0.3)
WOOD = Orthotropic((2.0, 0.3, 0.2), (0.3, 0.25, 0.1), (0.2, 0.1, 0.15))
RULE = {"tet10": "full", "hex8": "incompatible", "wedge15": "full"}


def irregular(kind: str) -> Mesh:
    """Elements all of different shape, nodes and cells in no order."""
    rng = np.random.default_rng(3)
    mesh = box((1.3, 0.9, 0.7), (4, 3, 2))
    mesh = mesh.moved(0.04 * rng.normal(size=mesh.points.shape))
    if kind != "hex8":
        mesh = quadratic(split(mesh, {"tet10": "tet4", "wedge15": "wedge6"}[kind]))
    order = rng.permutation(mesh.node_count)
    number = np.empty_like(order)
    number[order] = np.arange(len(order))
    return Mesh(mesh.points[order], {kind: rng.permutation(number[mesh.cells[kind]])})


def curved(mesh: Mesh) -> Mesh:
    """With the midsides of some tet10 off the middle."""
    moved = np.zeros(mesh.points.shape)
    moved[np.unique(mesh.cells["tet10"][:5, 4:])] = [0.004, -0.003, 0.002]
    return mesh.moved(moved)


def swept() -> Mesh:
    """Layers of elements of different shapes, the same in each; more than one processor's share."""
    mesh = box((30.0, 30.0, 2.0), (30, 30, 5))
    move = np.random.default_rng(4).uniform(-0.2, 0.2, (31, 31, 2))
    place = np.rint(mesh.points[:, :2]).astype(int)
    shift = np.zeros(mesh.points.shape)
    shift[:, :2] = move[place[:, 0], place[:, 1]]
    return mesh.moved(shift)


def plain_sum(mesh: Mesh, materials: list, of_cell: np.ndarray) -> np.ndarray:  # type: ignore[type-arg]
    (kind, cells), *rest = mesh.cells.items()
    assert not rest
    moduli = np.stack([one.stiffness() for one in materials])[of_cell]
    total = np.zeros((3 * mesh.node_count,) * 2)
    matrices = element_stiffness(kind, mesh.points[cells], moduli, RULE[kind])
    for cell, matrix in zip(cells, matrices, strict=True):
        at = (3 * cell[:, None] + np.arange(3)).ravel()
        total[np.ix_(at, at)] += matrix
    return total


@pytest.mark.parametrize("kind", ["hex8", "wedge15", "tet10", "curved tet10"])
def test_unequal_elements_add_up_as_in_a_plain_sum(kind: str) -> None:
    mesh = irregular(kind.removeprefix("curved "))
    mesh = curved(mesh) if kind.startswith("curved") else mesh
    of_cell = np.arange(mesh.cell_count) % 2
    model = Model(mesh, [STEEL, WOOD], material_of_cell=of_cell)
    groups = model_groups(model, RULE)
    assert len(groups) == 1 + kind.startswith("curved")
    assert all(isinstance(one, DistinctGroup) for one in groups)
    wanted = plain_sum(mesh, [STEEL, WOOD], of_cell)
    limit = 2e-14 * np.abs(wanted).max()
    rows = assemble_groups(groups, mesh.node_count)
    assert rows.class_count == mesh.node_count
    matrix = block_matrix(rows).toarray()
    np.testing.assert_allclose(matrix, wanted, atol=limit)
    # to the last bit: what refinement rests on
    np.testing.assert_array_equal(matrix, matrix.T)
    np.testing.assert_allclose(group_matrix(groups, mesh.node_count).toarray(), wanted, atol=limit)


def test_only_the_rows_of_some_nodes() -> None:
    mesh = irregular("wedge15")
    groups = model_groups(Model(mesh, [WOOD]), RULE)
    edges = NodeGraph([one.cells for one in groups], mesh.node_count)
    every = edges.blocks(groups, None)
    nodes = np.array([17, 3, 80])
    wanted = [every[edges.start[k] : edges.start[k + 1]] for k in nodes]
    found = edges.blocks(groups, nodes)
    np.testing.assert_allclose(found, np.concatenate(wanted), atol=1e-15 * np.abs(every).max())


class Softened:
    """A stranger's elements: those of a group, each of another stiffness, never many at a time."""

    def __init__(self, group: DistinctGroup, factor: np.ndarray) -> None:  # type: ignore[type-arg]
        self.name, self.cells, self.distinct = group.name, group.cells, group.distinct
        self._group, self._factor, self.most = group, factor, 0

    def at(self, which: np.ndarray) -> np.ndarray:  # type: ignore[type-arg]
        self.most = max(self.most, len(which))
        return self._factor[which, None, None] * self._group.at(which)

    def blocks(self, which, diagonal):  # type: ignore[no-untyped-def]
        return pair_blocks(self.at(which), diagonal)


def test_a_pattern_is_filled_again_as_if_it_were_new() -> None:
    mesh = box((1.3, 0.9, 0.7), (15, 13, 11))
    mesh = mesh.moved(0.004 * np.random.default_rng(3).normal(size=mesh.points.shape))
    groups = model_groups(Model(mesh, [WOOD]), RULE)
    pattern = NodeGraph([one.cells for one in groups], mesh.node_count)
    first = pattern.fill(groups)
    before = first.table.copy()
    (group,) = groups
    assert isinstance(group, DistinctGroup)
    softened = Softened(group, np.random.default_rng(1).uniform(0.1, 1.0, len(group.cells)))
    fresh = NodeGraph([softened.cells], mesh.node_count).fill([softened])
    again = pattern.fill([softened])
    for one, other in (
        (again, fresh),
        (pattern.fill(groups), assemble_groups(groups, mesh.node_count)),
    ):
        np.testing.assert_array_equal(one.table, other.table)
        np.testing.assert_array_equal(one.diagonal, other.diagonal)
        np.testing.assert_array_equal(one.start, other.start)
        np.testing.assert_array_equal(one.neighbour, other.neighbour)
    # what was filled before stays
    np.testing.assert_array_equal(first.table, before)
    assert not np.allclose(again.table, before)
    u = np.random.default_rng(2).normal(size=mesh.points.shape)
    forces = np.zeros(u.shape)
    for cell in range(len(group.cells)):
        nodes = group.cells[cell]
        matrix = softened.at(np.array([cell]))[0]
        forces[nodes] += (matrix @ u[nodes].ravel()).reshape(-1, 3)
    found = (block_matrix(again) @ u.ravel()).reshape(-1, 3)
    np.testing.assert_allclose(found, forces, atol=1e-13 * np.abs(forces).max())
    assert 0 < softened.most <= 512 < len(group.cells)


def test_straight_tetrahedra_in_closed_form() -> None:
    mesh = irregular("tet10")
    cells = mesh.cells["tet10"]
    assert is_straight(mesh.points[cells]).all()
    # as far from the origin as coordinates in float64 allow
    assert is_straight(mesh.points[cells] + 1e6).all()
    bent = is_straight(curved(mesh).points[cells])
    assert 0 < bent.sum() < len(bent)
    moduli = np.stack([WOOD.stiffness(), STEEL.stiffness()])
    of_cell = (np.arange(len(cells)) % 3 == 0).astype(np.int32)
    source = StraightTets(mesh.points, cells[:, :4], moduli, of_cell)
    which = np.array([3, 1, 44])
    for form, kind, nodes in ((source, "tet10", cells), (source.linear(), "tet4", cells[:, :4])):
        wanted = element_stiffness(kind, mesh.points[nodes[which]], moduli[of_cell[which]])
        np.testing.assert_allclose(form.at(which), wanted, atol=1e-14 * np.abs(wanted).max())


def test_an_inverted_tetrahedron_is_refused() -> None:
    mesh = irregular("tet10")
    turned = mesh.cells["tet10"][:, [0, 2, 1, 3]]
    source = StraightTets(mesh.points, turned, STEEL.stiffness()[None], np.zeros(len(turned), int))
    with pytest.raises(InputError, match="3 elements are inverted"):
        source.at(np.arange(3))


def test_midsides_left_out_of_unequal_tetrahedra() -> None:
    mesh = curved(irregular("tet10"))
    fixed = np.zeros(mesh.points.shape, dtype=bool)
    fixed[mesh.points[:, 0] < 0.2] = True
    # a midside that is held in one direction while its corners are free
    fixed[mesh.cells["tet10"][np.argmax(mesh.points[mesh.cells["tet10"][:, 0], 0]), 5], 1] = True
    groups = model_groups(Model(mesh, [WOOD], fixed), RULE)
    coarser = drop_midsides(groups, ~fixed)
    assert {type(one) for one in coarser.groups} == {Group, DistinctGroup}
    transfer = NodeTransfer(coarser.interpolation, ~fixed, coarser.kept).matrix.tocsr()
    fine = block_matrix(assemble_groups(groups, mesh.node_count))
    wanted = (transfer.T @ fine @ transfer).toarray()
    found = group_matrix(coarser.groups, len(coarser.kept)).toarray()
    np.testing.assert_allclose(found, wanted, atol=1e-13 * np.abs(wanted).max())


def test_a_diagonal_stored_apart_gives_the_same_coarse_level() -> None:
    mesh = irregular("wedge15")
    rows = assemble_groups(model_groups(Model(mesh, [WOOD]), RULE), mesh.node_count)
    free = np.ones(mesh.points.shape, dtype=bool)
    free[mesh.points[:, 0] < 0.1] = False
    free[5, 1] = False
    scale = 0.25
    inverse = invert_blocks(rows.diagonal / scale, free)
    near_null = rigid_modes(mesh.points, np.zeros(3), 1.0) * free[:, :, None]
    coarser = []
    for matrix in (Product.of_rows(rows, scale), Product(block_matrix(rows, scale))):
        p, _, mask = prolongator(matrix, inverse, 2.1, near_null, free, False)
        coarser.append((p, galerkin(matrix, p), mask))
    apart, whole = coarser
    for one, two in zip(apart[:2], whole[:2], strict=True):
        wanted = two.toarray()
        assert 6 < wanted.shape[1] < 0.5 * 3 * mesh.node_count
        np.testing.assert_allclose(one.toarray(), wanted, atol=1e-13 * np.abs(wanted).max())
    np.testing.assert_array_equal(apart[2], whole[2])


@pytest.mark.parametrize("single", [False, True])
def test_galerkin_products_add_up_whatever_the_parts(
    single: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A node without neighbours among them: only its diagonal block couples its parents."""
    mesh = irregular("hex8")
    count = mesh.node_count + 1
    rows = assemble_groups(model_groups(Model(mesh, [STEEL]), RULE), count)
    rows.diagonal[-1] = np.eye(3)
    rng = np.random.default_rng(3)
    matrix = Product.of_rows(rows, 4.0)
    there = rng.random((count, 9)) < 0.3
    there[-1] = np.arange(9) > 6
    blocks = there[:, None, :, None] * rng.normal(size=(count, 3, 9, 6))
    # the last parents are that node's alone
    blocks[:-1, :, 7:] = 0.0
    p = bsr_matrix(blocks.reshape(3 * count, -1), blocksize=(3, 6))
    p = in_single(p) if single else p
    dense = matrix.matrix.toarray()
    wide = p.toarray().astype(np.float64)
    wanted = wide.T @ dense @ wide
    for least in (10**9, 200):
        monkeypatch.setattr("gpusim.fem.multigrid.smoothed_aggregation._LEAST_PART", least)
        got = galerkin(matrix, p)
        assert got.blocksize == (6, 6)
        assert got.dtype == np.float64
        assert np.abs(got.toarray() - wanted).max() <= 1e-13 * np.abs(wanted).max()


def test_matrices_that_are_not_wanted_soon_are_formed_again() -> None:
    mesh = swept()
    model = Model(mesh, [STEEL])
    (kept,) = model_groups(model, RULE)
    assembled = assemble(model, RULE)
    (group,) = assembled.groups
    assert isinstance(group, Group)
    assert isinstance(kept, Group)
    assert group._matrices is None
    assert 1 < group.distinct < mesh.cell_count
    u = np.random.default_rng(8).normal(size=(1, mesh.node_count, 3))
    by_elements = Deformation(assembled.groups, mesh.points).product(u)
    np.testing.assert_array_equal(group.matrices, kept.matrices)
    wanted = block_matrix(assembled.rows) @ u.ravel()
    assert np.abs(by_elements.ravel() - wanted).max() <= 1e-12 * np.abs(wanted).max()
    # what a model gives for good stays
    whole = Group("hex8", group.cells, group.matrix_of, kept.matrices)
    whole.forget()
    assert whole.matrices is kept.matrices


def test_no_straight_element_is_held() -> None:
    """Those at the support are all curved: none of the straight ones has a fixed unknown."""
    mesh = irregular("tet10")
    cells = mesh.cells["tet10"]
    held = np.zeros(mesh.node_count, dtype=bool)
    held[cells[np.argsort(mesh.points[cells, 0].min(axis=1))[:4], :4]] = True
    at_support = np.unique(cells[held[cells].any(axis=1)][:, 4:])
    moved = np.zeros(mesh.points.shape)
    moved[at_support] = [0.003, -0.002, 0.001]
    mesh = mesh.moved(moved)
    fixed = np.repeat(held[:, None], 3, axis=1)
    forces = np.zeros((1, *mesh.points.shape))
    forces[0, np.argsort(mesh.points[:, 0])[-9:]] = (0.1, 1.0, -0.3)
    model = Model(mesh, [STEEL], fixed=fixed, forces=forces)
    straight = is_straight(mesh.points[cells])
    assert straight.any() and not held[cells[straight]].any()
    found = solve(model, method="multigrid", backend="numpy", tolerance=1e-8)
    exact = solve(model, method="direct", tolerance=1e-10)
    assert np.abs(found.u - exact.u).max() <= 1e-8 * np.abs(exact.u).max()
