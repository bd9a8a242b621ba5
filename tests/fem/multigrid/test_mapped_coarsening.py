"""Bricks numbered along three axes: found, refused, and left out sheet by sheet."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

import gpusim.fem.multigrid.hierarchy as hierarchy
from benchmarks.solver.cases import uneven_bricks
from gpusim.arrays.ragged import along_paths
from gpusim.fem import Isotropic, Model, solve
from gpusim.fem.assembly.assembly import assemble
from gpusim.fem.assembly.system import make_system
from gpusim.fem.model.model import resolve_formulation
from gpusim.fem.multigrid.geometric_coarsening import coarse_lattice
from gpusim.fem.multigrid.hierarchy import build_hierarchy
from gpusim.fem.multigrid.mapped_coarsening import mapped_lattice
from gpusim.fem.multigrid.transfer import NodeTransfer, PlaneWeights
from gpusim.fem.sparse.block_rows import block_matrix
from gpusim.gpu import Device
from gpusim.mesh import Mesh, box, quadratic

RNG = np.random.default_rng(8)


def arc(divisions: tuple[int, int, int], angle: float = 1.5) -> Mesh:
    """A bar bent to a circle's arc."""
    straight = box((angle, 1.0, 1.0), divisions)
    turn, x, z = straight.points.T
    radius = 4.0 + x
    bent = np.stack([radius * np.sin(turn), radius * np.cos(turn), z], axis=1)
    return straight.moved(bent - straight.points)


def shuffled(mesh: Mesh) -> Mesh:
    """The same with nodes and cells in another order."""
    order, cells = RNG.permutation(mesh.node_count), mesh.cells["hex8"]
    number = np.empty(len(order), dtype=np.int32)
    number[order] = np.arange(len(order), dtype=np.int32)
    return Mesh(mesh.points[order], {"hex8": number[cells][RNG.permutation(len(cells))]})


def bent_corner() -> Mesh:
    """An L, whose cells aren't all reached along one axis after the other, bent."""
    mesh = arc((6, 4, 3), 0.6)
    low = np.arange(mesh.node_count)
    centre = low[mesh.cells["hex8"]].mean(axis=1)
    place = mapped_lattice(mesh.points, mesh.cells["hex8"])
    assert place is not None
    first = place.place[mesh.cells["hex8"][:, 0]]
    cells = mesh.cells["hex8"][(first[:, 0] < 2) | (first[:, 1] < 2)]
    assert len(cells) < len(centre)
    used, cells = np.unique(cells, return_inverse=True)
    return Mesh(mesh.points[used], {"hex8": cells.reshape(-1, 8).astype(np.int32)})


@pytest.mark.parametrize(
    ("make", "shape"),
    [
        (lambda: uneven_bricks(10.0, 5), (6, 6, 6)),
        (lambda: shuffled(uneven_bricks(10.0, 5)), (6, 6, 6)),
        (lambda: arc((20, 4, 3)), (21, 5, 4)),
        (bent_corner, (7, 5, 4)),
    ],
)
def test_cells_are_numbered_along_their_axes(
    make: Callable[[], Mesh], shape: tuple[int, int, int]
) -> None:
    mesh = make()
    cells = mesh.cells["hex8"]
    lattice = mapped_lattice(mesh.points, cells)
    assert lattice is not None and lattice.node.shape == shape
    at, nodes = lattice.corner_nodes()
    assert (nodes == cells[lattice.cell.ravel()[at]]).all()
    assert (lattice.node[tuple(lattice.place.T)] == np.arange(mesh.node_count)).all()
    assert all((np.diff(one) > 0.0).all() for one in lattice.planes)


def test_sheets_lie_at_their_mean_distances() -> None:
    mesh = arc((10, 4, 5), 1.0)
    lattice = mapped_lattice(mesh.points, mesh.cells["hex8"])
    assert lattice is not None
    chord = 4.5 * 2.0 * np.sin(0.05)  # of the mean radius
    assert np.allclose(np.diff(lattice.planes[0]), chord, rtol=2e-3)
    assert np.allclose(np.diff(lattice.planes[2]), 0.2, rtol=1e-12)


def ring() -> Mesh:
    """A closed one: its first cell lies against its last."""
    mesh = arc((24, 2, 2), 2.0 * np.pi)
    flat = np.round(mesh.points, 9)
    _, first, cells = np.unique(flat, axis=0, return_index=True, return_inverse=True)
    block = cells.ravel()[mesh.cells["hex8"]].astype(np.int32)
    return Mesh(mesh.points[first], {"hex8": block})


def two_bodies() -> Mesh:
    one = uneven_bricks(10.0, 4)
    cells = one.cells["hex8"]
    points = np.concatenate([one.points, one.points + 20.0])
    return Mesh(points, {"hex8": np.concatenate([cells, cells + one.node_count])})


def turned_cell() -> Mesh:
    mesh = uneven_bricks(10.0, 4)
    cells = mesh.cells["hex8"].copy()
    cells[17] = cells[17][[1, 2, 3, 0, 5, 6, 7, 4]]
    return Mesh(mesh.points, {"hex8": cells})


def unlike_cells() -> Mesh:
    """Cells at one end ten times as long as at the other, as thick everywhere."""
    mesh = box((1.0, 1.0, 1.0), (12, 6, 6))
    return mesh.moved((mesh.points**8 - mesh.points) * 0.9 * np.array([1.0, 0.0, 0.0]))


def far_beside() -> Mesh:
    mesh = box((1.0, 1.0, 1.0), (6, 6, 6))
    zigzag = np.round(mesh.points[:, 0] * 6) % 2
    return mesh.moved(np.outer(zigzag, [0.0, 0.1, 0.0]))


