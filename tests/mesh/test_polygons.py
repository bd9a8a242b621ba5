"""Polygons: cut where they are dented, wherever faces become triangles."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import gpusim as gs
from gpusim.mesh import read_surface, read_textured
from gpusim.mesh.polygons import cut_at_dents, cut_polygons, unit_normals

DENTED = np.array([[-1.0, 1, 0], [-1, -1, 0], [1, -1, 0], [-0.5, -0.5, 0]])  # of area 1
RNG = np.random.default_rng(3)
TURN = np.linalg.qr(RNG.normal(size=(3, 3)))[0]


def area(points: np.ndarray, faces: np.ndarray) -> float:
    """Of both halves of every face, each counted as if it were alone."""
    total = 0.0
    for a, b, c, d in faces.tolist():
        for p, q, r in ((a, b, c), (a, c, d)) if d >= 0 else ((a, b, c),):
            total += 0.5 * np.linalg.norm(np.cross(points[q] - points[p], points[r] - points[p]))
    return total


def test_normals_of_triangles_on_a_sphere_and_of_one_without_area() -> None:
    """A triangle's normal goes through the middle of the circle round its corners."""
    corners = RNG.normal(size=(40, 3, 3))
    corners /= np.linalg.norm(corners, axis=2)[..., None]
    normal = unit_normals(corners)
    heights = np.einsum("tvi,ti->tv", corners, normal)
    assert np.ptp(heights, axis=1).max() <= 1e-12
    assert np.linalg.norm(normal, axis=1) == pytest.approx(1.0, rel=1e-14)
    assert np.array_equal(np.sign(np.linalg.det(corners)), np.sign(heights[:, 0]))
    assert not unit_normals(np.ones((1, 3, 3))).any()


@pytest.mark.parametrize("first", range(4))
@pytest.mark.parametrize("order", [1, -1])
def test_a_dented_quadrilateral_is_cut_at_its_dent(first: int, order: int) -> None:
    points = DENTED @ TURN.T + 3.0
    face = np.roll([0, 1, 2, 3], first)[::order]
    rows, source = cut_at_dents(points, face[None])
    assert area(points, rows) == pytest.approx(1.0, rel=1e-12)
    assert rows.tolist() == [row for row in rows.tolist() if row[3] == -1] and len(rows) == 2
    assert source.tolist() == [0, 0]
    normals = [np.cross(points[b] - points[a], points[c] - points[a]) for a, b, c, _ in rows]
    assert normals[0] @ normals[1] > 0.0


def test_what_is_bent_has_no_dent() -> None:
    """A square whose halves make a sharp fold, along either diagonal."""
    for height in (0.2, 1.0, 5.0):
        folded = np.array([[0.0, 0, 0], [1, 0, height], [1, 1, 0], [0, 1, height]])
        for first in range(4):
            face = np.roll([[0, 1, 2, 3]], first, axis=1)
            np.testing.assert_array_equal(cut_at_dents(folded, face)[0], face)


def test_what_has_no_dent_stays() -> None:
    square = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0.4], [0, 1, 0], [2, 0, 0]])
    faces = np.array([[0, 1, 2, 3], [0, 4, 2, -1], [0, 1, 4, 2]])  # bent; a triangle; straight at 1
    rows, source = cut_at_dents(np.where(square == 0.4, 0.1, square), faces)
    np.testing.assert_array_equal(rows, faces)
    assert source.tolist() == [0, 1, 2]


def test_a_surface_shows_its_dent(tmp_path: Path) -> None:
    """The camera sees 1 of the square's 4; so do STL files and every reader."""
    wall = gs.Surface(DENTED, [[0, 1, 2, 3]], region=[0])
    assert wall.faces.tolist() == [[1, 2, 3, -1], [1, 3, 0, -1]] and len(wall.regions) == 2
    camera = gs.Camera.from_lens((2, 2), 1, (80, 80), (0, 0, 1), (0, 0, 0), up=(0, 1, 0))
    light = gs.Surface(DENTED, [[0, 1, 2, 3]], gs.paint.Plain(1.0))
    picture = gs.render([light], camera, backend="numpy").radiance
    assert picture.mean() * 4.0 == pytest.approx(1.0, abs=1e-5)
    path = gs.export.write_stl(tmp_path / "a.stl", DENTED, np.array([[0, 1, 2, 3]]))
    assert area(*read_surface(path)) == pytest.approx(1e6, rel=1e-6)


def star(corners: int) -> np.ndarray:
    angle = np.sort(RNG.uniform(0, 2 * np.pi, corners))
    reach = RNG.uniform(0.3, 1.0, corners)
    return np.stack([reach * np.cos(angle), reach * np.sin(angle), 0 * angle], axis=1)


