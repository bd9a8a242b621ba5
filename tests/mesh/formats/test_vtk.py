"""VTK's files in every layout that others write: pieces, encodings, versions, and refusals."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest

import gpusim as gs
from gpusim.errors import InputError
from gpusim.files.input_file import read_input
from gpusim.mesh import box, read_mesh
from tests.support.vtk_files import BRICK, Vtu, legacy

Float = npt.NDArray[np.float64]

ZLIB, LZMA = "vtkZLibDataCompressor", "vtkLZMADataCompressor"
LAYOUTS = [
    Vtu(),
    Vtu("binary"),
    Vtu("binary", joined=False),
    Vtu("binary", header="u8", order=">", version="2.3"),
    Vtu("binary", compressor=ZLIB, header="u8"),
    Vtu("binary", compressor=LZMA, version="0.1"),
    Vtu("raw"),
    Vtu("raw", header="u8", order=">"),
    Vtu("raw", compressor=ZLIB, version="2.2", order=">"),
    Vtu("raw", compressor=ZLIB, block=96),
    Vtu("base64"),
    Vtu("base64", header="u8", joined=False),
    Vtu("base64", compressor=ZLIB),
    Vtu("base64", compressor=LZMA, header="u8"),
]


def moved(points: Float) -> Float:
    x, y, z = points.T
    return np.stack([0.1 * y * z, -0.2 * z * x, 0.3 * x + y * z], axis=1)


def two_pieces() -> list[dict[str, object]]:
    """A brick each, z 0 to 20 and 20 to 40, which share no nodes."""
    pieces = []
    for first in (0.0, 20.0):
        points = BRICK + np.array([0, 0, first])
        data = {"U": moved(points), "T": points[:, 0]}
        pieces.append({"points": points, "cells": np.arange(8)[None], "data": data})
    return pieces


@pytest.mark.parametrize("how", LAYOUTS, ids=str)
def test_all_pieces_of_every_layout(how: Vtu, tmp_path: Path) -> None:
    path = tmp_path / "two.vtu"
    note = '<FieldData><DataArray type="String" Name="title" NumberOfTuples="1" format="ascii">'
    path.write_bytes(replace(how, extra=f"{note} 97 0</DataArray></FieldData>").text(two_pieces()))
    mesh = read_mesh(path)
    assert mesh.node_count == 16 and len(mesh.cells["hex8"]) == 2
    np.testing.assert_array_equal(mesh.bounds, [[0, 0, 0], [3, 2, 40]])
    np.testing.assert_array_equal(mesh.points[mesh.cells["hex8"][1]], BRICK + np.array([0, 0, 20]))
    field = gs.read_field(read_input(path))
    np.testing.assert_allclose(field.step(0), moved(field.mesh.points), rtol=1e-15)
    assert field.mesh.cell_count == 2


def test_cells_that_another_piece_has_too_are_there_once(tmp_path: Path) -> None:
    first, second = two_pieces()
    both = {
        "points": np.concatenate([BRICK, BRICK + np.array([0, 0, 20])]),
        "cells": np.arange(16).reshape(2, 8),
        "cell_data": {"vtkGhostType": np.array([1, 0], np.uint8)},
    }
    first["cell_data"] = {"vtkGhostType": np.array([0], np.uint8)}
    first.pop("data"), second.pop("data")
    path = tmp_path / "ghost.vtu"
    path.write_bytes(Vtu("raw").text([first, both]))
    mesh = read_mesh(path)
    assert mesh.cell_count == 2 and mesh.node_count == 16
    np.testing.assert_array_equal(mesh.points[mesh.cells["hex8"][:, 6]], [[3, 2, 20], [3, 2, 40]])


GRID = Vtu().text(two_pieces()).decode()
RAW = Vtu("raw", compressor=ZLIB).text(two_pieces())
FIRST = RAW.index(b">\n  _") + 5


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (GRID.replace('"UnstructuredGrid"', '"PolyData"'), "type 'PolyData'; expected Unstruct"),
        (GRID.replace('version="1.0" t', 'version="3.0" t'), "version '3.0'; expected 0.1 to 2.x"),
        (GRID.replace("header_type", 'compressor="vtkLZ4DataCompressor" header_type'),
         "vtkLZ4DataCompressor.*expected none, vtkZLib"),
        (GRID.replace("<Cells>", "<Verts></Verts><Cells>"), "got <Verts> in <Piece>; expected"),
        (GRID.replace('ts="8"', 'ts="999999999999"', 1), "got 24 numbers; expected 999999999999 x"),
        (GRID.replace("0 1 2 3 4 5 6 7", "0 1 2 3 4 5 6 8", 1), "piece 1: a cell names node 8"),
        (GRID.replace("0 1 2 3 4 5 6 7", "0 1 2 3 4 5 6 x", 1), "array 'connectivity': da"),
        (GRID.replace('"UInt8"', '"Bit"'), "array 'types': type 'Bit'; expected one of Int8"),
        ("<!DOCTYPE a [<!ENTITY b 'c'>]>" + GRID[22:], "definitions of its own"),
        (RAW[:-60], "cut off"),
        (RAW.replace(b'offset="0"', b'offset="77777"'), "offset 77777; got .* appended bytes"),
        (RAW[:FIRST] + b"\xff" * 4 + RAW[FIRST + 4 :], "4294967295 compressed blocks in"),
        (RAW.replace(b"x\x9c", b"x\x9d"), "damaged"),
    ],
)  # fmt: skip
def test_vtu_refusals_say_why(content: str | bytes, words: str, tmp_path: Path) -> None:
    path = tmp_path / "bad.vtu"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(InputError, match=words) as told:
        gs.read_field(path)
    assert "bad.vtu" in str(told.value)


@pytest.mark.parametrize("suffix", [".pvtu", ".vtm", ".vtpd"])
def test_files_that_name_others_are_refused_by_name(suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"all{suffix}"
    path.write_text('<VTKFile type="PUnstructuredGrid"/>')
    for read in (read_mesh, gs.read_field):
        with pytest.raises(InputError, match=rf"all\{suffix}: names .* merged, saved as .vtu"):
            read(path)


# In binary files any number may hold the byte of a newline: 10 nodes, node 2570 = 0x0A0A.
@pytest.mark.parametrize("field", [False, True])
@pytest.mark.parametrize("version", ["2.0", "3.0", "4.2", "5.1"])
@pytest.mark.parametrize("binary", [False, True])
def test_legacy_files_of_every_version(
    binary: bool, version: str, field: bool, tmp_path: Path
) -> None:
    bricks = box((3.0, 2.0, 1.0), (30, 10, 8))
    cells = bricks.cells["hex8"]
    assert b"\n" in cells.astype(">i4").tobytes() and (cells == 2570).any()
    # the first number after CELLS is 8; put other bytes that are no text behind it
    order = np.argsort(~(cells == 0x0A0A).any(axis=1), kind="stable")
    path = tmp_path / "bricks.vtk"
    path.write_bytes(legacy(bricks.points, cells[order], binary, version, field))
    mesh = read_mesh(path)
    np.testing.assert_array_equal(mesh.points, bricks.points)
    np.testing.assert_array_equal(mesh.cells["hex8"], cells[order])


LEGACY = legacy(BRICK, np.arange(8)[None], False, "4.2", True)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (LEGACY.replace(b"4.2", b"6.0"), "version 6.0; expected 1.0 to 5.1"),
        (LEGACY.replace(b"UNSTRUCTURED_GRID", b"RECTILINEAR_GRID"), "RECTILINEAR_GRID; expected"),
        (LEGACY.replace(b"CELLS 1 9", b"CELLS 99999999999 9"), "99999999999 cells in 9 numbers"),
        (LEGACY.replace(b"CELLS 1 9", b"CELLS 1 99999999999"), "expected 99999999999: cut off"),
        (LEGACY.replace(b"8 0 1", b"7 0 1"), "don't add up"),
        (LEGACY.replace(b"6 7\n", b"6 9\n"), "names node 9, which isn't there; expected 0 … 7"),
        (LEGACY.replace(b"CELL_TYPES 1\n12", b"CELL_TYPES 1\n42"), "VTK type 42; expected"),
        (LEGACY.replace(b"CELL_TYPES", b"ODD 1\nCELL_TYPES"), "got 'ODD 1'; expected a section"),
    ],
)  # fmt: skip
def test_legacy_refusals_say_why(content: bytes, words: str, tmp_path: Path) -> None:
    path = tmp_path / "bad.vtk"
    path.write_bytes(content)
    with pytest.raises(InputError, match=words) as told:
        read_mesh(path)
    assert "bad.vtk" in str(told.value)
