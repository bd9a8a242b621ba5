"""Mesh files: every cell type in Gmsh's own output, groups, and files that are wrong."""

from __future__ import annotations

import itertools
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from gpusim.errors import InputError
from gpusim.export.meshes import write_vtu
from gpusim.mesh import (
    CELL_TYPES,
    Mesh,
    boundary_faces,
    box,
    quadratic,
    read_mesh,
    select_faces,
    set_faces,
    split,
)
from tests.support.gmsh_meshes import CORNERS, write_one_cell, write_two_boxes

SECOND = {"tet4": "tet10", "hex8": "hex20", "wedge6": "wedge15", "pyramid5": "pyramid13"}


def volume(mesh: Mesh) -> float:
    faces = boundary_faces(mesh)
    return float(np.einsum("fi,fi->", faces.centroids, faces.area_vectors)) / 3.0


def midside_error(mesh: Mesh) -> float:
    """Greatest distance of a further node from the mean of its corners, over all cells."""
    worst = 0.0
    for kind, _, block in mesh.blocks():
        for column, group in enumerate(CELL_TYPES[kind].parents, start=CELL_TYPES[kind].corners):
            middle = mesh.points[block[:, list(group)]].mean(axis=1)
            worst = max(worst, float(np.abs(mesh.points[block[:, column]] - middle).max()))
    return worst


MSH = [
    {"MshFileVersion": version, "Binary": binary}
    for version, binary in itertools.product((2.2, 4.1), (0, 1))
]


@pytest.mark.parametrize("options", MSH, ids=lambda o: f"{o['MshFileVersion']}-{o['Binary']}")
@pytest.mark.parametrize("linear", list(CORNERS))
def test_every_cell_type_of_gmsh(tmp_path: Path, linear: str, options: dict[str, float]) -> None:
    for second, complete in ((False, False), (True, False), (True, True)):
        kind = SECOND[linear] if second else linear
        if complete:
            if linear in ("wedge6", "pyramid5"):
                continue
            kind = "hex27" if linear == "hex8" else kind
        path = tmp_path / "cell.msh"
        write_one_cell(path, linear, second, complete, **options)
        mesh = read_mesh(path)
        (name,) = mesh.cells
        assert name == kind
        np.testing.assert_allclose(
            mesh.points[mesh.cells[kind][0, : len(CORNERS[linear])]], CORNERS[linear], atol=1e-15
        )
        assert midside_error(mesh) <= 1e-12
        np.testing.assert_array_equal(mesh.cell_sets["my body"], [0])


# Gmsh writes wedge15 and hex27 rightly in all of these, pyramid13 in none.
@pytest.mark.parametrize(
    ("suffix", "options"),
    [
        (".vtk", {"Binary": 0}),
        (".vtk", {"Binary": 1}),
        (".med", {}),
        (".bdf", {"BdfFieldFormat": 0}),
        (".bdf", {"BdfFieldFormat": 1}),
        (".bdf", {"BdfFieldFormat": 2}),
    ],
)
@pytest.mark.parametrize("linear", list(CORNERS))
def test_other_formats_written_by_gmsh(
    tmp_path: Path, linear: str, suffix: str, options: dict[str, float]
) -> None:
    for second in (False, True):
        if second and linear == "pyramid5" and suffix != ".med":
            continue
        path = tmp_path / f"cell{suffix}"
        write_one_cell(path, linear, second, False, **options)
        mesh = read_mesh(path)
        (name,) = mesh.cells
        assert name == (SECOND[linear] if second else linear)
        assert midside_error(mesh) <= 1e-6
        assert np.abs(np.sort(mesh.points[:, 2])[-1] - max(p[2] for p in CORNERS[linear])) <= 1e-12


def test_a_complete_second_order_brick_in_vtk(tmp_path: Path) -> None:
    write_one_cell(tmp_path / "cell.vtk", "hex8", True, True)
    mesh = read_mesh(tmp_path / "cell.vtk")
    assert mesh.cells["hex27"].shape == (1, 27)
    assert midside_error(mesh) <= 1e-12


