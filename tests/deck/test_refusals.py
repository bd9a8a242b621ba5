"""What a deck may not hold: named with file and line, all at once."""

from __future__ import annotations

from pathlib import Path

import pytest

from gpusim.deck import load_deck
from gpusim.errors import InputError
from tests.support.deck_texts import FIXED, MATERIAL, MODEL, deck, line_of, step, write

LOAD = step("*CLOAD", "22, 1, 1.")


def refused(folder: Path, text: str) -> str:
    with pytest.raises(InputError) as caught:
        load_deck(write(folder, text))
    assert "two.inp" in str(caught.value)
    return str(caught.value)


@pytest.mark.parametrize(
    ("card", "message"),
    [
        ("*CREEP\n1., 2., 0.", "not supported; expected a deck of *STATIC steps"),
        ("*CONTACT PAIR, INTERACTION=A\nB, C", "not supported"),
        ("*TIE, NAME=T\nLEFT, B", "unknown surface; got 'B'"),
        ("*TIE, NAME=T\nRIHGT, END", "unknown node set; got 'RIHGT'"),
        ("*TIE, NAME=T\nEND", "expected one with two surfaces"),
        ("*TIE, NAME=T\nLEFT, END", "node 11 lies off the surface END"),
        ("*TIE, NAME=T, ADJUST=MAYBE\nRIGHT, END", "expected ADJUST=YES or NO"),
        ("*TIE, NAME=T, CYCLIC SYMMETRY\nA, B", "parameter CYCLICSYMMETRY isn't supported"),
        ("*MPC\nPLANE, 1, 2, 3", "not supported"),
        ("*RIGID BODY, NSET=RIGHT", "not supported"),
        ("*MATERAIL, NAME=A", "(did you mean 'MATERIAL'?)"),
        ("*ORIENTATION, NAME=O, DEFINITION=OFFSET TO NODES", "TO NODES isn't supported"),
        ("*INITIAL CONDITIONS, TYPE=PLASTIC STRAIN\n7, 1, 1.", "TYPE=PLASTIC STRAIN isn't"),
        ("*INITIAL CONDITIONS, TYPE=STRESS\n7, 9, 1., 0., 0., 0., 0., 0.", "got 9; expected 1 … 8"),
        ("*INITIAL CONDITIONS, TYPE=STRESS\n7, 1, 1., 0., 0., 0.", "got 6 fields; expected"),
        ("*INITIAL CONDITIONS, TYPE=TEMPERATURE, USER", "parameter USER isn't supported"),
        ("*RESTART, READ", "READ isn't supported"),
        ("*AMPLITUDE, NAME=A, DEFINITION=PERIODIC\n1, 2., 0., 0.", "expected DEFINITION=TABULAR"),
        ("*AMPLITUDE, NAME=A, VALUE=ABSOLUTE\n0., 0., 1., 1.", "expected VALUE=RELATIVE"),
        ("*AMPLITUDE, NAME=A\n0., 0., 1.", "got 3 numbers; expected NAME=name and pairs"),
        ("*AMPLITUDE, NAME=A\n1., 0., 0., 1.", "pairs of growing time"),
        ("*CLOAD\n22, 1, 1.", "outside of a step; expected *STEP before it"),
        ("*DLOAD\n7, P1, 1.", "outside of a step"),
        ("*END STEP", "outside of a step"),
        ("*STATIC", "outside of a step"),
        ("*ELEMENT, TYPE=C3D8R\n8, 11, 12, 15, 14, 17, 18, 21, 20", "C3D8R is one integration"),
        ("*ELEMENT, TYPE=C3D8I\n8, 11, 12, 15, 14, 17, 18, 21, 20", "C3D8I beside C3D8"),
        ("*ELEMENT, TYPE=S4, ELSET=A\n8, 11, 12, 15, 14", "element type S4 isn't supported"),
        ("*ELEMENT, TYPE=SPRINGA\n8, 11, 12", "element type SPRINGA isn't supported"),
        ("*TRANSFORM, NSET=RIGHT\n0., 1., 0.", "expected TYPE=R or C and the points a and b"),
        ("*TRANSFORM, NSET=RIGHT\n0., 1., 0., 0., 2., 0.", "no direction at node 13"),
        ("*TRANSFORM, NSET=LEFT, TYPE=C\n0., 0., 0., 0., 0., 1.", "no direction at node 11"),
        ("*EQUATION\n2\n13, 1, 1.", "got 1 terms; expected 2 (cut off?)"),
        ("*EQUATION\n2, 13\n13, 1, 1.", "expected the number of terms"),
        ("*EQUATION\n1\n13, 4, 1.", "degree of freedom; got 4; expected 1, 2 or 3"),
        ("*EQUATION\n1\n99, 1, 1.", "undefined node; got node 99"),
        ("*BOUNDARY\n13, 1, 1, 0.5", "displacement before the first step; got 0.5"),
        ("*BOUNDARY\n13, 7", "degree of freedom; got 7 … 7"),
        ("*BOUNDARY\nRIGTH, 1", "unknown node set; got 'RIGTH'"),
        ("*BOUNDARY\n13", "expected node or set, degree of freedom"),
        ("*BOUNDARY, TYPE=VELOCITY\n13, 1", "TYPE=VELOCITY isn't supported"),
        ("*BOUNDARY, FIXED\n13, 1", "parameter FIXED isn't supported"),
    ],
)  # fmt: skip
def test_model_cards(card: str, message: str, tmp_path: Path) -> None:
    text = deck(card + "\n", LOAD)
    found = refused(tmp_path, text)
    assert message in found
    first = text[: text.index(card)].count("\n") + 1
    lines = range(first, first + 1 + card.count("\n"))
    assert any(f"two.inp:{line}: *" in found for line in lines)