def enclosed(flat: np.ndarray) -> float:
    x, y = flat[:, 0], flat[:, 1]
    return 0.5 * float(np.abs(x @ np.roll(y, -1) - y @ np.roll(x, -1)))


KEYHOLE = np.array(
    [[0.0, 0], [4, 0], [4, 4], [0, 4], [0, 0], [1, 1], [1, 3], [3, 3], [3, 1], [1, 1]]
)


@pytest.mark.parametrize("corners", [5, 6, 8, 13, 60])
def test_polygons_of_many_corners(corners: int) -> None:
    flat = star(corners)
    points = flat @ TURN.T + 7.0
    rows, source = cut_polygons("a", points, np.arange(corners), np.array([corners]))
    assert rows.shape == (corners - 2, 4) and (source == 0).all()
    assert area(points, rows) == pytest.approx(enclosed(flat), rel=1e-12)


def test_a_polygon_around_a_hole_and_one_with_straight_corners() -> None:
    points = np.column_stack([KEYHOLE, np.zeros(10)])
    rows, _ = cut_polygons("a", points, np.arange(10), np.array([10]))
    assert area(points, rows) == pytest.approx(12.0)
    comb = np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0], [2, 2, 0], [1, 2, 0], [1, 1, 0], [0, 1, 0]])
    rows, _ = cut_polygons("a", comb, np.arange(7), np.array([7]))
    assert area(comb, rows) == pytest.approx(3.0)


CORNERS = np.array([[0.0, 0, 0], [4, 0, 0], [4, 4, 0], [2, 1, 0], [0, 4, 0]])  # of area 10
WRITTEN = {
    "a.obj": "".join(f"v {x} {y} {z}\nvt {x} {y}\n" for x, y, z in CORNERS)
    + "usemtl five\nf 1/1 2/2 3/3 4/4 5/5\nusemtl three\nf 1/1 5/5 2/2\n",
    "a.off": "OFF\n5 2 0\n" + "".join(f"{x} {y} {z}\n" for x, y, z in CORNERS)
    + "5 0 1 2 3 4 255 0 0\n3 0 4 1\n",
    "a.ply": "ply\nformat ascii 1.0\nelement vertex 5\nproperty float x\nproperty float y\n"
    "property float z\nelement face 2\nproperty list uchar int vertex_indices\nend_header\n"
    + "".join(f"{x} {y} {z}\n" for x, y, z in CORNERS) + "5 0 1 2 3 4\n3 0 4 1\n",
}  # fmt: skip


@pytest.mark.parametrize("name", WRITTEN)
def test_faces_of_five_corners_in_files(name: str, tmp_path: Path) -> None:
    path = tmp_path / name
    path.write_text(WRITTEN[name])
    points, faces = read_surface(path)
    assert len(faces) == 4 and area(points, faces) == pytest.approx(10.0 + 8.0)
    text = WRITTEN[name].replace("5 0 1 2 3 4", "5 0 1 2 3 9").replace("4/4 5/5\n", "4/4 9/5\n")
    path.write_text(text)
    with pytest.raises(gs.InputError, match=r"a\.\w+.* point (8|9)"):
        read_surface(path)


def test_texture_coordinates_go_with_their_corners(tmp_path: Path) -> None:
    path = tmp_path / "a.obj"
    path.write_text(WRITTEN["a.obj"])
    look = read_textured(path)
    np.testing.assert_array_equal(look.uv[:, :3], look.points[look.faces[:, :3], :2])
    assert look.material.tolist() == [0, 0, 0, 1]
    dented = "".join(f"v {x} {y} {z}\nvt {x} {y}\n" for x, y, z in DENTED) + "f 1/1 2/2 3/3 4/4\n"
    path.write_text(dented)
    look = read_textured(path)
    np.testing.assert_array_equal(look.uv[:, :3], look.points[look.faces[:, :3], :2])
    assert area(look.points, look.faces) == pytest.approx(1.0)


@pytest.mark.parametrize("colour", ["255 0 0", "1 0 0 1"])
def test_a_coff_with_three_or_four_numbers_of_colour(colour: str, tmp_path: Path) -> None:
    path = tmp_path / "a.off"
    rows = "".join(f"{x} {y} {z} {colour}\n" for x, y, z in DENTED)
    path.write_text(f"COFF\n4 1 0\n{rows}4 0 1 2 3\n")
    assert area(*read_surface(path)) == pytest.approx(1.0)
    path.write_text(f"COFF\n4 1 0\n{rows.replace(colour, '1 0')}4 0 1 2 3\n")
    with pytest.raises(gs.InputError, match=r"a\.off:3: got 5 numbers; expected 7"):
        read_surface(path)