@pytest.mark.parametrize("options", MSH, ids=lambda o: f"{o['MshFileVersion']}-{o['Binary']}")
@pytest.mark.parametrize("order", [1, 2])
def test_groups_of_msh(tmp_path: Path, options: dict[str, float], order: int) -> None:
    path = tmp_path / "two.msh"
    write_two_boxes(path, order, **options)
    mesh = read_mesh(path, scale=10.0)
    assert volume(mesh) == pytest.approx(3000.0, rel=1e-12)
    assert mesh.dangling_nodes.size == 0
    left = mesh.cell_sets["left part"]
    middle = mesh.points[next(iter(mesh.cells.values()))[left, :4]].mean(axis=1)
    assert 0.0 < middle[:, 0].min() and middle[:, 0].max() < 20.0
    names = {"clamp", "inside", "surface_9"}
    assert set(mesh.face_sets) == names
    for name, x in zip(("clamp", "inside", "surface_9"), (0.0, 20.0, 30.0), strict=True):
        faces = set_faces(mesh, mesh.face_sets[name])
        assert faces.areas.sum() == pytest.approx(100.0, rel=1e-12)
        np.testing.assert_allclose(mesh.points[faces.node_numbers(), 0], x, atol=1e-9)
    assert len(mesh.node_sets["corner"]) == 1
    edge = mesh.points[mesh.node_sets["line_3"]]
    assert len(edge) >= 3 and np.ptp(edge, axis=0).astype(bool).sum() == 1
    # version 2.2 repeats an element for each of its groups
    assert len(mesh.cell_sets["both"]) == mesh.cell_count > len(left)
    assert set(mesh.cell_sets) == {"left part", "both"}


def test_saving_elements_without_a_group_too(tmp_path: Path) -> None:
    path = tmp_path / "all.msh"
    write_two_boxes(path, MshFileVersion=4.1, SaveAll=1)
    mesh = read_mesh(path)
    assert set(mesh.face_sets) == {"clamp", "inside", "surface_9"}
    assert volume(mesh) == pytest.approx(3.0, rel=1e-12)


def test_groups_of_med(tmp_path: Path) -> None:
    path = tmp_path / "two.med"
    write_two_boxes(path)
    mesh = read_mesh(path)
    assert volume(mesh) == pytest.approx(3.0, rel=1e-12)
    assert len(mesh.cell_sets["both"]) == mesh.cell_count > len(mesh.cell_sets["left part"])
    assert set_faces(mesh, mesh.face_sets["clamp"]).areas.sum() == pytest.approx(1.0, rel=1e-12)


@pytest.mark.parametrize(
    ("where", "name", "value", "words"),
    [
        (
            "ENS_MAA/*",
            "REP",
            1,
            "REP: got 1; expected 0 as the kind of coordinates; 0 is Cartesian",
        ),
        ("ENS_MAA/*", "ESP", 2, "ESP: got 2; expected 3 dimensions of space"),
        ("ENS_MAA/*/*/NOE", "PFL", b"some", "NOE: profile 'some'; expected all nodes and cells"),
        ("ENS_MAA/*/*/NOE", None, "TRF", "NOE: got TRF; expected COO, FAM"),
        ("ENS_MAA", None, "second", "got 2 meshes .*second.*; expected one in a file"),
        ("ENS_MAA/*/*/MAI", None, "POE", "got 1 cells of type MED POE; expected"),
    ],
)
def test_what_would_move_or_select_in_med_is_refused(
    tmp_path: Path, where: str, name: str | None, value: object, words: str
) -> None:
    path = tmp_path / "one.med"
    write_one_cell(path, "hex8", False, False)
    with h5py.File(path, "r+") as file:
        place: Any = file
        for part in where.split("/"):
            place = place[next(iter(place)) if part == "*" else part]
        if name is None:
            place.create_group(value)
        else:
            place.attrs[name] = value
    with pytest.raises(InputError, match=rf"one\.med: .*{words}"):
        read_mesh(path)


def all_kinds() -> list[Mesh]:
    bricks = box((3.0, 2.0, 1.0), (2, 2, 1))
    points = np.array(CORNERS["pyramid5"], dtype=float)
    pyramid = Mesh(points, {"pyramid5": np.arange(5)[None]})
    wedges = split(bricks, "wedge6")
    return [
        bricks, quadratic(bricks), quadratic(bricks, False), split(bricks),
        quadratic(split(bricks)), wedges, quadratic(wedges), pyramid, quadratic(pyramid),
    ]  # fmt: skip


@pytest.mark.parametrize("mesh", all_kinds(), ids=lambda mesh: next(iter(mesh.cells)))
def test_own_vtu_files_come_back(tmp_path: Path, mesh: Mesh) -> None:
    path = write_vtu(tmp_path / "own.vtu", mesh.points, mesh.cells)
    again = read_mesh(path)
    np.testing.assert_array_equal(again.points, mesh.points)
    assert list(again.cells) == list(mesh.cells)
    for kind, block in mesh.cells.items():
        np.testing.assert_array_equal(again.cells[kind], block)


