"""VTU, PVD and STL: what meshio reads back is what was written."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from pathlib import Path

import meshio
import numpy as np
import pytest

from gpusim.errors import InputError
from gpusim.export.meshes import write_pvd, write_region_stls, write_stl, write_vtu
from gpusim.mesh import CELL_TYPES
from tests.support.element_meshes import SERENDIPITY, mesh_of, mixed_mesh, with_middles

POINTS = np.array(
    [
        [0.0, 0.0, 0.0],
        [3.0, 0.0, 0.0],
        [3.0, 2.0, 0.0],
        [0.0, 2.0, 0.0],
        [0.0, 0.0, 1.0],
        [3.0, 0.0, 1.0],
        [3.0, 2.0, 1.0],
        [0.0, 2.0, 1.0],
        [5.0, 1.0, 0.5],
    ]
)
HEX = np.array([[0, 1, 2, 3, 4, 5, 6, 7]])
TETS = np.array([[1, 2, 5, 8], [2, 6, 5, 8]])


def test_vtu_round_trip(tmp_path: Path) -> None:
    u = np.arange(27.0).reshape(9, 3) * 1e-5 + 1e-12
    material = np.array([7, 8, 9])
    path = write_vtu(
        tmp_path / "a.vtu",
        POINTS,
        {"hex8": HEX, "tet4": TETS},
        point_data={"u": u, "node": np.arange(9)},
        cell_data={"material": material},
    )
    mesh = meshio.read(path)
    assert np.array_equal(mesh.points, POINTS)
    assert np.array_equal(mesh.point_data["u"], u)  # float64, bit for bit
    assert np.array_equal(mesh.point_data["node"], np.arange(9))
    assert np.array_equal(mesh.cells_dict["hexahedron"], HEX)
    assert np.array_equal(mesh.cells_dict["tetra"], TETS)
    assert [block.tolist() for block in mesh.cell_data["material"]] == [[7], [8, 9]]


VTK_NUMBER = {
    "tet4": 10, "hex8": 12, "wedge6": 13, "pyramid5": 14, "tet10": 24, "hex20": 25, "wedge15": 26,
    "pyramid13": 27, "hex27": 29,
}  # fmt: skip


@pytest.mark.parametrize("kind", list(CELL_TYPES))
def test_vtu_has_every_cell_type_under_its_vtk_number(kind: str, tmp_path: Path) -> None:
    mesh = mesh_of(kind, (2, 1, 1))
    path = write_vtu(tmp_path / "a.vtu", mesh.points, mesh.cells)
    read = meshio.read(path)
    assert len(read.cells) == 1
    np.testing.assert_array_equal(read.cells[0].data, mesh.cells[kind])
    assert meshio._vtk_common.meshio_to_vtk_type[read.cells[0].type] == VTK_NUMBER[kind]


def test_vtu_of_a_mixed_mesh_keeps_cell_data_with_its_cells(tmp_path: Path) -> None:
    mesh = with_middles(mixed_mesh(), SERENDIPITY)
    number = np.arange(mesh.cell_count)
    path = write_vtu(tmp_path / "a.vtu", mesh.points, mesh.cells, cell_data={"number": number})
    read = meshio.read(path)
    assert len(read.cells) == 4
    for (_, first, block), cells, data in zip(
        mesh.blocks(), read.cells, read.cell_data["number"], strict=True
    ):
        np.testing.assert_array_equal(cells.data, block)
        np.testing.assert_array_equal(data, first + np.arange(len(block)))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"points": POINTS[:, :2]}, r"points: got shape \(9, 2\)"),
        ({"points": np.where(POINTS == 5.0, np.nan, POINTS)}, r"got nan at \[8, 0\]"),
        ({"cells": {}}, "at least one cell type"),
        ({"cells": {"hex": HEX}}, "got type 'hex'; expected one of tet4, hex8"),
        ({"cells": {"tet4": HEX}}, r"expected \(M, 4\) integer"),
        ({"cells": {"tet4": TETS + 1}}, "got node 2 to 9; expected 0 to 8"),
        ({"point_data": {"u": np.zeros((8, 3))}}, r"point_data\['u'\]: got shape \(8, 3\)"),
        ({"point_data": {"u": np.full(9, np.inf)}}, r"got inf at \[0\]"),
        ({"cell_data": {"id": np.zeros(2)}}, r"cell_data\['id'\]: got shape \(2,\)"),
    ],
)
def test_vtu_refuses_bad_input(tmp_path: Path, change: dict[str, object], message: str) -> None:
    arguments: dict[str, object] = {"points": POINTS, "cells": {"hex8": HEX}, **change}
    with pytest.raises(InputError, match=message):
        write_vtu(tmp_path / "a.vtu", **arguments)  # type: ignore[arg-type]
    assert list(tmp_path.iterdir()) == []


def test_pvd_names_files_relative_to_itself(tmp_path: Path) -> None:
    steps = [(0.0, tmp_path / "solution" / "0000.vtu"), (0.1, tmp_path / "solution" / "a&b.vtu")]
    path = write_pvd(tmp_path / "solution" / "all.pvd", steps)
    rows = ElementTree.parse(path).getroot().findall("./Collection/DataSet")
    assert [row.get("file") for row in rows] == ["0000.vtu", "a&b.vtu"]
    assert [float(row.get("timestep", "nan")) for row in rows] == [0.0, 0.1]
    for bad in ([], [(0.0, "a"), (0.0, "b")], [(float("nan"), "a")]):
        with pytest.raises(InputError, match="growing numbers"):
            write_pvd(tmp_path / "b.pvd", bad)


def test_stl_of_quads(tmp_path: Path) -> None:
    quads = np.array([[0, 1, 5, 4], [4, 5, 6, 7]])  # front (normal -y), top (normal +z)
    path = write_stl(tmp_path / "a.stl", POINTS, quads, title="region skin, step 1")
    data = path.read_bytes()
    assert data.startswith(b"gpusim binary STL, unit mm. region skin, step 1")
    assert len(data) == 84 + 4 * 50
    mesh = meshio.read(path)
    triangles = mesh.points[mesh.cells_dict["triangle"]]
    expected = POINTS[[[0, 1, 5], [0, 5, 4], [4, 5, 6], [4, 6, 7]]] * 1000.0
    assert np.allclose(triangles, expected, rtol=1e-7, atol=0.0)
    normals = np.frombuffer(data, np.uint8)[84:].reshape(4, 50)[:, :12].copy().view("<f4")
    assert normals.tolist() == [[0, -1, 0], [0, -1, 0], [0, 0, 1], [0, 0, 1]]


def test_stl_drops_collapsed_triangles_and_takes_triangles(tmp_path: Path) -> None:
    write_stl(tmp_path / "a.stl", POINTS, np.array([[1, 2, 8, 8]]))
    assert len(meshio.read(tmp_path / "a.stl").cells_dict["triangle"]) == 1
    write_stl(tmp_path / "b.stl", POINTS, np.array([[1, 2, 8]]))
    assert (tmp_path / "a.stl").read_bytes() == (tmp_path / "b.stl").read_bytes()


def test_stl_per_region(tmp_path: Path) -> None:
    faces = np.array([[0, 1, 5, 4], [4, 5, 6, 7], [3, 2, 1, 0]])
    region = np.array([2, 0, 2])
    paths = write_region_stls(
        tmp_path, POINTS, faces, region, ["bare steel", "unused", "beam"], step=3
    )
    assert paths == (tmp_path / "bare_steel" / "0003.stl", tmp_path / "beam" / "0003.stl")
    top = meshio.read(paths[0])
    assert (top.points[:, 2] == 1000.0).all()
    assert len(meshio.read(paths[1]).cells_dict["triangle"]) == 4
    with pytest.raises(InputError, match="stay different as folder names"):
        write_region_stls(tmp_path, POINTS, faces, region, ["a/b", "a b", "c"], step=0)
    with pytest.raises(InputError, match="got 0 to 2; expected 0 to 1"):
        write_region_stls(tmp_path, POINTS, faces, region, ["a", "b"], step=0)


@pytest.mark.parametrize(
    ("points", "faces", "message"),
    [
        (POINTS, np.array([[0, 1]]), r"\(M, 3\) or \(M, 4\)"),
        (POINTS, np.array([[0.0, 1.0, 2.0]]), "float64; expected"),
        (POINTS, np.array([[0, 1, 9]]), "got node 0 to 9; expected 0 to 8"),
        (POINTS, np.array([[0, 1, -1]]), "got node -1 to 1"),
        (np.where(POINTS == 5.0, np.nan, POINTS), np.array([[0, 1, 8]]), "not finite"),
        (POINTS * 1e40, np.array([[0, 1, 2]]), "float32 can't hold"),
    ],
)
def test_stl_refuses_bad_input(
    tmp_path: Path, points: np.ndarray, faces: np.ndarray, message: str
) -> None:
    with pytest.raises(InputError, match=message):
        write_stl(tmp_path / "a.stl", points, faces)
    assert list(tmp_path.iterdir()) == []


def test_stl_far_from_zero_is_written_from_an_origin(tmp_path: Path) -> None:
    """float32 would leave steps of half a metre at 5,200 km, in mm."""
    utm = np.array([5e5, 5.2e6, 300.0])
    quads = np.array([[0, 3, 2, 1], [4, 5, 6, 7]])
    with pytest.raises(InputError, match=r"up to 5200002 m .* steps of 512 mm; expected an origin"):
        write_stl(tmp_path / "a.stl", POINTS + utm, quads)
    origin = np.array([499712.0, 5200000.0, 256.0])
    path = write_stl(tmp_path / "b.stl", POINTS + utm, quads, title="skin", origin=origin)
    assert path.read_bytes()[:80].rstrip() == (
        b"gpusim binary STL, unit mm from (499712, 5200000, 256) m. skin"
    )
    got = np.unique(meshio.read(path).points, axis=0)
    want = np.unique(1e3 * (POINTS[:8] + utm - origin), axis=0)
    np.testing.assert_allclose(got, want, rtol=1e-7, atol=1e-6)
    with pytest.raises(InputError, match="origin"):
        write_stl(tmp_path / "c.stl", POINTS, quads, origin=(0.0, np.nan, 0.0))


def test_names_of_arrays_are_escaped(tmp_path: Path) -> None:
    names = ["a&b", "a<b", 'a"b', "a>b'c", "ε_xx", "two\tparts"]
    values = {name: np.arange(9.0) + k for k, name in enumerate(names)}
    path = tmp_path / "a.vtu"
    write_vtu(path, POINTS, {"hex8": HEX}, point_data=values, cell_data={"1<2": np.array([7])})
    found = meshio.read(path)
    for name in names:
        np.testing.assert_array_equal(found.point_data[name], values[name])
    assert found.cell_data["1<2"][0].tolist() == [7]
    path.unlink()
    with pytest.raises(InputError, match=r"field name; got .*expected characters that XML has"):
        write_vtu(path, POINTS, {"hex8": HEX}, point_data={"a\x01": values["a&b"]})
    assert not path.exists()