@pytest.mark.parametrize("make", [ring, two_bodies, turned_cell, unlike_cells, far_beside])
def test_what_has_no_such_numbers_or_isnt_fit_is_refused(make: Callable[[], Mesh]) -> None:
    mesh = make()
    assert mapped_lattice(mesh.points, mesh.cells["hex8"]) is None


def test_sums_along_the_paths_of_a_tree() -> None:
    before = np.array([-9999, 0, 1, 2, 3, 1, -9999], dtype=np.int32)
    steps = np.array([9, 1, 10, 100, 1000, 5, 7])
    assert along_paths(before, steps).tolist() == [0, 1, 11, 111, 1111, 6, 0]


def pulled(mesh: Mesh) -> Model:
    fixed = np.zeros(mesh.points.shape, dtype=bool)
    fixed[mesh.cells["hex8" if "hex8" in mesh.cells else "hex20"][0, 0]] = True
    low = mesh.points[:, 2] <= mesh.points[:, 2].min() + 1e-9
    fixed[low] = True
    return Model(mesh, [Isotropic(1.0, 0.3)], fixed, RNG.normal(size=mesh.points.shape))


def test_coarse_matrices_are_galerkins() -> None:
    model = pulled(uneven_bricks(10.0, 12))
    parts = assemble(model, resolve_formulation(model, None))
    system = replace(make_system(model, parts), scale=1.0)
    hierarchy = build_hierarchy(parts, system, model.mesh.points)
    first, second = hierarchy.levels[:2]
    assert isinstance(first.transfer, NodeTransfer)
    assert isinstance(first.transfer.interpolation, PlaneWeights)
    p = first.transfer.matrix.tocsr()
    wanted = (p.T @ block_matrix(parts.rows).tocsr() @ p).toarray()
    found = second.product.matrix.toarray()
    assert np.abs(found - wanted).max() <= 1e-12 * np.abs(wanted).max()


@pytest.mark.parametrize("make", [lambda: uneven_bricks(1.0, 10), lambda: arc((24, 8, 8))])
def test_their_solution_is_that_of_a_direct_solver(
    make: Callable[[], Mesh], device: Device
) -> None:
    model = pulled(make())
    wanted = solve(model, method="direct", tolerance=1e-9).u
    for backend in ("numpy", "gpu"):
        found = solve(
            model, method="multigrid", tolerance=1e-8, backend=backend,
            device=device if backend == "gpu" else None,
        )  # fmt: skip
        assert found.converged and found.iterations <= 20
        assert np.abs(found.u - wanted).max() <= 1e-8 * np.abs(wanted).max()


def test_quadratic_bricks_have_such_levels_below_their_midsides() -> None:
    model = pulled(quadratic(uneven_bricks(1.0, 7)))
    wanted = solve(model, method="direct", tolerance=1e-9).u
    found = solve(model, method="multigrid", tolerance=1e-8, backend="numpy")
    assert found.converged and np.abs(found.u - wanted).max() <= 1e-8 * np.abs(wanted).max()


def test_stiff_parts_between_soft_ones_are_left_to_aggregation() -> None:
    mesh = uneven_bricks(1.0, 10)
    centre = mesh.points[mesh.cells["hex8"]].mean(axis=1)
    inside = (np.linalg.norm(centre - 0.5, axis=1) < 0.3).astype(np.int32)
    model = pulled(mesh)
    model = Model(
        mesh, [Isotropic(1.0, 0.3), Isotropic(1e6, 0.3)], model.fixed, model.forces,
        material_of_cell=inside,
    )  # fmt: skip
    found = solve(model, method="multigrid", tolerance=1e-6, backend="numpy")
    assert found.converged and found.iterations <= 25


def test_sheets_of_long_moved_bars_are_left_to_aggregates(monkeypatch: pytest.MonkeyPatch) -> None:
    """A cell's rotation is misled by its moved nodes, and the end of a long bar turns far."""
    bar = box((160.0, 8.0, 8.0), (160, 8, 8))
    move = np.random.default_rng(5).uniform(-0.12, 0.12, bar.points.shape)
    mesh = bar.moved(move)
    fixed = np.repeat(bar.points[:, :1] == 0.0, 3, axis=1)
    forces = np.zeros(mesh.points.shape)
    forces[bar.points[:, 0] == 160.0] = [0.1, 1.0, -0.3]
    model = Model(mesh, [Isotropic(210e3, 0.3)], fixed=fixed, forces=forces)
    lattice = mapped_lattice(mesh.points, mesh.cells["hex8"])
    assert lattice is not None
    weights = coarse_lattice(lattice)
    assert weights is not None and hierarchy._bent(weights, mesh.points)
    found = solve(model, tolerance=1e-6, method="multigrid", backend="numpy")
    monkeypatch.setattr(hierarchy, "_bent", lambda *_: False)
    by_sheets = solve(model, tolerance=1e-6, method="multigrid", backend="numpy")
    assert found.iterations <= by_sheets.iterations / 2
    exact = solve(model, method="direct").u
    for u, estimate in ((one.u, one.error_estimate) for one in (found, by_sheets)):
        assert np.linalg.norm(u - exact) / np.linalg.norm(exact) <= estimate <= 1e-6


def test_sheets_of_smoothly_bent_bars_are_kept() -> None:
    mesh = arc((60, 8, 8), 6.0)
    lattice = mapped_lattice(mesh.points, mesh.cells["hex8"])
    assert lattice is not None
    weights = coarse_lattice(lattice)
    assert weights is not None and not hierarchy._bent(weights, mesh.points)