def test_vtk_wedges_of_either_sense_and_newer_legacy_files(tmp_path: Path) -> None:
    points = "\n".join(" ".join(map(str, p)) for p in CORNERS["wedge6"])
    head = "# vtk DataFile Version 5.1\nx\nASCII\nDATASET UNSTRUCTURED_GRID\n"
    head += f"POINTS 6 double\n{points}\n"
    for order in ("0 1 2 3 4 5", "0 2 1 3 5 4"):
        path = tmp_path / "wedge.vtk"
        path.write_text(
            f"{head}METADATA\nINFORMATION 0\n\nCELLS 2 6\nOFFSETS vtktypeint64\n0 6\n"
            f"CONNECTIVITY vtktypeint64\n{order}\n\nCELL_TYPES 1\n13\nPOINT_DATA 6\n"
        )
        mesh = read_mesh(path)
        np.testing.assert_array_equal(mesh.cells["wedge6"], [[0, 1, 2, 3, 4, 5]])


BDF = """$ a brick on a wedge's side, with both kinds of fields
SOL 101
CEND
BEGIN BULK
GRID    1               0.0     0.0     0.0
GRID*   2                               1.0             0.0
*       0.0
GRID,3,,1.0,1.0,0.0
GRID    4               0.0     1.+0    0.0
GRID    11              0.0     0.0     2.0
GRID    12              1.0     0.0     20.-1
GRID    13              1.0     1.0     2.0D0
GRID    14              0.0     1.0     2.0
GRID    99              7.0     7.0     7.0
PSOLID,7,1
CHEXA   1       7       1       2       3       4       11      12      +
+       13      14
CQUAD4,2,3,1,2,12,11
CTRIA3,3,4,1,4,14
CTRIA3,4,4,1,14,11
ENDDATA
"""


def test_nastran_fields_exponents_and_properties(tmp_path: Path) -> None:
    path = tmp_path / "deck.BDF"
    path.write_text(BDF.replace("CTRIA3", "$CTRIA3"))
    mesh = read_mesh(path)
    np.testing.assert_array_equal(mesh.bounds, [[0, 0, 0], [1, 1, 2]])
    np.testing.assert_array_equal(mesh.cell_sets["property_7"], [0])
    side = set_faces(mesh, mesh.face_sets["surface_3"])
    np.testing.assert_allclose(side.area_vectors, [[0.0, -2.0, 0.0]])
    assert mesh.node_count == 8
    path.write_text(BDF)
    with pytest.raises(InputError, match="'surface_4': 2 of its 2 surface cells aren't faces"):
        read_mesh(path)


def test_inverted_cells_are_named(tmp_path: Path) -> None:
    path = tmp_path / "deck.bdf"
    path.write_text(
        BDF.replace("CTRIA3", "$CTRIA3").replace(
            "1.0     2.0\nGRID    99", "1.0     -2.0\nGRID    99"
        )
    )
    with pytest.raises(InputError, match=r"deck\.bdf: 1 inverted .*got .*line 16: CHEXA 1 \("):
        read_mesh(path)


def msh(nodes: str = "", elements: str = "", version: str = "2.2") -> str:
    return (
        f"$MeshFormat\n{version} 0 8\n$EndMeshFormat\n$Nodes\n{nodes}$EndNodes\n"
        f"$Elements\n{elements}$EndElements\n"
    )


TET_NODES = "4\n1 0 0 0\n2 1 0 0\n3 0 1 0\n4 0 0 1\n"
GOOD = msh(TET_NODES, "2\n1 2 2 8 1 1 3 2\n2 4 2 0 1 1 2 3 4\n")

