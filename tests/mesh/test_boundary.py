"""Boundary faces and cell quality of meshes of every type."""

from __future__ import annotations

import re

import numpy as np
import numpy.typing as npt
import pytest

from gpusim.errors import InputError
from gpusim.fem.elements.element import face_groups
from gpusim.mesh import CELL_TYPES, Mesh, boundary_faces, mesh_quality, select_faces, set_faces
from gpusim.mesh.shape_functions import reference_nodes
from tests.support.element_meshes import (
    SERENDIPITY,
    SIZE,
    linear_mesh,
    mesh_of,
    mixed_mesh,
    shaken,
    with_middles,
)

Float = npt.NDArray[np.float64]
KINDS = tuple(CELL_TYPES)
BOX_AREA = 2.0 * (SIZE[0] * SIZE[1] + SIZE[1] * SIZE[2] + SIZE[2] * SIZE[0])
QUADRATIC_MIX = with_middles(mixed_mesh(0.05), SERENDIPITY)


@pytest.mark.parametrize("mesh", [*(mesh_of(k, amount=0.06) for k in KINDS), mixed_mesh(0.06),
                                  QUADRATIC_MIX])  # fmt: skip
def test_the_boundary_of_a_box_is_its_six_sides(mesh: Mesh) -> None:
    faces = boundary_faces(mesh)
    widths = {4, 8, 9} & {CELL_TYPES[kind].faces.shape[1] for kind in mesh.cells}
    assert faces.nodes.shape[1] == max(widths)
    assert faces.areas.sum() == pytest.approx(BOX_AREA, rel=1e-13)
    np.testing.assert_allclose(faces.area_vectors.sum(axis=0), 0.0, atol=1e-13)
    for axis, (word, sign) in enumerate((("+x", 1.0), ("+y", 1.0), ("+z", 1.0))):
        side = select_faces(mesh, normal=word, faces=faces)
        normal = np.zeros(3)
        normal[axis] = sign
        np.testing.assert_allclose(side.normals, np.tile(normal, (len(side), 1)), atol=1e-13)
        assert side.areas.sum() == pytest.approx(np.prod(SIZE) / SIZE[axis], rel=1e-13)
        on_side = np.flatnonzero(np.abs(mesh.points[:, axis] - SIZE[axis]) < 1e-12)
        np.testing.assert_array_equal(side.node_numbers(), on_side)
        again = set_faces(mesh, side.pairs())
        np.testing.assert_array_equal(again.nodes, side.nodes)


@pytest.mark.parametrize("mesh", [*(mesh_of(k, amount=0.06, bulge=0.03) for k in KINDS),
                                  QUADRATIC_MIX])  # fmt: skip
def test_curved_faces_still_close_every_cell(mesh: Mesh) -> None:
    """Vector areas of a cell's faces add up to zero, whatever their curvature."""
    pairs = [
        (first + cell, local)
        for kind, first, block in mesh.blocks()
        for cell in range(len(block))
        for local in range(len(CELL_TYPES[kind].faces))
    ]
    faces = set_faces(mesh, np.array(pairs))
    total = np.zeros((mesh.cell_count, 3))
    np.add.at(total, faces.cell, faces.area_vectors)
    np.testing.assert_allclose(total, 0.0, atol=1e-14)


def test_a_curved_face_has_its_true_area_and_normal() -> None:
    # one tet10 whose slanted face's midsides are pushed out along its normal
    nodes = reference_nodes("tet10").copy()
    nodes[[5, 8, 9]] += 0.1
    mesh = Mesh(nodes, {"tet10": np.arange(10)[None]})
    faces = boundary_faces(mesh)
    fine = subdivided_area(nodes[[1, 2, 3, 5, 9, 8]])
    slanted = int(np.argmax(faces.areas))
    assert faces.local[slanted] == 2
    assert faces.areas[slanted] == pytest.approx(fine, rel=2e-3)
    assert faces.areas[slanted] > 1.03 * np.sqrt(3.0) / 2.0  # more than the flat triangle
    np.testing.assert_allclose(faces.normals[slanted], np.full(3, 3.0**-0.5), atol=1e-14)
    np.testing.assert_allclose(faces.centroids[slanted], 1 / 3, rtol=1e-14)


def subdivided_area(nodes: Float, n: int = 60) -> float:
    """Area of a tri6 face (corners, midsides) by many small triangles."""
    from gpusim.mesh.shape_functions import shape_functions

    i, j = np.meshgrid(np.arange(n + 1), np.arange(n + 1), indexing="ij")
    keep = i + j <= n
    place = shape_functions("tri6", np.stack([i[keep], j[keep]], axis=1) / n) @ nodes
    number = np.full((n + 2, n + 2), -1)
    number[:-1, :-1][keep] = np.arange(len(place))
    total = 0.0
    for a, b in zip(*np.nonzero(i + j < n), strict=True):
        corners = place[[number[a, b], number[a + 1, b], number[a, b + 1]]]
        total += 0.5 * np.linalg.norm(np.cross(corners[1] - corners[0], corners[2] - corners[0]))
        if number[a + 1, b + 1] >= 0:
            corners = place[[number[a + 1, b], number[a + 1, b + 1], number[a, b + 1]]]
            edges = corners[1] - corners[0], corners[2] - corners[0]
            total += 0.5 * np.linalg.norm(np.cross(*edges))
    return float(total)


