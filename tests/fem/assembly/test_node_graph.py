"""Node numbers along a curve: neighbours close together, and the same answers."""

from __future__ import annotations

import numpy as np
import pytest

from gpusim.fem import Isotropic, Model, solve
from gpusim.fem.assembly import node_graph
from gpusim.fem.assembly.element_batches import DistinctGroup, model_groups
from gpusim.fem.assembly.node_graph import Numbering
from gpusim.mesh import Mesh, box, split

STEEL = Isotropic(2.0, 0.3)


def model(shuffle: bool, move: float = 0.02) -> Model:
    """A clamped block of tetrahedra with two load cases, its nodes in no order if shuffled."""
    rng = np.random.default_rng(2)
    mesh = split(box((1.4, 1.0, 0.7), (13, 10, 7)), "tet4")
    mesh = mesh.moved(move * rng.uniform(-1.0, 1.0, mesh.points.shape))
    order = rng.permutation(mesh.node_count) if shuffle else np.arange(mesh.node_count)
    place = np.empty_like(order)
    place[order] = np.arange(len(order))
    points = mesh.points[order]
    fixed = np.zeros(points.shape, dtype=bool)
    fixed[points[:, 0] < 0.06] = True
    prescribed = np.where(fixed, 0.01 * points, 0.0)
    forces = np.where(fixed, 0.0, rng.normal(size=(2, *points.shape)) * 1e-4)
    soft = np.arange(mesh.cell_count) % 2
    return Model(
        Mesh(points, {"tet4": place[mesh.cells["tet4"]]}), [STEEL, Isotropic(0.5, 0.2)],
        fixed=fixed, forces=forces, prescribed=prescribed, material_of_cell=soft,
    )  # fmt: skip


@pytest.fixture(autouse=True)
def _small(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(node_graph, "_FEW", 100)


def test_neighbours_lie_close_together() -> None:
    shuffled = model(True)
    better = Numbering.of(shuffled)
    assert better is not None
    renumbered = better.renumbered(shuffled)
    cells, before = renumbered.mesh.cells["tet4"], shuffled.mesh.cells["tet4"]
    reach, reach_before = (np.ptp(one, axis=1).mean() for one in (cells, before))
    assert reach < 0.35 * reach_before
    np.testing.assert_array_equal(renumbered.mesh.points[cells], shuffled.mesh.points[before])
    assert Numbering.of(renumbered) is None


def test_good_numbers_stay_and_so_do_repeating_cells() -> None:
    assert Numbering.of(model(False)) is None
    assert Numbering.of(model(True, move=0.0)) is None


def test_a_few_equal_cells_among_many_keep_no_bad_numbers() -> None:
    shuffled = model(True)
    points = shuffled.mesh.points.copy()
    regular = model(True, move=0.0).mesh.points
    part = points[:, 0] > 1.05
    points[part] = regular[part]
    mixed = Model(Mesh(points, shuffled.mesh.cells), [STEEL], fixed=shuffled.fixed)
    assert Numbering.of(mixed) is not None
    groups = model_groups(mixed, {"tet4": "full"})
    assert [type(one) for one in groups] == [DistinctGroup]


def test_the_answer_is_in_the_models_own_numbers(monkeypatch: pytest.MonkeyPatch) -> None:
    shuffled = model(True)
    found = solve(shuffled, tolerance=1e-10, method="multigrid", backend="numpy")
    with monkeypatch.context() as own:
        own.setattr(Numbering, "of", staticmethod(lambda model: None))
        wanted = solve(shuffled, tolerance=1e-10, method="multigrid", backend="numpy")
    assert found.model is shuffled
    size = np.abs(wanted.u).max()
    np.testing.assert_allclose(found.u, wanted.u, atol=1e-9 * size)
    np.testing.assert_allclose(
        found.reactions, wanted.reactions, atol=1e-8 * np.abs(wanted.reactions).max()
    )
    assert (np.asarray(found.u)[:, shuffled.fixed] != 0.0).any()
    # and so is a start: one iteration tells that the answer is the answer
    again = solve(shuffled, method="multigrid", backend="numpy", start=wanted.u)
    assert again.converged and again.iterations == 1 < found.iterations
