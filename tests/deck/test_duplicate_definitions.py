"""What a file defines twice is refused, with the place of both: elements, materials, names."""

from __future__ import annotations

from pathlib import Path

import pytest

from gpusim.deck import load_deck
from gpusim.errors import InputError
from gpusim.mesh import Mesh, box, read_mesh
from gpusim.mesh.formats.abaqus.reader import read_inp
from tests.support.deck_texts import FIXED, MATERIAL, MODEL, deck, line_of, step, write

LOAD = step("*CLOAD", "22, 1, 1.")
TETS = "GRID,1,,0.,0.,0.\nGRID,2,,1.,0.,0.\nGRID,3,,0.,1.,0.\nGRID,4,,0.,0.,1.\nGRID,5,,1.,1.,1.\n"
MSH = """$MeshFormat
4.1 0 8
$EndMeshFormat
$Nodes
1 5 1 5
3 1 0 5
1
2
3
4
5
0 0 0
1 0 0
0 1 0
0 0 1
1 1 1
$EndNodes
$Elements
1 2 7 8
3 1 4 2
7 1 2 3 4
8 2 5 3 4
$EndElements
"""


@pytest.mark.parametrize(
    ("more", "first", "message"),
    [
        ("*MATERIAL, NAME=Steel\n*ELASTIC\n500., 0.", "*MATERIAL", "second material of one name"),
        ("*ELASTIC\n500., 0.", "*ELASTIC", "a second one for one material"),
        ("*SOLID SECTION, ELSET=Bricks, MATERIAL=STEEL", "*SOLID", "a second section for set"),
        ("*SURFACE, NAME=End\n7, S3", "*SURFACE", "a second surface of one name"),
    ],
)
def test_cards_of_a_deck(more: str, first: str, message: str, tmp_path: Path) -> None:
    text = deck(more + "\n", LOAD)
    with pytest.raises(InputError, match=message) as caught:
        load_deck(write(tmp_path, text))
    second = len((MODEL + MATERIAL + FIXED).splitlines()) + 1
    assert f"two.inp:{second}: *" in str(caught.value)
    assert f"two.inp:{line_of(text, first)}: *" in str(caught.value)


@pytest.mark.parametrize(
    ("card", "what"),
    [
        ("*AMPLITUDE, NAME=A\n0., 0., 1., 1.\n", "amplitude"),
        ("*ORIENTATION, NAME=A\n1., 0., 0., 0., 1., 0.\n", "orientation"),
        ("*ORIENTATION, NAME=A, SYSTEM=CYLINDRICAL\n", "orientation"),
    ],
)
def test_names_of_a_deck(card: str, what: str, tmp_path: Path) -> None:
    assert load_deck(write(tmp_path, deck(card, LOAD))).steps
    with pytest.raises(InputError, match=f"a second {what} of one name; got 'a'"):
        load_deck(write(tmp_path, deck(card, card.replace("=A", "=a"), LOAD)))


def test_an_element_number_of_nastran(tmp_path: Path) -> None:
    text = TETS + "CTETRA,7,1,1,2,3,4\nCTETRA,{},1,2,5,3,4\n"
    assert read_mesh(write(tmp_path, text.format(8), "a.bdf")).cell_count == 2
    with pytest.raises(InputError, match=r"line 7: .* element 7; got the first at .*line 6"):
        read_mesh(write(tmp_path, text.format(7), "b.bdf"))


def test_an_element_number_of_gmsh(tmp_path: Path) -> None:
    assert read_mesh(write(tmp_path, MSH, "a.msh")).cell_count == 2
    with pytest.raises(InputError, match=r"\$Elements: 1 element numbers used twice; got element"):
        read_mesh(write(tmp_path, MSH.replace("8 2 5", "7 2 5"), "b.msh"))


def test_an_element_number_of_gmsh_2(tmp_path: Path) -> None:
    """Gmsh repeats an element, number and all, for each of its groups: with the same nodes."""
    nodes = "5\n1 0 0 0\n2 1 0 0\n3 0 1 0\n4 0 0 1\n5 1 1 1\n"
    head = f"$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n{nodes}$EndNodes\n$Elements\n"
    rows = "3\n7 4 2 1 1 1 2 3 4\n7 4 2 2 1 1 2 3 4\n{} 4 2 2 1 2 5 3 4\n$EndElements\n"
    mesh = read_mesh(write(tmp_path, head + rows.format(8), "a.msh"))
    assert {name: len(one) for name, one in mesh.cell_sets.items()} == {
        "volume_1": 1,
        "volume_2": 2,
    }
    with pytest.raises(InputError, match="element number 7 names different nodes"):
        read_mesh(write(tmp_path, head + rows.format(7), "b.msh"))


def test_two_cells_in_one_place(tmp_path: Path) -> None:
    """Under different numbers, in another order of nodes: in every format, and in a mesh."""
    brick = box((1, 2, 3), (2, 1, 1))
    cells = brick.cells["hex8"]
    turned = cells[1][[1, 2, 3, 0, 5, 6, 7, 4]]
    with pytest.raises(InputError, match="1 cells have the corners of another; got cells 1 and 2"):
        Mesh(brick.points, {"hex8": [*cells, turned]})
    twin = "*ELEMENT, TYPE=C3D8\n31, 12, 13, 16, 15, 18, 19, 22, 21\n"
    with pytest.raises(InputError, match=r"got \S*two\.inp:18: \*ELEMENT: element 9 and .* 31"):
        read_inp(write(tmp_path, MODEL + twin))
    with pytest.raises(InputError, match=r"CTETRA 7 and .*CTETRA 9"):
        text = TETS + "CTETRA,7,1,1,2,3,4\nCTETRA,8,1,2,5,3,4\nCTETRA,9,1,2,3,1,4\n"
        read_mesh(write(tmp_path, text, "a.bdf"))


def test_a_system_that_is_open_where_a_part_begins(tmp_path: Path) -> None:
    part = f"*PART, NAME=P\n{MODEL.split('*HEADING')[1].split('bricks', 1)[1]}*END PART\n"
    rest = "*ASSEMBLY, NAME=A\n*INSTANCE, NAME=I, PART=P\n*END INSTANCE\n*END ASSEMBLY\n"
    system = "*SYSTEM\n0., 0., 9.\n"
    with pytest.raises(InputError, match=r"inp:3: \*PART: a part begins while .*inp:1: \*SYSTEM"):
        read_inp(write(tmp_path, system + part + rest))
    assert read_inp(write(tmp_path, f"{system}*SYSTEM\n{part}{rest}")).bounds[1, 2] == 5.0
