"""The skin of meshes of every type: pieces, vertices shared by neighbours, location."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

from gpusim.errors import InputError
from gpusim.mesh import CELL_TYPES, Mesh, boundary_faces, select_faces
from gpusim.surface import Skin
from gpusim.surface.paint import Plain
from gpusim.surface.surface import face_normals
from tests.support.element_meshes import SERENDIPITY, SIZE, mesh_of, mixed_mesh, with_middles

Float = npt.NDArray[np.float64]
KINDS = tuple(CELL_TYPES)
BOX_AREA = 2.0 * (SIZE[0] * SIZE[1] + SIZE[1] * SIZE[2] + SIZE[2] * SIZE[0])
MESHES = [
    *(mesh_of(kind) for kind in KINDS), mixed_mesh(), with_middles(mixed_mesh(), SERENDIPITY),
]  # fmt: skip


def curved(kind: str) -> Mesh:
    """The box bent to a quarter of a ring, midsides on the bent surface."""
    straight = mesh_of(kind, (4, 2, 2))
    x, y, z = straight.points.T
    angle, radius = 0.5 * np.pi * x, 2.0 + z
    return Mesh(
        np.stack([radius * np.sin(angle), y, radius * np.cos(angle)], axis=1), straight.cells
    )


@pytest.mark.parametrize("mesh", MESHES)
@pytest.mark.parametrize("n", [1, 2, 3])
def test_pieces_cover_the_box_without_gaps(mesh: Mesh, n: int) -> None:
    faces = boundary_faces(mesh)
    skin = Skin(mesh, faces, n)
    expected = np.where(faces.is_quadratic, n * n, 1)
    np.testing.assert_array_equal(np.bincount(skin.face_of_piece), expected)
    np.testing.assert_array_equal(skin.cell_of_piece, faces.cell[skin.face_of_piece])
    points = skin.at_vertices(mesh.points)
    normals = face_normals(points, skin.pieces)
    assert np.linalg.norm(normals, axis=1).sum() == pytest.approx(BOX_AREA, rel=1e-13)
    # every piece looks where its face looks
    own = faces.normals[skin.face_of_piece]
    assert np.abs(np.cross(normals, own)).max() <= 1e-13 and (normals * own).sum(axis=1).min() > 0
    # watertight: each edge belongs to two pieces, once in each direction
    edges = set()
    for piece in skin.pieces.tolist():
        ring = [corner for corner in piece if corner >= 0]
        for edge in zip(ring, ring[1:] + ring[:1], strict=True):
            assert edge not in edges
            edges.add(edge)
    assert all((b, a) in edges for a, b in edges)
    # no vertex twice
    assert len(np.unique(np.round(points, 9), axis=0)) == len(points)


@pytest.mark.parametrize("kind", ["hex20", "hex27", "tet10", "wedge15"])
def test_two_subdivisions_take_the_nodes_themselves(kind: str) -> None:
    mesh = mesh_of(kind)
    skin = Skin(mesh, boundary_faces(mesh), 2)
    points = skin.at_vertices(mesh.points)
    nodes = len(skin.nodes)
    np.testing.assert_array_equal(points[:nodes], mesh.points[skin.nodes])
    # beside the nodes only the middle of each 8-noded face
    eight = sum(name == "quad8" for name, rows in skin.faces.kinds() for _ in rows)
    assert len(points) == nodes + eight
    assert (eight > 0) == (kind in ("hex20", "wedge15"))


@pytest.mark.parametrize("kind", ["hex20", "hex27", "tet10", "wedge15", "pyramid13"])
def test_finer_pieces_approach_the_curved_surface(kind: str) -> None:
    mesh = curved(kind)
    faces = boundary_faces(mesh)
    errors = []
    for n in (1, 2, 4):
        skin = Skin(mesh, faces, n)
        normals = face_normals(skin.at_vertices(mesh.points), skin.pieces)
        errors.append(abs(np.linalg.norm(normals, axis=1).sum() - faces.areas.sum()))
    assert errors[1] < 0.35 * errors[0] and errors[2] < 0.35 * errors[1]


@pytest.mark.parametrize("mesh", [MESHES[KINDS.index("tet10")], MESHES[-1], MESHES[-2]])
def test_a_nodal_field_moves_the_pieces(mesh: Mesh) -> None:
    skin = Skin(mesh, boundary_faces(mesh))
    region = np.zeros(len(skin.faces), np.int32)
    region[skin.numbers(select_faces(mesh, normal="+z"))] = 1
    paints = {"rest": Plain(0.5), "top": Plain(0.8)}
    surface = skin.surface(paints, region, {}, "body")
    top = surface.rest[surface.faces[surface.regions == 1]][:, :3]
    assert np.abs(top[..., 2] - SIZE[2]).max() <= 1e-12
    linear = mesh.points @ np.diag([0.01, -0.02, 0.03]) + [1.0, 2.0, 3.0]
    moved = skin.moved(surface, linear)
    expected = surface.rest @ np.diag([1.01, 0.98, 1.03]) + [1.0, 2.0, 3.0]
    np.testing.assert_allclose(moved.points, expected, atol=1e-13)
    np.testing.assert_array_equal(moved.rest, surface.rest)


@pytest.mark.parametrize(
    "kind", ["hex8", "tet4", "hex20", "hex27", "tet10", "wedge15", "pyramid13"]
)
def test_locate_finds_points_with_the_shape_functions_of_their_face(kind: str) -> None:
    mesh = mesh_of(kind, (3, 2, 2))
    skin = Skin(mesh, boundary_faces(mesh))
    points = np.array(
        [[SIZE[0], 0.123, 0.777], [0.31, 0.0, 1.01], [0.5, 0.5, SIZE[2]], [0.0, 0.0, 0.0],
         [0.9, SIZE[1], 0.05]]
    )  # fmt: skip
    nodes, weights = skin.locate(points)
    assert nodes.shape == weights.shape == (5, skin.faces.nodes.shape[1])
    np.testing.assert_allclose(weights.sum(axis=1), 1.0, rtol=1e-12)
    found = np.einsum("mk,mki->mi", weights, mesh.points[nodes])
    np.testing.assert_allclose(found, points, atol=1e-12)
    if CELL_TYPES[kind].linear != kind:  # a quadratic field is met exactly
        field = mesh.points[:, 0] ** 2 - 3.0 * mesh.points[:, 1] * mesh.points[:, 2]
        exact = points[:, 0] ** 2 - 3.0 * points[:, 1] * points[:, 2]
        np.testing.assert_allclose((weights * field[nodes]).sum(axis=1), exact, atol=1e-12)
    with pytest.raises(InputError, match="on the surface"):
        skin.locate(np.array([[0.5, 0.4, 0.65]]))


@pytest.mark.parametrize("kind", ["hex20", "hex27", "tet10", "wedge15"])
def test_locate_on_curved_faces(kind: str) -> None:
    mesh = curved(kind)
    faces = boundary_faces(mesh)
    skin = Skin(mesh, faces)
    fine = Skin(mesh, faces, 4).at_vertices(mesh.points)  # points on the curved faces
    picked = fine[::37]
    nodes, weights = skin.locate(picked)
    found = np.einsum("mk,mki->mi", weights, mesh.points[nodes])
    np.testing.assert_allclose(found, picked, atol=1e-11)
    # the middle of a chord, inside the curved outer side, isn't on the surface
    angle = 0.5 * np.pi * np.array([0.25, 0.5])
    ends = (2.0 + SIZE[2]) * np.stack([np.sin(angle), 0.0 * angle, np.cos(angle)], axis=1)
    with pytest.raises(InputError, match="on the surface"):
        skin.locate(ends.mean(axis=0)[None] + [0.0, 0.3, 0.0])


def test_a_coarse_mesh_is_cut_finer() -> None:
    for divisions, expected in (((2, 2, 2), 8), ((12, 12, 8), 4)):
        mesh = mesh_of("hex20", divisions)
        skin = Skin(mesh, boundary_faces(mesh))
        assert len(skin.pieces) == expected**2 * len(skin.faces)
    linear = mesh_of("hex8", (2, 2, 2))
    assert len(Skin(linear, boundary_faces(linear)).pieces) == 24


def test_subdivisions_must_be_positive() -> None:
    mesh = mesh_of("tet10")
    with pytest.raises(InputError, match="subdivisions; got 0"):
        Skin(mesh, boundary_faces(mesh), 0)