BAD = [
    ("cut.msh", GOOD[:-30], "the file is cut off"),
    ("short.msh", GOOD.replace("2 4 2 0 1 1 2 3 4\n", ""), "cut off, or its counts wrong"),
    ("none.msh", GOOD[: GOOD.index("$Elements")], r"no section \$Elements"),
    ("old.msh", msh(version="1.0"), "version 1.0; expected 2.2 or 4.1"),
    ("40.msh", msh(version="4.0"), "version 4.0; expected 2.2 or 4.1"),
    ("word.msh", GOOD.replace("2 1 0 0", "2 one 0 0"), "section .Nodes: .*expected numbers"),
    ("nan.msh", GOOD.replace("2 1 0 0", "2 nan 0 0"), "isn't finite"),
    ("kind.msh", GOOD.replace("2 4 2 0 1", "2 29 2 0 1"), "element type 29"),
    ("node.msh", GOOD.replace("1 2 3 4\n", "1 2 3 77\n"), "names node 77"),
    ("half.msh", GOOD.replace("1 2 3 4\n", "1 2 3 3.5\n"), "got 3.5; expected a whole number"),
    (
        "flat.msh",
        msh(TET_NODES, "2\n1 2 2 8 1 1 3 2\n2 1 2 0 1 1 2\n"),
        "no solid cells; got 1 tri3, 1 line2",
    ),
    ("odd.msh", GOOD + "$Shifts\n1 2 3\n$EndShifts\n", "section .Shifts: unknown; expected Phys"),
    ("parts.msh", GOOD + "$GhostElements\n0\n$EndGhostElements\n", "a partitioned mesh; expected"),
    ("twice.msh", GOOD + GOOD[GOOD.index("$Nodes"):], "section .Nodes: it is there twice"),
    (
        "late.msh",
        msh("0 0 0 0\n", "0 0 0 0\n", "4.1") + "$Entities\n0 0 0 0\n$EndEntities\n",
        "it comes after .Elements, whose groups it holds",
    ),
    ("tags.msh", GOOD.replace("2 4 2 0 1", "2 4 -2 0 1"), "an element with -2 tags"),
    ("extra.msh", GOOD.replace("$EndNodes", "5 2 2 2\n$EndNodes"), "4 numbers more"),
    ("garbage.msh", bytes(range(256)) * 20, "not a Gmsh mesh"),
    ("garbage.vtk", bytes(range(256)) * 20, "expected '# vtk DataFile"),
    ("garbage.vtu", bytes(range(256)) * 20, "can't be read as vtu"),
    ("garbage.med", bytes(range(256)) * 20, "can't be read as HDF5"),
    ("garbage.bdf", bytes(range(256)) * 20, "not a text"),
    ("garbage.inp", bytes(range(256)) * 20, "garbage.inp"),
    ("garbage.e", bytes(range(256)) * 20, "garbage.e"),
    ("empty.vtu", "", "the file is empty"),
    ("part.step", "x", "a CAD file, not a mesh; expected a call of mesh_cad"),
    ("mesh.xyz", "x", "unknown kind of mesh file; got '.xyz'"),
    ("cut.bdf", BDF[:-9], "no ENDDATA"),
    ("half.bdf", BDF.replace("+       13      14\n", ""), "line 16: CHEXA: 1 with 6 nodes"),
    ("system.bdf", BDF.replace("GRID,3,,", "GRID,3,5,"), "line 8: GRID: in coordinate system 5"),
    ("other.bdf", BDF.replace("BULK\n", "BULK\nINCLUDE 'x.bdf'\n"), "line 5: INCLUDE: got .x.bdf"),
    ("number.bdf", BDF.replace("2.0D0", "2.0X0"), "got '2.0X0'; expected a coordinate"),
    ("away.bdf", BDF.replace("GRID,3,,1.0", "GRID,33,,1.0"), "names node 3, which isn't there"),
    (
        "polydata.vtk",
        "# vtk DataFile Version 2.0\nx\nASCII\nDATASET POLYDATA\n",
        "got POLYDATA; expected UNSTRUCTURED_GRID",
    ),
    (
        "cut.vtk",
        "# vtk DataFile Version 2.0\nx\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS 4 float\n0 0 0 1",
        "got 4 numbers; expected 12: cut off",
    ),
    (
        "cut.vtu",
        '<VTKFile type="UnstructuredGrid" version="0.1"><UnstructuredGrid><Piece Num',
        "can't be read as vtu: the file is cut off",
    ),
]  # fmt: skip


@pytest.mark.parametrize(("name", "content", "words"), BAD, ids=[case[0] for case in BAD])
def test_bad_files_give_one_clear_error(
    tmp_path: Path, name: str, content: str | bytes, words: str
) -> None:
    path = tmp_path / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(InputError, match=words) as caught:
        read_mesh(path)
    assert name in str(caught.value)
    assert len(str(caught.value)) < 600


def test_the_good_file_behind_the_bad_ones(tmp_path: Path) -> None:
    path = tmp_path / "good.msh"
    path.write_text(GOOD)
    mesh = read_mesh(path)
    assert mesh.cell_count == 1 and len(mesh.face_sets["surface_8"]) == 1


def test_any_cut_of_a_binary_file_is_noticed(tmp_path: Path) -> None:
    whole = tmp_path / "whole.msh"
    write_two_boxes(whole, Binary=1)
    content = whole.read_bytes()
    path = tmp_path / "cut.msh"
    for end in np.linspace(1, len(content) - 2, 40).astype(int):
        path.write_bytes(content[:end])
        with pytest.raises(InputError, match=r"cut\.msh"):
            read_mesh(path)


def test_absent_files_folders_and_scales(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="not found"):
        read_mesh(tmp_path / "absent.msh")
    with pytest.raises(InputError, match="is a folder"):
        read_mesh(tmp_path)
    with pytest.raises(InputError, match="scale; got -1"):
        read_mesh(tmp_path / "absent.msh", scale=-1.0)


def test_unknown_groups_name_the_nearest(tmp_path: Path) -> None:
    path = tmp_path / "good.msh"
    path.write_text(GOOD)
    with pytest.raises(InputError, match=r"got 'surface8'.*did you mean 'surface_8'"):
        select_faces(read_mesh(path), name="surface8")