@pytest.mark.parametrize(
    ("cards", "message"),
    [
        ("*CLOAD\n22, 4, 1.", ":{}: *CLOAD: degree of freedom; got 4"),
        ("*CLOAD\n22, 1", ":{}: *CLOAD: got '22, 1'"),
        ("*CLOAD\n22, 1, one", ":{}: *CLOAD: not a number; got 'one'"),
        ("*CLOAD\n22, 1, 1.e999", ":{}: *CLOAD: not a number"),
        ("*CLOAD\n22, x, 1.", ":{}: *CLOAD: not a whole number; got 'x'"),
        ("*CLOAD\nNOBODY, 1, 1.", ":{}: *CLOAD: unknown node set; got 'NOBODY'"),
        ("*CLOAD, AMPLITUDE=A\n22, 1, 1.", "*CLOAD: unknown amplitude; got 'A'"),
        ("*CLOAD, OP=OLD\n22, 1, 1.", "*CLOAD: OP=OLD isn't supported; expected OP=NEW or MOD"),
        ("*CLOAD, SECTOR=2\n22, 1, 1.", "parameter SECTOR isn't supported"),
        ("*DLOAD\n7, P2NP, 1.", ":{}: *DLOAD: load P2NP isn't supported; expected P1"),
        ("*DLOAD\n99, P2, 1.", ":{}: *DLOAD: undefined element; got element 99"),
        ("*DLOAD\nBRICK, P2, 1.", "got 'BRICK'; expected one of BRICKS (did you mean 'BRICKS'?)"),
        ("*DLOAD\n7, P2", ":{}: *DLOAD: got '7, P2'"),
        ("*DLOAD\n7, GRAV, 9.81, 0., 0.", ":{}: *DLOAD: got 2 further numbers; expected 3"),
        ("*DLOAD\n7, GRAV, 9.81, 0., 0., 0.", ":{}: *DLOAD: direction; got [0.0, 0.0, 0.0]"),
        ("*DLOAD\n7, CENTRIF, 1., 0., 0., 0., 1.", ":{}: *DLOAD: got 4 further numbers"),
        ("*DLOAD\n7, CENTRIF, -1., 0., 0., 0., 1., 0., 0.", "CENTRIF; got -1; expected the square"),
        ("*DSLOAD\nEND, TRVEC, 1.", ":{}: *DSLOAD: got 'END, TRVEC, 1.'"),
        ("*DSLOAD\nENDS, P, 1.", "unknown surface; got 'ENDS'"),
        ("*TEMPERATURE\nALL, 1., 2.", ":{}: *TEMPERATURE: got 'ALL, 1., 2.'"),
        ("*BOUNDARY\n13, 1, 6, 0.5", "degree of freedom; got 1 … 6"),
        ("*BOUNDARY\n13, 11, 11, 0.5", "degree of freedom; got 11 … 11"),
        ("*STEP", ":{}: *STEP: inside of a step; expected *END STEP"),
        ("*STATIC\n1., -1.", ":{}: *STATIC: time of the step; got -1; expected > 0"),
        ("*VISCO", ":{}: *VISCO: not supported"),
    ],
)  # fmt: skip
def test_step_cards(cards: str, message: str, tmp_path: Path) -> None:
    text = deck(step(cards))
    line = line_of(text, cards.splitlines()[-1])
    if cards == "*STEP":
        line = len(text.splitlines()) - 1
    assert message.format(line) in refused(tmp_path, text)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("*ELASTIC\n200., 0.25\n", "", "STEEL has no *ELASTIC"),
        ("200., 0.25", "200., 0.5", "*MATERIAL: STEEL: Isotropic: nu out of range"),
        ("200., 0.25", "200.", "*ELASTIC: got 1 numbers; expected E, nu"),
        ("200., 0.25", "200., 0.25, 0.\n190., 0.25, 100.", "depends on temperature; got 2 rows"),
        ("*ELASTIC", "*ELASTIC, TYPE=TRACTION", "TYPE=TRACTION isn't supported"),
        ("*EXPANSION", "*EXPANSION, TYPE=ANISO", "TYPE=ANISO isn't supported"),
        ("MATERIAL=STEEL", "MATERIAL=STEAL", "unknown material; got 'STEAL'"),
        ("MATERIAL=STEEL", "MATERIAL=STEEL, ORIENTATION=O", "unknown orientation; got 'O'"),
        ("ELSET=BRICKS, M", "ELSET=BRIKCS, M", "unknown element set; got 'BRIKCS'"),
        ("*MATERIAL, NAME=STEEL", "*MATERIAL", "*MATERIAL: no name"),
        ("*MATERIAL, NAME=STEEL\n", "", "*ELASTIC: outside of a material"),
        ("*SOLID SECTION, ELSET=BRICKS", "*ELSET, ELSET=A\n7\n*SOLID SECTION, ELSET=A",
         "1 elements have no *SOLID SECTION; got element 9"),
    ],
)  # fmt: skip
def test_materials(old: str, new: str, message: str, tmp_path: Path) -> None:
    assert old in MATERIAL
    text = deck(LOAD, material=MATERIAL.replace(old, new))
    assert message in refused(tmp_path, text)