def test_quadratic_beside_linear_cells_are_refused() -> None:
    points, cells = linear_mesh("hex8", (2, 1, 1)).points, linear_mesh("hex8", (2, 1, 1)).cells
    left = with_middles(Mesh(points, {"hex8": cells["hex8"][:1]}), {"hex8": "hex20"})
    with pytest.raises(InputError, match="midside nodes; got for example cells 0 and 1"):
        Mesh(left.points, {"hex20": left.cells["hex20"], "hex8": cells["hex8"][1:]})
    # midside nodes that were never merged: the same places, but other numbers
    whole = with_middles(Mesh(points, cells), {"hex8": "hex20"})
    split = whole.cells["hex20"].copy()
    shared = np.intersect1d(split[0, 8:], split[1, 8:])
    assert len(shared) == 4
    copies = dict(zip(shared.tolist(), range(whole.node_count, whole.node_count + 4), strict=True))
    split[1] = [copies.get(int(node), int(node)) for node in split[1]]
    with pytest.raises(InputError, match=re.escape("1 pairs of neighbours share the corners")):
        Mesh(np.concatenate([whole.points, whole.points[shared]]), {"hex20": split})
    assert len(boundary_faces(whole)) == 10
    assert boundary_faces(whole) is boundary_faces(whole)
    assert boundary_faces(whole.moved(np.ones(whole.points.shape))).points[0, 0] == 1.0


def test_a_triangle_never_matches_a_quadrilateral() -> None:
    """A hex's side against two tets has a gap along the diagonal: both sides stay boundary."""
    mesh = linear_mesh("hex8", (1, 1, 1))
    face = CELL_TYPES["hex8"].faces[3]
    a, b, c, d = mesh.cells["hex8"][0][face]
    apex = mesh.node_count
    tets = [[a, b, c, apex], [a, c, d, apex]]
    both = Mesh(
        np.concatenate([mesh.points, [[2.0, 0.4, 0.6]]]), {**mesh.cells, "tet4": np.array(tets)}
    )
    faces = boundary_faces(both)
    assert (faces.is_triangle.sum(), (~faces.is_triangle).sum()) == (6, 6)
    quality = mesh_quality(both)
    assert quality.gaps.tolist() == [0]
    assert "such as 0, lie with a quadrilateral side against triangles" in quality.describe()
    for whole in (mixed_mesh(), QUADRATIC_MIX, mesh_of("wedge6")):
        assert mesh_quality(whole).gaps.size == 0


@pytest.mark.parametrize("kind", KINDS)
def test_inverted_cells_are_named_by_number(kind: str) -> None:
    good = mesh_of(kind, (2, 1, 1))
    cells = good.cells[kind].copy()
    mirrored = CELL_TYPES[kind]
    # swap the two corners of an edge and leave the rest: a cell turned inside out
    turned = reference_nodes(kind) * [1.0, 1.0, -1.0]
    points = np.concatenate([good.points, 0.1 * turned + 5.0])
    new = np.arange(good.node_count, good.node_count + mirrored.nodes)
    with pytest.raises(
        InputError, match=rf"1 inverted or zero-volume cells; got cells {len(cells)}"
    ):
        Mesh(points, {kind: np.concatenate([cells, new[None]])})


def test_a_midside_node_too_far_out_is_refused() -> None:
    for kind, node in (("hex20", 8), ("tet10", 4), ("wedge15", 6), ("pyramid13", 5)):
        nodes = reference_nodes(kind).copy()
        assert mesh_quality(Mesh(nodes, {kind: np.arange(len(nodes))[None]})).aspect[0] < 2.5
        nodes[node] += 1.5 * (nodes[1] - nodes[0])  # along its edge, past the corner
        with pytest.raises(InputError, match="inverted"):
            Mesh(nodes, {kind: np.arange(len(nodes))[None]})


