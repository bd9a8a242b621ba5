"""Exodus files: node and side orders of every type, sets, fields, both containers, faults."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import numpy as np
import numpy.typing as npt
import pytest
from scipy.io import netcdf_file

from gpusim.errors import InputError
from gpusim.mesh import CELL_TYPES, set_faces
from gpusim.mesh.formats.exodus import read_exodus, read_exodus_steps
from gpusim.mesh.shape_functions import reference_nodes

Float = npt.NDArray[np.float64]

# Exodus II manual: where each node lies, as the corners (from 1) whose mean it is.
_EDGES = ["12", "23", "34", "41", "15", "26", "37", "48", "56", "67", "78", "85"]
_FACES = ["12345678", "1234", "5678", "1584", "2376", "1265", "3487"]
MIDDLES = {
    "hex20": _EDGES,
    "hex27": _EDGES + _FACES,
    "tet10": ["12", "23", "31", "14", "24", "34"],
    "wedge15": ["12", "23", "31", "14", "25", "36", "45", "56", "64"],
    "pyramid13": ["12", "23", "34", "41", "15", "25", "35", "45"],
}
SIDES = {
    "hex8": ["1265", "2376", "3487", "1584", "1432", "5678"],
    "tet4": ["124", "234", "143", "132"],
    "wedge6": ["1254", "2365", "1463", "132", "456"],
    "pyramid5": ["125", "235", "345", "154", "1432"],
}
WRITTEN = {
    "hex8": "HEX8", "hex20": "HEX20", "hex27": "HEX27", "tet4": "TETRA4", "tet10": "TETRA10",
    "wedge6": "WEDGE", "wedge15": "WEDGE15", "pyramid5": "PYRAMID5", "pyramid13": "PYRAMID13",
}  # fmt: skip


def letters(texts: list[str], width: int = 33) -> npt.NDArray[Any]:
    """Texts as Exodus keeps them: ended by a zero, with rubbish after it."""
    rows = [(text.encode() + b"\0" + b"\xff@" * width)[:width] for text in texts]
    return np.array([[bytes([byte]) for byte in row] for row in rows])


def content(kind: str) -> tuple[dict[str, Any], dict[str, str]]:
    """One cell of a type, each of its sides a side set, in the order of the Exodus manual."""
    corners = reference_nodes(CELL_TYPES[kind].linear) * [2.0, 3.0, 5.0] + [7.0, 1.0, 0.0]
    middles = [
        corners[[int(letter) - 1 for letter in one]].mean(axis=0) for one in MIDDLES.get(kind, [])
    ]
    points = np.concatenate([corners, np.reshape(middles, (-1, 3))])
    count = len(points)
    sides = SIDES[CELL_TYPES[kind].linear]
    variables: dict[str, Any] = {
        "coordx": points[:, 0], "coordy": points[:, 1], "coordz": points[:, 2],
        "connect1": np.arange(1, count + 1, dtype=np.int32)[None],
        "eb_names": letters(["solid"]),
        "ns_names": letters(["", "two"]),
        "ns_prop1": np.array([40, 41], dtype=np.int32),
        "node_ns1": np.array([1], dtype=np.int32),
        "node_ns2": np.array([4, 2], dtype=np.int32),
        "ss_names": letters([f"side {text}" for text in sides]),
        "time_whole": np.array([0.0, 0.5]),
        "name_nod_var": letters(["ux", "uy", "uz"]),
        "info_records": letters(["a = 1", ""]),
    }  # fmt: skip
    for k in range(len(sides)):
        variables[f"elem_ss{k + 1}"] = np.array([1], dtype=np.int32)
        variables[f"side_ss{k + 1}"] = np.array([k + 1], dtype=np.int32)
    for axis in range(3):
        variables[f"vals_nod_var{axis + 1}"] = np.outer([0.0, 2.0], points[:, axis])
    return variables, {"connect1": WRITTEN[kind]}


def write(path: Path, variables: dict[str, Any], kinds: dict[str, str], hdf: bool = False) -> Path:
    if hdf:
        with h5py.File(path, "w") as file:
            for name, array in variables.items():
                file[name] = array
            for name, kind in kinds.items():
                file[name].attrs["elem_type"] = kind
        return path
    with netcdf_file(path, "w", version=2) as file:
        for name, array in variables.items():
            sizes = [f"{name}_{k}" for k in range(array.ndim)]
            for size, length in zip(sizes, array.shape, strict=True):
                file.createDimension(size, length)
            file.createVariable(name, array.dtype, sizes)[:] = array
        for name, kind in kinds.items():
            file.variables[name].elem_type = kind
    return path


@pytest.mark.parametrize(
    ("kind", "hdf"), [*((kind, False) for kind in sorted(WRITTEN)), ("wedge15", True)]
)
def test_orders_of_every_type(kind: str, hdf: bool, tmp_path: Path) -> None:
    mesh = read_exodus(write(tmp_path / "one.e", *content(kind), hdf=hdf))
    assert list(mesh.cells) == [kind]
    cell = CELL_TYPES[kind]
    own = mesh.points[mesh.cells[kind][0]]
    for number, parents in enumerate(cell.parents, start=cell.corners):
        np.testing.assert_allclose(own[number], own[list(parents)].mean(axis=0), atol=1e-14)
    assert mesh.cell_sets["solid"].tolist() == [0]
    assert mesh.node_sets["nodeset_40"].tolist() == [0]
    assert mesh.node_sets["two"].tolist() == [1, 3]
    for text in SIDES[cell.linear]:
        face = set_faces(mesh, mesh.face_sets[f"side {text}"])
        on_face = {int(node) for node in face.nodes[0, :4] if node >= 0}
        assert on_face == {int(letter) - 1 for letter in text}
        outward = face.centroids[0] - mesh.points.mean(axis=0)
        assert float(face.normals[0] @ outward) > 0.0


@pytest.mark.parametrize("hdf", [False, True])
def test_fields(hdf: bool, tmp_path: Path) -> None:
    path = write(tmp_path / "one.e", *content("wedge15"), hdf=hdf)
    mesh, steps = read_exodus_steps(path)
    assert steps.times.tolist() == [0.0, 0.5]
    assert steps.names == ("ux", "uy", "uz")
    assert steps.info == ("a = 1", "")
    u = steps.values(steps.names, 1)
    assert u.shape == (15, 3) and u.dtype == np.float64 and u.dtype.isnative
    np.testing.assert_array_equal(u, 2.0 * mesh.points)


def test_blocks_of_several_types_and_of_none(tmp_path: Path) -> None:
    """Elements are numbered through all blocks, also those that aren't solids."""
    points = np.array(
        [[x, y, z] for z in (0.0, 5.0) for y in (0.0, 3.0) for x in (0.0, 2.0)]
        + [[1.0, 1.0, 7.0], [4.0, 1.0, 2.0]]
    )
    names = letters(["roof", "shell", "brick", "more"])
    variables = {
        "coord": np.ascontiguousarray(points.T),
        "eb_names": names,
        "connect1": np.array([[5, 6, 8, 7, 9]], dtype=np.int32),
        "connect2": np.array([[1, 2, 4, 3]], dtype=np.int32),
        "connect3": np.array([[1, 2, 4, 3, 5, 6, 8, 7]], dtype=np.int32),
        "connect4": np.array([[2, 4, 6, 10], [4, 8, 6, 10]], dtype=np.int32),
        "elem_ss1": np.array([5, 3, 2], dtype=np.int32),
        "side_ss1": np.array([1, 5, 1], dtype=np.int32),
    }
    kinds = {"connect1": "PYRAMID", "connect2": "SHELL4", "connect3": "HEX", "connect4": "TETRA"}
    mesh = read_exodus(write(tmp_path / "four.e", variables, kinds))
    assert list(mesh.cells) == ["pyramid5", "hex8", "tet4"]
    assert {name: cells.tolist() for name, cells in mesh.cell_sets.items()} == {
        "roof": [0], "brick": [1], "more": [2, 3],
    }  # fmt: skip
    faces = set_faces(mesh, mesh.face_sets["sideset_1"])
    assert faces.cell.tolist() == [3, 1]
    np.testing.assert_allclose(faces.area_vectors[1], [0.0, 0.0, -6.0])
    assert sorted(faces.nodes[0, :3].tolist()) == [3, 7, 9]


