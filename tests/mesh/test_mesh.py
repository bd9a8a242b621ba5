"""Meshes: validation, builders, boundary faces, selections, quality."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest

from gpusim.errors import InputError
from gpusim.mesh import (
    Mesh,
    boundary_faces,
    box,
    crane,
    mesh_quality,
    select_faces,
    select_nodes,
    set_faces,
)

SIZE = (0.7, 0.3, 1.1)


@pytest.fixture(scope="module")
def brick() -> Mesh:
    return box(SIZE, (5, 2, 3), origin=(10.0, -4.0, 2.0))


def tets() -> Mesh:
    """A brick of three unequal edges cut into six tets around one diagonal."""
    corner = np.array([[x, y, z] for z in (0, 1) for y in (0, 1) for x in (0, 1)], dtype=float)
    around = [1, 3, 2, 6, 4, 5]
    cells = [[0, around[k], around[(k + 1) % 6], 7] for k in range(6)]
    return Mesh(corner * SIZE, {"tet4": np.array(cells)})


def test_box_fills_its_bounds_and_its_end_coordinates_are_exact(brick: Mesh) -> None:
    assert brick.cell_count == 30 and brick.node_count == 6 * 3 * 4
    np.testing.assert_array_equal(brick.bounds[0], [10.0, -4.0, 2.0])
    np.testing.assert_array_equal(brick.bounds[1], np.array([10.0, -4.0, 2.0]) + SIZE)


@pytest.mark.parametrize("make", [lambda: box(SIZE, (5, 2, 3)), tets])
def test_boundary_faces_are_closed_outward_and_have_the_right_area(make: object) -> None:
    faces = boundary_faces(make())  # type: ignore[operator]
    a, b, c = SIZE
    assert faces.areas.sum() == pytest.approx(2 * (a * b + b * c + c * a), rel=1e-14)
    np.testing.assert_allclose(faces.area_vectors.sum(axis=0), 0.0, atol=1e-15)
    # divergence theorem with outward normals gives the volume, three times
    flux = np.einsum("fi,fi->", faces.centroids, faces.area_vectors)
    assert flux == pytest.approx(3 * a * b * c, rel=1e-13)


def test_faces_of_sets_are_the_boundary_faces_they_were_taken_from(brick: Mesh) -> None:
    top = select_faces(brick, name="z_max")
    assert len(top) == 10
    np.testing.assert_allclose(top.normals, np.tile([0.0, 0.0, 1.0], (10, 1)), atol=1e-15)
    np.testing.assert_array_equal(set_faces(brick, top.pairs()).nodes, top.nodes)


def test_selections_by_bounds_plane_normal_and_angle(brick: Mesh) -> None:
    left = select_nodes(brick, bounds={"x_max": 10.0})
    np.testing.assert_array_equal(
        left, select_nodes(brick, plane=((10.0, 0.0, 0.0), (-2.0, 0.0, 0.0)))
    )
    assert len(left) == 12
    assert len(select_faces(brick, normal="+y")) == 15
    assert len(select_faces(brick, normal=(0.0, 1.0, 1.0), angle=np.deg2rad(46.0))) == 15 + 10
    assert len(select_faces(brick, bounds={"z_max": 2.4}, normal="-x")) == 2
    np.testing.assert_array_equal(
        select_nodes(brick, normal="-x", bounds={"z_max": 2.4}),
        select_nodes(brick, bounds={"x_max": 10.0, "z_max": 2.4}),
    )


def test_any_kind_of_set_selects_nodes_and_faces(brick: Mesh) -> None:
    row = np.flatnonzero(brick.points[brick.cells["hex8"]][:, :, 0].max(axis=1) <= 10.15)
    left = np.flatnonzero(brick.points[:, 0] == 10.0)
    mesh = brick.with_sets({"left": left}, {}, {"row": row})
    assert len(row) == 6
    np.testing.assert_array_equal(
        select_nodes(mesh, name="row"), select_nodes(mesh, bounds={"x_max": 10.15})
    )
    faces = select_faces(mesh, name="row")
    assert set(faces.cell.tolist()) == set(row.tolist()) and len(faces) == 6 + 4 + 6
    np.testing.assert_array_equal(
        select_faces(mesh, name="left").pairs(), select_faces(mesh, normal="-x").pairs()
    )
    assert len(select_faces(mesh, name="row", normal="-x")) == 6
    with pytest.raises(InputError, match=r"select_faces: .* got 'rov'; .*did you mean 'row'"):
        select_faces(mesh, name="rov")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"bounds": {"x_min": 11.0}}, "x 10 … 10.7"),
        ({"bounds": {"x_mim": 11.0}}, "x_mim"),
        ({"name": "nose"}, "nose"),
        ({"plane": ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))}, "non-zero"),
        ({"bounds": {"x_min": float("nan")}}, "finite"),
    ],
)
def test_empty_or_wrong_selections_say_where_the_mesh_is(
    brick: Mesh, arguments: dict[str, object], words: str
) -> None:
    with pytest.raises(InputError, match=words):
        select_nodes(brick, **arguments)  # type: ignore[arg-type]


def test_crane_has_its_breaks_sets_and_one_piece() -> None:
    mesh = crane(element_size=0.02, across=2)
    quality = mesh_quality(mesh)
    assert quality.scaled_jacobian.min() == pytest.approx(1.0)
    faces = boundary_faces(mesh)
    assert np.einsum("fi,fi->", faces.centroids, faces.area_vectors) / 3 == pytest.approx(
        0.040 * (0.006 * (0.562 + 0.070) + 0.004 * 0.597), rel=1e-12
    )
    load = set_faces(mesh, mesh.face_sets["load"])
    assert load.areas.sum() == pytest.approx(0.108 * 0.040, rel=1e-12)
    assert mesh.points[load.node_numbers(), 0].min() == pytest.approx(0.597 - 0.108, abs=1e-15)
    foot = mesh.points[mesh.node_sets["foot"]]
    assert foot[:, 2].max() == 0.0 and foot[:, 2].min() == -0.070


GOOD = np.array([[0, 0, 0], [2, 0, 0], [0, 3, 0], [0, 0, 4], [9, 9, 9]], dtype=float)


@pytest.mark.parametrize(
    ("points", "cells", "words"),
    [
        (GOOD, {"tet5": [[0, 1, 2, 3]]}, "unknown cell type; got 'tet5'"),
        (GOOD, {"tet4": [[0, 1, 2, 5]]}, "out of range"),
        (GOOD, {"tet4": [[0, 1, 2, 2]]}, "twice"),
        (GOOD, {"tet4": [[0, 1, 2]]}, r"expected \(M,4\)"),
        (GOOD, {"tet4": [[0.0, 1.0, 2.0, 3.0]]}, "integer"),
        (GOOD, {"tet4": [[0, 1, 2, 3], [0, 2, 1, 3]]}, "cells 1"),
        (np.where(GOOD == 4, np.nan, GOOD), {"tet4": [[0, 1, 2, 3]]}, "nodes 3"),
        (GOOD[:, :2], {"tet4": [[0, 1, 2, 3]]}, r"expected \(N,3\)"),
        (GOOD * 1j, {"tet4": [[0, 1, 2, 3]]}, "complex"),
        (GOOD, {"tet4": [[0, 1, 2, 3], [0, 1]]}, "unequal length"),
    ],
)
def test_bad_meshes_are_refused_by_name(
    points: np.ndarray, cells: dict[str, list[list[float]]], words: str
) -> None:
    with pytest.raises(InputError, match=words):
        Mesh(points, cells)  # type: ignore[arg-type]


def test_inverted_cells_are_listed_up_to_five(brick: Mesh) -> None:
    cells = brick.cells["hex8"].copy()
    cells[4:12] = cells[4:12, [4, 5, 6, 7, 0, 1, 2, 3]]
    with pytest.raises(InputError, match=r"8 inverted .* cells 4, 5, 6, 7, 8, …"):
        Mesh(brick.points, {"hex8": cells})


def test_dangling_nodes_are_reported() -> None:
    mesh = Mesh(GOOD, {"tet4": np.array([[0, 1, 2, 3]])})
    np.testing.assert_array_equal(mesh.dangling_nodes, [4])


def test_quality_names_the_flat_cell(brick: Mesh) -> None:
    points = brick.points.copy()
    cells = brick.cells["hex8"]
    # the last corner of the mesh belongs to one cell only
    corner = int(np.argmax(points.sum(axis=1)))
    points[corner] += [-0.03, -0.03, -0.1]
    quality = mesh_quality(Mesh(points, {"hex8": cells}))
    owner = np.flatnonzero((cells == corner).any(axis=1))
    assert owner.tolist() == [29]
    np.testing.assert_array_equal(quality.bad_cells(least_jacobian=0.8), owner)
    assert "30 cells" in quality.describe()


@pytest.mark.parametrize(
    ("size", "divisions", "words"),
    [
        ((1.0, 2.0, float("nan")), (1, 2, 3), "size"),
        ("abc", (1, 2, 3), "size"),
        ((1.0, 2.0, 3.0), (1, 2, float("nan")), "divisions; got nan"),
        ((1.0, 2.0, 3.0), (1, 2, float("inf")), "divisions; got inf"),
        ((1.0, 2.0, 3.0), (1, 2, "3"), "divisions; got 3"),
        ((1.0, 2.0, 3.0), (1, 2.5, 3), "divisions; got 2.5"),
    ],
)
def test_bad_boxes(size: Any, divisions: Any, words: str) -> None:
    with pytest.raises(InputError, match=words):
        box(size, divisions)


def test_a_slender_crane_takes_memory_for_its_members_only() -> None:
    # the rectangle around it has 1.3e9 nodes: 31 GB
    mesh = crane(foot=0.07, element_size=5e-5, through=1, across=1)
    along = (0.07 + mesh.bounds[1][2] + mesh.bounds[1][0]) / 5e-5
    assert abs(mesh.cell_count / along - 1.0) <= 0.2
    assert len(mesh.points) == 4 * (mesh.cell_count + 1)


def test_names_are_told_by_number() -> None:
    mesh = box(size=(1, 1, 1), divisions=(1, 1, 1))
    names = {f"face_{number}": np.zeros(1, np.int32) for number in range(1, 12)}
    mesh = dataclasses.replace(mesh, node_sets=names)
    with pytest.raises(
        InputError, match=r"expected one of face_1, face_2, .*face_9, face_10, face"
    ):
        select_nodes(mesh, name="hole")