def test_all_unsupported_features_in_one_error(tmp_path: Path) -> None:
    text = deck(
        "*CREEP\n100., 0.\n",
        step("*CLOAD, SECTOR=1", "22, 1, 1.", "*VISCO"),
        model=MODEL + "*ELEMENT, TYPE=B31\n8, 11, 12\n",
    )
    found = refused(tmp_path, text).splitlines()
    assert found[0].endswith("two.inp: 4 faults")
    for part, line in zip(["TYPE=B31", "*CREEP", "SECTOR", "*VISCO"], found[1:], strict=True):
        assert f"two.inp:{line_of(text, part)}: *" in line


def test_all_wrong_numbers_in_one_error(tmp_path: Path) -> None:
    text = deck(step("*CLOAD", "22, 9, 1.", "*DLOAD", "7, P1, x", "*BOUNDARY", "NIL, 1"))
    found = refused(tmp_path, text).splitlines()
    assert found[0].endswith("two.inp: 3 faults")
    assert [line.split(": ")[1] for line in found[1:]] == ["*CLOAD", "*DLOAD", "*BOUNDARY"]


def test_cut_off_and_empty_decks(tmp_path: Path) -> None:
    assert "the step doesn't end" in refused(tmp_path, deck(LOAD.replace("*END STEP\n", "")))
    assert "no step" in refused(tmp_path, deck())
    assert "expected *STATIC in the step" in refused(tmp_path, deck("*STEP\n*END STEP\n"))


def test_contradicting_equations(tmp_path: Path) -> None:
    tie = "*EQUATION\n2\n13, 1, 1., 22, 1, -1.\n"
    text = deck(tie, step("*BOUNDARY", "13, 1, 1, 0.5", "22, 1, 1, 0.25"))
    with pytest.raises(InputError, match="contradict each other or the supports"):
        load_deck(write(tmp_path, text)).solve()


def test_free_motions_with_equations(tmp_path: Path) -> None:
    tie = "*EQUATION\n2\n13, 1, 1., 22, 1, -1.\n"
    text = deck(tie, LOAD, fixed="*BOUNDARY\nLEFT, 1, 2\n")
    with pytest.raises(InputError, match="can move freely; got free translation z; expected"):
        load_deck(write(tmp_path, text)).solve()


@pytest.mark.parametrize("load", ["GRAV, 9.81, 0., 0., -1.", "CENTRIF, 1., 0., 0., 0., 0., 0., 1."])
def test_body_forces_without_density(load: str, tmp_path: Path) -> None:
    text = deck(step("*DLOAD", f"BRICKS, {load}"), material=MATERIAL.replace("*DENSITY\n3.\n", ""))
    line = line_of(text, f"BRICKS, {load}")
    assert f"two.inp:{line}: *DLOAD: {load.split(',')[0]} on elements without *DENSITY; got " in (
        refused(tmp_path, text)
    )


def test_models_of_steps(tmp_path: Path) -> None:
    two = deck(LOAD, step("*BOUNDARY", "13, 1"), fixed=FIXED)
    found = load_deck(write(tmp_path, two))
    with pytest.raises(InputError, match="hold different degrees of freedom"):
        found.model(1, 2)
    with pytest.raises(InputError, match="step; got 3; expected 1 … 2"):
        found.model(3)
    with pytest.raises(InputError, match="no step"):
        found.model()
    turned = "*NSET, NSET=ONE\n22\n*TRANSFORM, NSET=ONE, TYPE=R\n1., 1., 0., -1., 1., 0.\n"
    skew = load_deck(write(tmp_path, deck(turned, LOAD, step("*BOUNDARY", "22, 1"))))
    assert [len(one.constraints) for one in skew.steps] == [0, 1]
    with pytest.raises(InputError, match="hold different degrees of freedom"):
        skew.model(1, 2)


def test_two_amplitudes_on_one_force(tmp_path: Path) -> None:
    clock = "*AMPLITUDE, NAME=A, TIME=TOTAL TIME\n0., 0., 1., 1.\n"
    text = deck(clock, step("*CLOAD", "22, 1, 1.", "*CLOAD, AMPLITUDE=A", "22, 1, 1."))
    assert "two amplitudes for one degree of freedom" in refused(tmp_path, text)