def changed(kind: str, **new: Any) -> tuple[dict[str, Any], dict[str, str]]:
    variables, kinds = content(kind)
    return {**variables, **new}, kinds


@pytest.mark.parametrize(
    ("what", "message"),
    [
        ((content("hex8")[0], {"connect1": "SHELL8"}), "no solid elements; got SHELL8"),
        ((content("hex8")[0], {"connect1": "HEX9"}), None),
        ((content("hex20")[0], {"connect1": "TETRA14"}), "TETRA14 with 20 nodes; expected one of"),
        (changed("hex8", side_ss1=np.array([7], dtype=np.int32)), "has no face 7; expected 1 … 6"),
        (
            changed("hex8", elem_ss1=np.array([9], dtype=np.int32)),
            "got elements 9 to 9; expected 1 to 1",
        ),
        (changed("hex8", elem_ss1=np.array([0], dtype=np.int32)), "got elements 0 to 0"),
        ((content("hex8")[0], {"connect1": "NFACED"}), "connect1: elements of type NFACED"),
        (changed("hex8", node_ns1=np.array([9], dtype=np.int32)), "number out of range"),
    ],
)
def test_wrong_content(what: Any, message: str | None, tmp_path: Path) -> None:
    path = write(tmp_path / "one.e", *what)
    if message is None:
        assert read_exodus(path).cell_count == 1  # the nodes decide, not the digits of a name
        return
    with pytest.raises(InputError, match=message):
        read_exodus(path)


def test_plane_meshes_and_missing_parts(tmp_path: Path) -> None:
    variables, kinds = content("hex8")
    del variables["coordz"]
    with pytest.raises(InputError, match="got 2 coordinates per node; expected 3"):
        read_exodus(write(tmp_path / "flat.e", variables, kinds))
    del variables["coordx"], variables["coordy"]
    with pytest.raises(InputError, match=r"flat\.e: no variable 'coordx'"):
        read_exodus(write(tmp_path / "flat.e", variables, kinds))


def test_files_that_are_cut_off_or_something_else(tmp_path: Path) -> None:
    whole = write(tmp_path / "one.e", *content("hex20")).read_bytes()
    path = tmp_path / "part.e"
    for share in (0.02, 0.2, 0.5, 0.9):
        path.write_bytes(whole[: int(share * len(whole))])
        with pytest.raises(InputError, match=r"part\.e: "):
            read_exodus(path)
    path.write_bytes(b"$MeshFormat\n4.1 0 8\n")
    with pytest.raises(InputError, match="not an Exodus file; got first bytes"):
        read_exodus(path)
    path.write_bytes(b"\x89HDF\r\n\x1a\n" + b"\0" * 40)
    with pytest.raises(InputError, match=r"part\.e: "):
        read_exodus(path)
    with pytest.raises(InputError, match="not found"):
        read_exodus_steps(tmp_path / "absent.e")
