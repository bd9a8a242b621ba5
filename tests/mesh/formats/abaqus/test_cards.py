"""Included files are text put in place of *INCLUDE: a card may begin in one and end in another."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from gpusim.deck import load_deck
from gpusim.errors import InputError
from gpusim.mesh.formats.abaqus.reader import read_inp
from tests.support.deck_texts import write

LOWER = "1, 0, 0, 0\n2, 1, 0, 0\n3, 1, 1, 0\n4, 0, 1, 0\n"
UPPER = "5, 0, 0, 1\n6, 1, 0, 1\n7, 1, 1, 1\n8, 0, 1, 1\n"
NODES = f"*NODE, NSET=ALL\n{LOWER}{UPPER}"
CUBE = "*ELEMENT, TYPE=C3D8, ELSET=E\n1, 1, 2, 3, 4, 5, 6, 7, 8\n"
SECTION = "*MATERIAL, NAME=M\n*ELASTIC\n1000., 0.\n*SOLID SECTION, ELSET=E, MATERIAL=M\n"
FIXED = "*BOUNDARY\n1, 1, 3\n2, 2, 3\n3, 3, 3\n4, 3, 3\n*STEP\n*STATIC\n"
PULL = "*CLOAD\n5, 3, 1.\n6, 3, 1.\n7, 3, 1.\n8, 3, 1.\n"


def rise(folder: Path, nodes: str = NODES, sets: str = "", load: str = PULL) -> float:
    """Of the top of a unit cube with E = 1000 and nu = 0: the force over 1000."""
    text = nodes + CUBE + sets + SECTION + FIXED + load + "*END STEP\n"
    solution = load_deck(write(folder, text)).solve(tolerance=1e-9)[0]
    return float(solution.u[-1, 2])


def test_a_load_goes_on_after_the_file_it_begins_in(tmp_path: Path) -> None:
    write(tmp_path, "*CLOAD\n5, 3, 1.\n6, 3, 1.\n", "load.txt")
    load = "*INCLUDE, INPUT=load.txt\n7, 3, 1.\n8, 3, 1.\n"
    assert rise(tmp_path, load=load) == pytest.approx(0.004, rel=1e-6)


def test_a_set_goes_on_after_the_file_it_begins_in(tmp_path: Path) -> None:
    write(tmp_path, "*NSET, NSET=TOP\n5, 6", "set.txt")  # without the end of its last line
    sets = "*INCLUDE,\nINPUT=set.txt\n** and\n7, 8\n"
    assert rise(tmp_path, sets=sets, load="*CLOAD\nTOP, 3, 1.\n") == pytest.approx(0.004, rel=1e-6)


def test_elements_go_on_after_the_file_they_begin_in(tmp_path: Path) -> None:
    write(tmp_path, CUBE, "cube.txt")
    more = "9, 2, 0, 0\n10, 2, 1, 0\n11, 2, 0, 1\n12, 2, 1, 1\n"
    text = f"{NODES}{more}*INCLUDE, INPUT=cube.txt\n2, 2, 9, 10, 3, 6, 11, 12, 7\n"
    mesh = read_inp(write(tmp_path, text))
    assert mesh.cells["hex8"].tolist()[1] == [1, 8, 9, 2, 5, 10, 11, 6]
    assert mesh.cell_sets["E"].tolist() == [0, 1]


def test_a_file_may_hold_data_only(tmp_path: Path) -> None:
    write(tmp_path, LOWER, "lower.txt")
    nodes = f"*NODE, NSET=ALL\n*INCLUDE, INPUT=lower.txt\n{UPPER}"
    assert rise(tmp_path, nodes=nodes) == pytest.approx(0.004, rel=1e-6)


def test_a_file_may_end_within_a_card_of_an_including_file(tmp_path: Path) -> None:
    write(tmp_path, LOWER, "lower.txt")
    write(tmp_path, "*HEADING\na cube\n*NODE, NSET=ALL\n*INCLUDE, INPUT=lower.txt\n", "head.txt")
    mesh = read_inp(write(tmp_path, f"*INCLUDE, INPUT=head.txt\n{UPPER}{CUBE}"))
    assert mesh.node_sets["ALL"].tolist() == list(range(8))
    np.testing.assert_array_equal(mesh.points[[3, 4, 6]], [[0, 1, 0], [0, 0, 1], [1, 1, 1]])


def test_messages_name_file_and_line_of_each_part_of_a_card(tmp_path: Path) -> None:
    write(tmp_path, "** heights\n*NODE\n1, 0, 0, 0\n", "head.txt")
    write(tmp_path, "2, 1, O, 0\n", "more.txt")
    text = "*INCLUDE, INPUT=head.txt\n*INCLUDE, INPUT=more.txt\n3, l, 1, 0\n"
    with pytest.raises(InputError, match=r"more\.txt:1: \*NODE: not a number; got 'O'"):
        read_inp(write(tmp_path, text))
    write(tmp_path, "2, 1, 0, 0\n", "more.txt")
    with pytest.raises(InputError, match=r"two\.inp:3: \*NODE: not a number; got 'l'"):
        read_inp(write(tmp_path, text))
    write(tmp_path, "*NODE\n1, 0, 0, 0, 0.\n", "head.txt")
    write(tmp_path, "3, 4\n", "more.txt")
    with pytest.raises(InputError, match=r"more\.txt:1: data before the first keyword; got '3, 4'"):
        read_inp(write(tmp_path, "title\n*INCLUDE, INPUT=more.txt\n*NODE\n"))