def test_quality_of_perfect_cells() -> None:
    tet = np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]], dtype=float)
    flat = np.array([[0, 0], [1, 0], [0.5, 3.0**0.5 / 2]])
    wedge = np.concatenate([np.c_[flat, np.zeros(3)], np.c_[flat, np.ones(3)]])
    cube = 0.5 * reference_nodes("hex8")
    for linear, nodes, jacobian in (
        ("tet4", tet[[0, 2, 1, 3]], 2.0**-0.5),
        ("wedge6", wedge, 3.0**0.5 / 2),
        ("hex8", cube, 1.0),
    ):
        mesh = Mesh(nodes, {linear: np.arange(len(nodes))[None]})
        forms = [mesh]
        for kind in KINDS:
            if CELL_TYPES[kind].linear == linear and kind != linear:
                forms.append(with_middles(mesh, {linear: kind}))
        assert len(forms) >= 2
        for form in forms:
            quality = mesh_quality(form)
            assert quality.scaled_jacobian[0] == pytest.approx(jacobian, rel=1e-13)
            assert quality.aspect[0] == pytest.approx(1.0, rel=1e-13)
            assert quality.distortion[0] <= 1e-14
            assert quality.bad_cells().size == 0


def test_quality_sees_stretched_cells_and_curved_ones() -> None:
    points = mesh_of("hex8", (2, 2, 2)).points * [1000.0, 1.0, 1.0]
    quality = mesh_quality(Mesh(points, mesh_of("hex8", (2, 2, 2)).cells))
    assert quality.aspect[0] == pytest.approx(500.0 / 0.4)
    assert quality.bad_cells().tolist() == list(range(8))
    straight = mesh_of("tet10", (2, 2, 2))
    curved = Mesh(shaken(straight.points, 0.08, seed=2), straight.cells)
    assert (
        mesh_quality(curved).scaled_jacobian.min()
        < 0.8 * mesh_quality(straight).scaled_jacobian.min()
    )


def test_distorted_bricks_bring_the_advice_to_take_hex20() -> None:
    mesh = linear_mesh("hex8", (4, 1, 1))
    assert mesh_quality(mesh).distorted_bricks().size == 0
    sheared = mesh.points.copy()
    sheared[:, 0] += 0.5 * sheared[:, 2]  # parallelepipeds: no distortion
    quality = mesh_quality(Mesh(sheared, mesh.cells))
    assert quality.distortion.max() <= 1e-14 and "hex20" not in quality.describe()
    trapezoids = mesh.points.copy()
    inner = (trapezoids[:, 0] > 0.1) & (trapezoids[:, 0] < 0.9)
    turn = np.where(np.round(4 * trapezoids[:, 0]) % 2 == 1, 1.0, -1.0)
    trapezoids[inner, 0] += 0.06 * (turn * np.sign(trapezoids[:, 2] - 0.5))[inner]
    bent = mesh_quality(Mesh(trapezoids, mesh.cells))
    # lower edges of an inner cell are longer by 0.12, upper ones shorter: 0.24 of 0.25; times the
    # aspect, the leaning upright edge over the short upper one
    assert bent.distortion[1] == pytest.approx(0.96 * np.hypot(1.3, 0.12) / 0.13)
    assert bent.distorted_bricks().tolist() == [0, 1, 2, 3]
    assert "4 of 4 hex8 are strongly distorted" in bent.describe()
    assert "hex20" in bent.describe()
    quadratic = with_middles(Mesh(trapezoids, mesh.cells), {"hex8": "hex20"})
    assert "hex20" not in mesh_quality(quadratic).describe()


@pytest.mark.parametrize("mesh", [mesh_of("hex27"), QUADRATIC_MIX, mixed_mesh()])
def test_face_elements_integrate_the_area_of_every_kind(mesh: Mesh) -> None:
    faces = boundary_faces(mesh)
    total, seen = 0.0, 0
    for element, rows, nodes in face_groups(faces):
        assert nodes.shape == (len(rows), len(element.columns)) and nodes.min() >= 0
        tangent = np.einsum("fni,qnj->fqij", mesh.points[nodes], element.gradient)
        normal = np.cross(tangent[..., 0], tangent[..., 1]) * element.weight[:, None]
        np.testing.assert_allclose(normal.sum(axis=1), faces.area_vectors[rows], atol=1e-14)
        total += float(np.linalg.norm(normal, axis=2).sum())
        seen += len(rows)
    assert seen == len(faces) and total == pytest.approx(BOX_AREA, rel=1e-13)


def test_cell_sets_are_kept_and_checked() -> None:
    mesh = linear_mesh("hex8", (3, 2, 1)).with_sets(cell_sets={"left": np.array([0, 3])})
    assert mesh.cell_sets["left"].tolist() == [0, 3]
    moved = mesh.moved(np.full(mesh.points.shape, 0.5)).with_sets({"a": np.array([1])})
    assert moved.cell_sets["left"].tolist() == [0, 3] and moved.node_sets["a"].tolist() == [1]
    assert not mesh.node_sets and mesh.with_sets().cell_sets.keys() == {"left"}
    with pytest.raises(InputError, match=r"cell_sets\['right'\].*0 … 5"):
        mesh.with_sets(cell_sets={"right": np.array([6])})
