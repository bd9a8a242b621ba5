"""Meshes from Abaqus and CalculiX files: tokens, sets, surfaces, element types, faults."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from gpusim.errors import InputError
from gpusim.mesh import CELL_TYPES, Mesh, boundary_faces, set_faces
from gpusim.mesh.formats.abaqus.cards import read_cards
from gpusim.mesh.formats.abaqus.reader import read_inp
from gpusim.mesh.shape_functions import reference_nodes
from tests.support.deck_texts import (
    ELEMENT_LINES,
    LABELS,
    MODEL,
    NODE_LINES,
    POINTS,
    line_of,
    write,
)


def read(folder: Path, text: str) -> Mesh:
    return read_inp(write(folder, text))


def labels(numbers: np.ndarray) -> list[int]:
    return LABELS[numbers].tolist()


def test_nodes_elements_sets_and_surfaces(tmp_path: Path) -> None:
    mesh = read(tmp_path, MODEL)
    np.testing.assert_array_equal(mesh.points, POINTS)
    assert mesh.cells["hex8"].tolist() == [
        [0, 1, 4, 3, 6, 7, 10, 9],
        [1, 2, 5, 4, 7, 8, 11, 10],
    ]
    assert labels(mesh.node_sets["LEFT"]) == [11, 14, 17, 20]
    assert mesh.node_sets["ALL"].tolist() == list(range(12))
    assert mesh.cell_sets["BRICKS"].tolist() == [0, 1]
    end = set_faces(mesh, mesh.face_sets["END"])
    np.testing.assert_array_equal(end.area_vectors, [[15.0, 0.0, 0.0]])


def test_case_blanks_comments_and_continued_lines(tmp_path: Path) -> None:
    text = f"""** a comment
