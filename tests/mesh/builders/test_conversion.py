"""Quadratic meshes of linear ones, and bricks split into tetrahedra and wedges."""

from __future__ import annotations

import numpy as np
import pytest

from gpusim.errors import InputError
from gpusim.mesh import (
    CELL_TYPES,
    Mesh,
    boundary_faces,
    box,
    mesh_quality,
    quadratic,
    set_faces,
    split,
)

SIZE = (0.7, 0.3, 1.1)


def volume(mesh: Mesh) -> float:
    """By the divergence theorem over the boundary: also fails if a face has no partner."""
    faces = boundary_faces(mesh)
    return float(np.einsum("fi,fi->", faces.centroids, faces.area_vectors)) / 3.0


def brick() -> Mesh:
    """Nodes in a random order, so that no rule may lean on their numbers; sets of every kind."""
    grid = box(SIZE, (3, 2, 4))
    order = np.random.default_rng(5).permutation(grid.node_count)
    points = np.empty_like(grid.points)
    points[order] = grid.points
    cells = order[grid.cells["hex8"]]
    side = order[np.flatnonzero(grid.points[:, 0] == 0.0)]
    sets = {"some": np.array([1, 5, 20], np.int32)}
    return Mesh(points, {"hex8": cells}, {"left": side}, grid.face_sets, sets)


def mixed() -> Mesh:
    """A hexahedron with a pyramid on top and a wedge beside it."""
    points = np.array([
        [0, 0, 0], [1.1, 0, 0], [1.2, 0.9, 0], [0, 0.8, 0], [0, 0, 1], [1.1, 0, 1], [1.2, 0.9, 1],
        [0, 0.8, 1], [0.6, 0.4, 1.7], [2.0, 0.4, 0], [2.0, 0.4, 1],
    ])  # fmt: skip
    return Mesh(
        points,
        {
            "hex8": np.array([[0, 1, 2, 3, 4, 5, 6, 7]]),
            "pyramid5": np.array([[4, 5, 6, 7, 8]]),
            "wedge6": np.array([[1, 9, 2, 5, 10, 6]]),
        },
    )


@pytest.mark.parametrize("serendipity", [True, False])
def test_bricks_become_quadratic_with_shared_midside_nodes(serendipity: bool) -> None:
    mesh = brick()
    fine = quadratic(mesh, serendipity)
    kind = "hex20" if serendipity else "hex27"
    # a grid of 3 x 2 x 4 has this many edges and faces
    edges = 3 * 3 * 5 + 4 * 2 * 5 + 4 * 3 * 4
    faces = 4 * 2 * 4 + 3 * 3 * 4 + 3 * 2 * 5
    assert fine.node_count == 60 + edges + (0 if serendipity else faces + 24)
    np.testing.assert_array_equal(fine.points[:60], mesh.points)
    np.testing.assert_array_equal(fine.cells[kind][:, :8], mesh.cells["hex8"])
    for column, group in enumerate(CELL_TYPES[kind].parents, start=8):
        middle = fine.points[fine.cells[kind][:, list(group)]].mean(axis=1)
        np.testing.assert_allclose(fine.points[fine.cells[kind][:, column]], middle, atol=1e-15)
    assert volume(fine) == pytest.approx(0.7 * 0.3 * 1.1, rel=1e-14)
    assert {name: len(pairs) for name, pairs in fine.face_sets.items()} == {
        name: len(pairs) for name, pairs in mesh.face_sets.items()
    }
    np.testing.assert_array_equal(fine.cell_sets["some"], mesh.cell_sets["some"])


def test_new_nodes_join_the_node_sets_of_their_corners() -> None:
    fine = quadratic(brick())
    np.testing.assert_array_equal(
        np.sort(fine.node_sets["left"]), np.flatnonzero(fine.points[:, 0] == 0.0)
    )


def test_mixed_meshes_stay_conforming() -> None:
    mesh = quadratic(mixed())
    assert {kind: block.shape for kind, block in mesh.cells.items()} == {
        "hex20": (1, 20), "pyramid13": (1, 13), "wedge15": (1, 15),
    }  # fmt: skip
    assert mesh.node_count == 11 + 12 + 4 + 5
    assert volume(mesh) == pytest.approx(volume(mixed()), rel=1e-14)
    assert len(boundary_faces(mesh)) == len(boundary_faces(mixed()))


@pytest.mark.parametrize(("kind", "parts"), [("tet4", 6), ("wedge6", 2)])
def test_bricks_split_conforming_with_their_sets(kind: str, parts: int) -> None:
    mesh = box(SIZE, (3, 2, 4)).with_sets(cell_sets={"some": np.array([1, 5, 20], np.int32)})
    fine = split(mesh, kind)
    assert fine.cells[kind].shape == (24 * parts, CELL_TYPES[kind].nodes)
    assert volume(fine) == pytest.approx(0.7 * 0.3 * 1.1, rel=1e-14)
    np.testing.assert_array_equal(fine.points, mesh.points)
    for name in mesh.face_sets:
        before, after = (set_faces(m, m.face_sets[name]) for m in (mesh, fine))
        assert after.areas.sum() == pytest.approx(before.areas.sum(), rel=1e-14)
        np.testing.assert_array_equal(after.node_numbers(), before.node_numbers())
    expected = [parts * n + k for n in (1, 5, 20) for k in range(parts)]
    np.testing.assert_array_equal(fine.cell_sets["some"], expected)


def test_tets_of_any_numbering_and_of_mixed_cells_conform() -> None:
    for mesh, count in ((brick(), 6 * 24), (mixed(), 6 + 2 + 3)):
        fine = split(mesh, "tet4")
        assert len(fine.cells["tet4"]) == count
        assert volume(fine) == pytest.approx(volume(mesh), rel=1e-14)
        assert boundary_faces(fine).is_triangle.all()
        # each quadrilateral of the boundary is two triangles: no diagonals cross inside
        before = boundary_faces(mesh).is_triangle
        assert len(boundary_faces(fine)) == before.sum() + 2 * (~before).sum()


def test_wedges_whose_cuts_cross_are_refused() -> None:
    grid = box(SIZE, (3, 2, 4))
    cells = grid.cells["hex8"].copy()
    cells[7] = cells[7, [1, 2, 3, 0, 5, 6, 7, 4]]  # turned a quarter: cut along the other diagonal
    with pytest.raises(InputError, match="don't meet"):
        split(Mesh(grid.points, {"hex8": cells}), "wedge6")
    assert len(split(Mesh(grid.points, {"hex8": cells}), "tet4").cells["tet4"]) == 144


def test_tets_become_quadratic_too() -> None:
    fine = quadratic(split(box(SIZE, (2, 1, 1))), serendipity=False)
    assert fine.cells["tet10"].shape == (12, 10)
    assert fine.node_count == 5 * 3 * 3
    assert mesh_quality(fine).scaled_jacobian.min() > 0.1


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: quadratic(quadratic(brick())), "hex20, of which there are 24, is quadratic"),
        (lambda: quadratic(mixed(), serendipity=False), "pyramid5, of which there are 1"),
        (lambda: split(quadratic(brick())), "24 cells are hex20"),
        (lambda: split(mixed(), "wedge6"), "1 cells are pyramid5"),
        (lambda: split(brick(), "tet10"), "got 'tet10'"),
    ],
)
def test_what_cannot_be_converted_is_refused(make: object, words: str) -> None:
    with pytest.raises(InputError, match=words):
        make()  # type: ignore[operator]