*Node,
 nset = All
{NODE_LINES}
** between
*ELEMENT, type=c3d8,
** inside a keyword
elset=Two Bricks
7, 11, 12, 15,
14, 17, 18, 21, 20
9, 12, 13, 16, 15, 18, 19, 22, 21,
*N set, NSet="some nodes", generate
12, 16, 2
18, 19
*nset, nset=more
some nodes, 22, 11,
"""
    mesh = read(tmp_path, text)
    assert labels(mesh.node_sets["some nodes"]) == [12, 14, 16, 18, 19]
    assert labels(mesh.node_sets["more"]) == [11, 12, 14, 16, 18, 19, 22]
    assert mesh.cell_sets["Two Bricks"].tolist() == [0, 1]
    assert mesh.cells["hex8"][0].tolist() == [0, 1, 4, 3, 6, 7, 10, 9]


def test_the_byte_order_mark_and_line_ends_of_windows(tmp_path: Path) -> None:
    (tmp_path / "windows.inp").write_bytes(b"\xef\xbb\xbf" + MODEL.replace("\n", "\r\n").encode())
    mesh = read_inp(tmp_path / "windows.inp")
    assert mesh.cells["hex8"][0].tolist() == [0, 1, 4, 3, 6, 7, 10, 9]


def test_sets_grow_and_name_other_sets(tmp_path: Path) -> None:
    text = MODEL + (
        "*NSET, NSET=left\n16\n*ELSET, ELSET=ONE\n9\n*NSET, NSET=OF ONE, ELSET=ONE\n"
        "*ELSET, ELSET=BOTH\nONE, 7\n*SURFACE, NAME=SIDES, TYPE=ELEMENT\nONE, S1\n7, S6\n"
        "*SURFACE, NAME=POINTS, TYPE=NODE\nLEFT, 22\n"
    )
    mesh = read(tmp_path, text)
    assert labels(mesh.node_sets["LEFT"]) == [11, 14, 16, 17, 20]
    assert labels(mesh.node_sets["OF ONE"]) == [12, 13, 15, 16, 18, 19, 21, 22]
    assert mesh.cell_sets["BOTH"].tolist() == [0, 1]
    vectors = set_faces(mesh, mesh.face_sets["SIDES"]).area_vectors
    np.testing.assert_allclose(vectors, [[0, 0, -12], [-15, 0, 0]], atol=1e-14)
    assert labels(mesh.node_sets["POINTS"]) == [11, 14, 16, 17, 20, 22]


def test_a_range_may_run_over_numbers_that_are_not_defined(tmp_path: Path) -> None:
    mesh = read(tmp_path, MODEL + "*NSET, NSET=WIDE, GENERATE\n1, 1000, 3\n")
    assert labels(mesh.node_sets["WIDE"]) == [13, 16, 19, 22]


def test_include_is_relative_to_its_file(tmp_path: Path) -> None:
    (tmp_path / "parts").mkdir()
    write(tmp_path / "parts", f"*NODE\n{NODE_LINES}\n*INCLUDE, INPUT=cells.txt\n", "nodes.inp")
    write(tmp_path / "parts", f"*ELEMENT, TYPE=C3D8, ELSET=E\n{ELEMENT_LINES}\n", "cells.txt")
    mesh = read(tmp_path, "*INCLUDE, INPUT=parts/nodes.inp\n*NSET, NSET=ONE\n15\n")
    assert mesh.cell_count == 2
    assert labels(mesh.node_sets["ONE"]) == [15]


def test_errors_in_an_included_file_name_that_file(tmp_path: Path) -> None:
    write(tmp_path, f"*NODE\n{NODE_LINES}\n23, 1.0, zero, 0.\n", "nodes.inp")
    with pytest.raises(InputError, match=r"nodes\.inp:14: \*NODE: not a number; got 'zero'"):
        read(tmp_path, "*INCLUDE, INPUT=nodes.inp\n")


def test_fortran_numbers_missing_coordinates_and_nodes_given_again(tmp_path: Path) -> None:
    text = MODEL + "*NODE\n1, 1.5D1\n2, , 2.\n22, 6., 3., 5.5\n"
    mesh = read(tmp_path, text)
    np.testing.assert_array_equal(mesh.points[:2], [[15.0, 0.0, 0.0], [0.0, 2.0, 0.0]])
    np.testing.assert_array_equal(mesh.points[-1], [6.0, 3.0, 5.5])
    assert mesh.dangling_nodes.tolist() == [0, 1]


def test_shells_on_faces_become_face_sets(tmp_path: Path) -> None:
    text = MODEL + "*ELEMENT, TYPE=CPS4, ELSET=Skin\n70, 13, 16, 22, 19\n71, 11, 12, 18, 17\n"
    mesh = read(tmp_path, text)
    vectors = set_faces(mesh, mesh.face_sets["Skin"]).area_vectors
    np.testing.assert_allclose(vectors, [[0, -10, 0], [15, 0, 0]], atol=1e-14)
    assert "Skin" not in mesh.cell_sets


def test_sets_of_shells_are_face_sets(tmp_path: Path) -> None:
    """As Gmsh writes physical surfaces: *ELSET with the numbers of the shells."""
    shells = "*ELEMENT, TYPE=CPS4, ELSET=S1\n70, 13, 16, 22, 19\n71, 11, 12, 18, 17\n"
    loose = "*ELEMENT, TYPE=CPS3, ELSET=S2\n72, 11, 13, 22\n73, 11, 12, 15\n"
    sets = "*ELSET, ELSET=A\n71,\n*ELSET, ELSET=B\nS1, 72\n*ELSET, ELSET=C\n71, 9\n"
    mesh = read(tmp_path, MODEL + shells + loose + sets)
    assert {name: len(pairs) for name, pairs in mesh.face_sets.items()} == {
        "END": 1, "S1": 2, "A": 1, "B": 2, "C": 1
    }  # fmt: skip
    vectors = set_faces(mesh, mesh.face_sets["A"]).area_vectors
    np.testing.assert_allclose(vectors, [[0, -10, 0]], atol=1e-14)
    assert mesh.cell_sets["C"].tolist() == [1]
    assert not {"S1", "A", "B"} & mesh.cell_sets.keys()


@pytest.mark.parametrize(
    ("written", "kind"),
    [
        ("C3D8", "hex8"), ("C3D8RH", "hex8"), ("C3D20R", "hex20"), ("C3D27", "hex27"),
        ("C3D4", "tet4"), ("C3D10", "tet10"), ("C3D6", "wedge6"), ("C3D15", "wedge15"),
        ("C3D5", "pyramid5"),
    ],
)  # fmt: skip
def test_every_element_type_and_its_faces(written: str, kind: str, tmp_path: Path) -> None:
    """The faces S1, S2, ... of each type, by their corners as the Abaqus manual lists them."""
    corners = {
        "hex8": ["1234", "5876", "1562", "2673", "3784", "4851"],
        "tet4": ["123", "142", "243", "341"],
        "wedge6": ["123", "465", "1452", "2563", "3641"],
        "pyramid5": ["1234", "152", "253", "354", "451"],
    }[CELL_TYPES[kind].linear]
    points = reference_nodes(kind) * [2.0, 3.0, 5.0] + [7.0, 1.0, 0.0]
    count = len(points)
    lines = ["*NODE"]
    lines += [f"{k + 1}, {x!r}, {y!r}, {z!r}" for k, (x, y, z) in enumerate(points.tolist())]
    lines += [f"*ELEMENT, TYPE={written}, ELSET=E"]
    row = ["1", *[str(k + 1) for k in range(count)]]
    lines += [
        ", ".join(row[k : k + 16]) + "," * (k + 16 < len(row)) for k in range(0, len(row), 16)
    ]
    for side in range(len(corners)):
        lines += [f"*SURFACE, NAME=F{side + 1}", f"E, S{side + 1}"]
    mesh = read(tmp_path, "\n".join(lines))
    assert list(mesh.cells) == [kind]
    for side, text in enumerate(corners, start=1):
        face = set_faces(mesh, mesh.face_sets[f"F{side}"])
        on_face = {int(node) for node in face.nodes[0, :4] if node >= 0}
        assert on_face == {int(letter) - 1 for letter in text}
    assert len(boundary_faces(mesh)) == len(corners)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", r"no keyword found"),
        ("11, 0., 0., 0.\n*NODE\n", r":1: data before the first keyword"),
        ("*NODE\n11, 0., 0., 0.\n", r"no solid elements; got no elements"),
        ("*ELEMENT, TYPE=C3D8\n1,1,2,3,4,5,6,7,8\n", r"no nodes"),
        (MODEL.replace("C3D8", "C3D88"), r":16: \*ELEMENT: element type; got TYPE=C3D88.*C3D8\b"),
        (MODEL.replace("TYPE=C3D8,", ""), r"got TYPE=\(none\)"),
        (MODEL.replace("*ELEMENT, TYPE=C3D8", "*ELEMENT, TYPE=S4"), r":17: \*ELEMENT: element 7"),
        (MODEL.replace("18, 21, 20", "18, 21, 99"), r":17: .*7: undefined node; got node 99"),
        (MODEL.replace("18, 21, 20", "18, 2l, 20"), r":17: .*not a whole number; got '2l'"),
        (MODEL.replace("18, 21, 20", "18, 21"), r":17: .*element 7; got 7 node numbers"),
        (MODEL.replace("9, 12, 13", "7, 12, 13"), r"element numbers used twice; got element 7"),
        (MODEL.replace("13, 16, 19, 22\n*S", "13, 16, 91, 22\n*S"), r":22: \*NSET: undefined node"),
        (MODEL + "*NSET, NSET=A\nRIHGT\n", r"unknown node set; got 'RIHGT'.*did you mean 'RIGHT'"),
        (MODEL + "*NSET, GENERATE\n1, 2\n", r"\*NSET: no name"),
        (MODEL + "*NSET, NSET=A, GENERATE\n5, 2\n", r"expected first <= last"),
        (MODEL + "*NSET, NSET=A, GENERATE\n5\n", r"GENERATE; got 1 fields"),
        (MODEL + "*SURFACE, NAME=A\n9, S7\n", r":26: \*SURFACE: surface; got 9, S7"),
        (MODEL + "*SURFACE, NAME=A\n9\n", r"expected an element or element set"),
        (MODEL + "*SURFACE, NAME=A, TYPE=CUTTING SURFACE\n", r"expected TYPE=ELEMENT or NODE"),
        (MODEL + "*INCLUDE, INPUT=none.inp\n", r":25: \*INCLUDE: got 'none.inp': .*not found"),
        (MODEL + "*INCLUDE\n", r"\*INCLUDE: no file"),
        (MODEL + "*INCLUDE, INPUT=two.inp\n", r"the file includes itself"),
        (MODEL.replace("*NODE,", "*NODE, SYSTEM=S,"), r"SYSTEM=S isn't .* SYSTEM=R or C"),
        (MODEL + "*PART, NAME=A\n*PART, NAME=B\n", r":26: \*PART: inside of \*PART"),
        (MODEL + "*INSTANCE, NAME=A\n1., 0., 0.\n", r"\*INSTANCE: inside of no assembly"),
        (MODEL.replace("12, 2.0, 0.0", "12, nan, 0.0"), r":5: \*NODE: not a number; got 'nan'"),
    ],
)  # fmt: skip
def test_faults_name_file_and_line(text: str, message: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=message) as caught:
        read(tmp_path, text)
    assert "two.inp" in str(caught.value)


def test_a_cut_off_element_is_named(tmp_path: Path) -> None:
    text = MODEL[: MODEL.index("22, 21")]
    with pytest.raises(InputError, match=rf":{line_of(MODEL, '9, 12, 13')}: .*element 9.*cut off"):
        read(tmp_path, text)


def test_an_inverted_element_is_named_by_its_number(tmp_path: Path) -> None:
    text = MODEL.replace("9, 12, 13, 16, 15, 18", "9, 13, 12, 16, 15, 18")
    with pytest.raises(InputError, match=r"two\.inp: .*inverted.*two\.inp:18: .*element 9 \("):
        read(tmp_path, text)


def test_surface_of_a_face_that_the_element_lacks(tmp_path: Path) -> None:
    tet = "*NODE\n1,0,0,0\n2,1,0,0\n3,0,1,0\n4,0,0,1\n*ELEMENT, TYPE=C3D4, ELSET=E\n5,1,2,3,4\n"
    with pytest.raises(InputError, match=r"element 5 has no face 6; expected 1 … 4 for tet4"):
        read(tmp_path, tet + "*SURFACE, NAME=A\nE, S6\n")


def test_files_that_are_not_text(tmp_path: Path) -> None:
    path = tmp_path / "two.inp"
    path.write_bytes(b"*NODE\n\x00\x01\x02")
    with pytest.raises(InputError, match="not a text file"):
        read_inp(path)
    with pytest.raises(InputError, match=r"absent\.inp: not found"):
        read_inp(tmp_path / "absent.inp")
    with pytest.raises(InputError, match="is a folder"):
        read_inp(tmp_path)


def test_cards_keep_lines_and_parameters(tmp_path: Path) -> None:
    text = '*Solid  Section, ElSet="A, B", material = X\n1.\n\n** no\n,\n2., 3.,\n'
    (card,) = read_cards(write(tmp_path, text))
    assert (card.keyword, card.shown, card.line) == ("SOLIDSECTION", "*SOLID SECTION", 1)
    assert card.parameters == {"ELSET": "A, B", "MATERIAL": "X"}
    assert list(card.rows()) == [(2, ["1."]), (6, ["2.", "3."])]
