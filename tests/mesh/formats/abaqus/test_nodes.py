"""Nodes of .inp files that aren't given where they lie: systems, generators, instances."""

from __future__ import annotations

import itertools
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from gpusim.deck import load_deck
from gpusim.errors import InputError
from gpusim.files.input_file import read_input
from gpusim.mesh import Mesh, read_mesh, set_faces
from tests.support.deck_texts import (
    ELEMENT_LINES,
    LABELS,
    MATERIAL,
    MODEL,
    NODE_LINES,
    POINTS,
    deck,
    step,
    write,
)

# origin, a point on x and one beside it: x -> (3, 0, 4)/5, y -> y, z -> (-4, 0, 3)/5
SYSTEM = "*SYSTEM\n100., 10., 1., 103., 10., 5.\n94., 17., -7.\n"
TURN = np.array([[0.6, 0.0, 0.8], [0.0, 1.0, 0.0], [-0.8, 0.0, 0.6]])
TURNED = POINTS @ TURN + [100.0, 10.0, 1.0]
LOAD = step("*CLOAD", "22, 1, 1.", "*NODE PRINT, NSET=ALL", "U")


def model(nodes: str) -> str:
    return MODEL.replace(f"*NODE, NSET=ALL\n{NODE_LINES}\n", nodes)


def both(folder: Path, text: str) -> Mesh:
    """The mesh as read_mesh has it, which must be that of load_deck."""
    path = write(folder, deck(LOAD, model=text))
    mesh, own = read_mesh(path), load_deck(path)
    np.testing.assert_array_equal(mesh.points, own.mesh.points)
    assert own.node_labels.tolist() == LABELS.tolist()
    return mesh


def test_a_system_moves_and_turns_the_nodes_after_it(tmp_path: Path) -> None:
    """Found read over by read_mesh: x 0..6 in place of where the file has them."""
    nodes = f"{SYSTEM}*NODE, NSET=ALL\n{NODE_LINES}\n"
    np.testing.assert_allclose(both(tmp_path, model(nodes)).points, TURNED, atol=1e-13)


@pytest.mark.parametrize(
    ("lines", "shift", "turn"),
    [
        ("100., 10., 1.", [100, 10, 1], np.eye(3)),
        ("0., 0., 2., 3., 4., 9.", [0, 0, 2], [[0.6, 0.8, 0], [-0.8, 0.6, 0], [0, 0, 1]]),
    ],
)
def test_systems_of_one_and_two_points(
    lines: str, shift: list[float], turn: list[list[float]], tmp_path: Path
) -> None:
    """Abaqus: a translation only; z stays, and x is seen along it."""
    nodes = f"*SYSTEM\n{lines}\n*NODE, NSET=ALL\n{NODE_LINES}\n"
    mesh = both(tmp_path, model(nodes))
    np.testing.assert_allclose(mesh.points, POINTS @ np.array(turn) + shift, atol=1e-13)


def test_a_system_ends_where_an_empty_one_stands(tmp_path: Path) -> None:
    lines = NODE_LINES.splitlines()
    nodes = "\n".join(["*SYSTEM", "0., 0., 7.", "*NODE, NSET=ALL", *lines[6:]])
    nodes += "\n" + "\n".join(["*SYSTEM", "*NODE, NSET=ALL", *lines[:6]]) + "\n"
    mesh = both(tmp_path, model(nodes))
    np.testing.assert_array_equal(mesh.bounds, [[0, 0, 0], [6, 3, 12]])
    np.testing.assert_array_equal(mesh.points[:6], POINTS[:6])


def test_cylindrical_coordinates_in_a_system(tmp_path: Path) -> None:
    radius, angle = np.hypot(*POINTS[:, :2].T), np.rad2deg(np.arctan2(*POINTS[:, 1::-1].T))
    rows = zip(LABELS, radius, angle, POINTS[:, 2], strict=True)
    lines = "\n".join(f"{n}, {float(r)!r}, {float(a)!r}, {z}" for n, r, a, z in rows)
    nodes = f"{SYSTEM}*NODE, NSET=ALL, SYSTEM=C\n{lines}\n"
    np.testing.assert_allclose(both(tmp_path, model(nodes)).points, TURNED, atol=1e-12)


def test_generated_nodes_and_elements(tmp_path: Path) -> None:
    """A block of 2 x 3 x 1 bricks from the ends of two lines and one element."""
    text = """*SYSTEM
100., 0., 0.
*NODE
1, 0., 0., 0.
5, 4., 0., 0.
101, 0., 0., 5.
105, 4., 0., 5.
31, 0., 6., 0.
35, 4., 6., 0.
131, 0., 6., 5.
135, 4., 6., 5.
*NGEN, NSET=NEAR
1, 5, 2
101, 105, 2
*NGEN, NSET=FAR
31, 35, 2
131, 135, 2
*NFILL, NSET=ALL
NEAR, FAR, 3, 10
*ELEMENT, TYPE=C3D8, ELSET=MASTER
1, 1, 3, 13, 11, 101, 103, 113, 111
*ELGEN, ELSET=BRICKS
1, 2, 2, 1, 3, 10, 100
"""
    mesh = read_mesh(write(tmp_path, text))
    assert mesh.cell_count == 6 and mesh.node_count == 24
    np.testing.assert_array_equal(mesh.bounds, [[100, 0, 0], [104, 6, 5]])
    centres = mesh.points[mesh.cells["hex8"]].mean(axis=1)
    wanted = [[101 + 2 * x, 1 + 2 * y, 2.5] for x, y in itertools.product((0, 1), (0, 1, 2))]
    assert sorted(centres.tolist()) == wanted
    assert mesh.cell_sets["MASTER"].tolist() == [0]
    assert mesh.cell_sets["BRICKS"].tolist() == [0, 1, 2, 3, 4, 5]
    assert len(mesh.node_sets["NEAR"]) == 6 and len(mesh.node_sets["ALL"]) == 24


@pytest.mark.parametrize(
    ("line", "sweep"), [("1, 9, 4, 30", 90.0), ("1, 9, 2, , 5., 1., 2., 0., 0., -1.", -270.0)]
)
def test_nodes_on_an_arc(line: str, sweep: float, tmp_path: Path) -> None:
    """The short way, and with a normal the long one."""
    ends = "*NODE\n1, 7., 1., 2.\n9, 5., 3., 2.\n30, 5., 1., 2.\n"
    mesh = read_mesh(write(tmp_path, MODEL + ends + f"*NGEN, LINE=C, NSET=ARC\n{line}\n"))
    arc = mesh.points[mesh.node_sets["ARC"]]
    angle = np.deg2rad(np.linspace(0.0, sweep, len(arc)))
    wanted = np.stack([5 + 2 * np.cos(angle), 1 + 2 * np.sin(angle), np.full(len(arc), 2.0)], 1)
    assert len(arc) == (3 if sweep > 0 else 5)
    np.testing.assert_allclose(arc, wanted, atol=1e-14)


PART = f"""*PART, NAME=Bar
*NODE, NSET=ALL
{NODE_LINES}
*ELEMENT, TYPE=C3D8, ELSET=BRICKS
{ELEMENT_LINES}
*NSET, NSET=Set-1
11, 14, 17, 20
*SURFACE, NAME=END
9, S4
*SOLID SECTION, ELSET=BRICKS, MATERIAL=STEEL
*END PART
"""
STEEL = "*MATERIAL, NAME=STEEL\n*ELASTIC\n200., 0.25\n*DENSITY\n3.\n"
# moved by (10, 0, 0), then turned by 90 degrees about z through (10, 0): x' = 10 - y, y' = x
MOVED = (
    "*INSTANCE, NAME=Bar-2, PART=BAR\n10., 0., 0.\n10., 0., 0., 10., 0., 1., 90.\n*END INSTANCE\n"
)
PLACE = np.stack([10.0 - POINTS[:, 1], POINTS[:, 0], POINTS[:, 2]], axis=1)


def assembly(*instances: str, rest: str = "") -> str:
    return f"{PART}*ASSEMBLY, NAME=A\n{''.join(instances)}{rest}*END ASSEMBLY\n{STEEL}"


FIRST = "*INSTANCE, NAME=Bar-1, PART=Bar\n*END INSTANCE\n"


def test_an_instance_is_moved_and_turned(tmp_path: Path) -> None:
    mesh = read_mesh(write(tmp_path, assembly(MOVED)))
    np.testing.assert_allclose(mesh.points, PLACE, atol=1e-14)
    assert LABELS[mesh.node_sets["Set-1"]].tolist() == [11, 14, 17, 20]


def test_sets_of_part_and_assembly_with_one_name_are_two(tmp_path: Path) -> None:
    """Found joined: CAE names sets Set-1 in each; so are nodes that the assembly numbers itself,
    which took the place of the part's."""
    rest = "*NODE\n11, 50., 60., 70.\n*NSET, NSET=Set-1, INSTANCE=Bar-1\n13,\n*NSET, NSET=R\n11,\n"
    mesh = read_mesh(write(tmp_path, assembly(FIRST, rest=rest)))
    np.testing.assert_array_equal(mesh.points[:-1], POINTS)
    assert LABELS[mesh.node_sets["Set-1"]].tolist() == [13]
    assert LABELS[mesh.node_sets["Bar-1.Set-1"]].tolist() == [11, 14, 17, 20]
    np.testing.assert_array_equal(mesh.points[mesh.node_sets["R"]], [[50, 60, 70]])


def test_two_instances_of_a_part(tmp_path: Path) -> None:
    rest = "*NSET, NSET=LOADED, INSTANCE=Bar-2\n13, 16\n*ELSET, ELSET=E\nBar-1.7, Bar-2.BRICKS\n"
    rest += "*SURFACE, NAME=S\nBar-2.9, S4\n"
    history = "*BOUNDARY\nBar-1.Set-1, 1, 3\nA.Bar-2.Set-1, 1, 3\n" + step(
        "*CLOAD",
        "LOADED, 2, 1.",
        "Bar-1.22, 3, 2.",
        "*DLOAD",
        "Bar-2.BRICKS, GRAV, 2., 0., 0., -1.",
    )
    path = write(tmp_path, assembly(FIRST, MOVED, rest=rest) + history)
    mesh, found = read_mesh(path), load_deck(path)
    np.testing.assert_allclose(mesh.points, np.concatenate([POINTS, PLACE]), atol=1e-14)
    assert found.node_labels.tolist() == [*LABELS, *(LABELS + 100)]
    assert found.node_labels[mesh.node_sets["LOADED"]].tolist() == [113, 116]
    assert mesh.cell_sets["E"].tolist() == [0, 2, 3]
    faces = set_faces(mesh, mesh.face_sets["S"])
    np.testing.assert_allclose(faces.area_vectors, [[0, 15, 0]], atol=1e-13)
    np.testing.assert_allclose(found.steps[0].forces.sum(axis=0), [0, 2, 2 - 3 * 90 * 2])
    # the bar alone, its force turned with it: (0, 1, 0) there is (1, 0, 0) here
    alone = deck(
        step("*CLOAD", "13, 1, 1.", "16, 1, 1.", "*DLOAD", "BRICKS, GRAV, 2., 0., 0., -1.")
    )
    (one,) = load_deck(write(tmp_path, alone, "one.inp")).solve(backend="numpy", tolerance=1e-10)
    (two,) = found.solve(backend="numpy", tolerance=1e-10)
    turned = np.stack([-one.u[:, 1], one.u[:, 0], one.u[:, 2]], axis=1)
    np.testing.assert_allclose(two.u[12:], turned, atol=1e-7 * np.abs(turned).max())


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (assembly(FIRST, MOVED) + "*BOUNDARY\n13, 1\n" + LOAD, "undefined node; got node 13"),
        (assembly(FIRST, MOVED) + "*BOUNDARY\nBar-3.13, 1\n" + LOAD, "got 'Bar-3'"),
        (assembly(FIRST, MOVED) + "*BOUNDARY\nBar-2.99, 1\n" + LOAD, "got node Bar-2.99"),
        (assembly(FIRST, MOVED) + "*BOUNDARY\nSet-1, 1\n" + LOAD, "unknown node set; got 'Set-1'"),
        (assembly(FIRST, FIRST), "got NAME='Bar-1'; expected a name of its own"),
        (assembly(FIRST.replace("PART=Bar", "PART=Bat")), "unknown part; got 'Bat'"),
        (assembly(FIRST).replace("*END INSTANCE\n", ""), "ENDS|ends nothing|doesn't end"),
        (assembly(MOVED).replace("*SOLID", "*BOUNDARY\n11, 1\n*SOLID"), "inside of the part of"),
        (assembly(MOVED.replace("10., 0., 1., 90.", "10., 0., 0., 90.")), "no axis"),
        (assembly(FIRST, rest="*NSET, NSET=B, INSTANCE=C\n11\n"), "unknown instance; got 'C'"),
        (assembly(MOVED) + "*BOUNDARY\n11, 1, 3\n" + step("*CLOAD", "13, 9, 1."), "got 9"),
    ],
)  # fmt: skip
def test_faults_of_assemblies(text: str, message: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=message) as caught:
        load_deck(write(tmp_path, text))
    assert "two.inp:" in str(caught.value)


@pytest.mark.parametrize(
    ("card", "message"),
    [
        ("*NCOPY, CHANGE NUMBER=100, OLD SET=ALL, SHIFT\n1., 0., 0.", "supported: it makes"),
        ("*NMAP, NSET=ALL", "NMAP: not supported"),
        ("*PARAMETER\na = 1", "PARAMETER: not supported"),
        ("*IMPERFECTION, FILE=b\n1, 0.1", "IMPERFECTION: not supported: it moves nodes"),
        ("*MODEL CHANGE, REMOVE\nBRICKS", "MODEL CHANGE: not supported: it takes elements away"),
        ("*NOED\n1, 0., 0., 0.", r"NOED: unknown keyword; .*did you mean 'NODE'"),
        ("*NODE, INPUT=nodes.txt", "parameter INPUT isn't supported"),
        ("*NODE, NSET=A, NSET=B", "NSET is given twice"),
        ("*NGEN\n11, 98, 1", "node 98 isn't there yet"),
        ("*NGEN\n11, 22, 4", "got nodes 11 to 22 by 4; expected whole steps"),
        ("*NODE\n900000000, 1., 1., 1.\n*NGEN\n11, 900000000", "would make 899999988 nodes"),
        ("*NGEN, LINE=P\n11, 22, 1, 13", "LINE=P isn't supported; expected LINE=C"),
        ("*NFILL\nLEFT, LEFT, 0", "0 intervals"),
        ("*NFILL\nLEFT, ALL, 3", "got sets of 4 and 12 nodes"),
        ("*ELGEN\n8, 2", "element 8 isn't there yet"),
        ("*ELGEN\n7, 90000, 1, 1, 90000, 1, 1", "expected counts >= 1 and at most"),
        ("*ELGEN\n7, 3", "element numbers used twice; got element 9"),
        ("*SYSTEM\n1., 2., 3., 1., 2., 3.", "got three points on one line"),
        ("*SYSTEM\n1., 2., 3., 4.", "got 4 numbers in its lines"),
    ],
)  # fmt: skip
def test_what_moves_or_makes_nodes_is_read_or_refused(
    card: str, message: str, tmp_path: Path
) -> None:
    text = MODEL + card + "\n"
    first = text[: text.index(card)].count("\n") + 1
    with pytest.raises(InputError, match=message) as caught:
        read_mesh(write(tmp_path, text))
    lines = range(first, first + 1 + card.count("\n"))
    assert any(f"two.inp:{line}: *" in str(caught.value) for line in lines)


def test_titles_blanks_and_latin_letters(tmp_path: Path) -> None:
    """As CalculiX reads them. A Latin-1 byte 0x85 parts no line."""
    text = "Brücke, 2\n" + MODEL.replace("*NODE", "   *NODE").replace(
        "*ELEMENT", "  ** Träger \x85 , 1\n *ELEMENT"
    ).replace("NSET=LEFT", "NSET=Lager für A")
    path = tmp_path / "two.inp"
    path.write_bytes(text.encode("latin-1"))
    mesh = read_mesh(path)
    np.testing.assert_array_equal(mesh.points, POINTS)
    assert len(mesh.node_sets["Lager für A"]) == 4


def test_a_comma_too_many_after_a_keyword(tmp_path: Path) -> None:
    text = MODEL.replace("*NODE, NSET=ALL", "*NODE, NSET=ALL,").replace("=LEFT\n", "=LEFT,\n")
    mesh = read_mesh(write(tmp_path, text))
    np.testing.assert_array_equal(mesh.points, POINTS)
    assert LABELS[mesh.node_sets["LEFT"]].tolist() == [11, 14, 17, 20]


def test_quoted_names_on_data_lines(tmp_path: Path) -> None:
    text = MODEL.replace("NSET=LEFT", 'NSET="left, end"') + '*NSET, NSET=B\n"left, end", 13\n'
    history = '*BOUNDARY\n"left, end", 1, 3\n' + LOAD
    found = load_deck(write(tmp_path, deck(history, model=text, fixed="")))
    assert LABELS[found.mesh.node_sets["B"]].tolist() == [11, 13, 14, 17, 20]
    assert found.steps[0].fixed.all(axis=1).sum() == 4


def test_messages_have_the_numbers_of_the_file(tmp_path: Path) -> None:
    loose = deck("*NODE\n99, 1., 1., 1.\n", step("*CLOAD", "99, 1, 1."))
    line = loose.splitlines().index("99, 1, 1.") + 1
    with pytest.raises(InputError, match=rf"two\.inp:{line}: \*CLOAD: node 99 belongs to no"):
        load_deck(write(tmp_path, loose))
    twice = MODEL.replace("18, 21, 20", "18, 21, 21")
    with pytest.raises(InputError, match=r"two\.inp:17: .*element 7: got node 21 twice"):
        read_mesh(write(tmp_path, twice))


def test_an_orientation_has_an_origin(tmp_path: Path) -> None:
    """Found read over: its points were taken from the global origin."""
    elastic = "*ELASTIC, TYPE=ENGINEERING CONSTANTS\n200., 100., 50., .3, .2, .25, 40., 30.,\n20."
    base = MATERIAL.replace("*ELASTIC\n200., 0.25", elastic).replace(
        "MATERIAL=STEEL\n", "MATERIAL=STEEL, ORIENTATION=O\n"
    )
    stiff = [
        load_deck(write(tmp_path, deck(LOAD, material=f"*ORIENTATION, NAME=O\n{line}\n{base}")))
        .materials[0]
        .stiffness()
        for line in ("1., 1., 0., -1., 1., 0.", "8., 4., 3., 6., 4., 3., 7., 3., 3.")
    ]
    np.testing.assert_allclose(stiff[1], stiff[0], atol=1e-12)


def test_numbers_that_only_python_takes(tmp_path: Path) -> None:
    for old, new in (("12, 2.0", "1_2, 2.0"), ("12, 2.0", "12, 2_0."), ("12, 2.0", "12, 1e61")):
        with pytest.raises(InputError, match=r"two\.inp:5: \*NODE: (not a|number too)"):
            read_mesh(write(tmp_path, MODEL.replace(old, new)))
    with pytest.raises(InputError, match=r"two\.inp:17: .*not a whole number; got '1_2'"):
        read_mesh(write(tmp_path, MODEL.replace("7, 11, 12", "7, 11, 1_2")))


def test_the_first_step_may_be_a_perturbation(tmp_path: Path) -> None:
    plain, other = deck(LOAD), deck(LOAD.replace("*STEP", "*STEP, PERTURBATION"))
    one, two = (
        load_deck(write(tmp_path, text)).solve(backend="numpy")[0].u for text in (plain, other)
    )
    np.testing.assert_array_equal(one, two)
    with pytest.raises(InputError, match="PERTURBATION about an earlier step"):
        load_deck(write(tmp_path, other + LOAD.replace("*STEP", "*STEP, PERTURBATION")))


def test_files_that_include_each_other(tmp_path: Path) -> None:
    write(tmp_path, "*INCLUDE, INPUT=b.inp\n*INCLUDE, INPUT=b.inp\n", "a.inp")
    for k in range(12):  # 2^12 files, were they all read
        write(tmp_path, f"*INCLUDE, INPUT=c{k}.inp\n" * 2, f"c{k - 1}.inp" if k else "b.inp")
    write(tmp_path, "*HEADING\n", "c11.inp")
    with pytest.raises(InputError, match="more than 1000 files"):
        read_mesh(tmp_path / "a.inp")
    write(tmp_path, "*INCLUDE, INPUT=/dev/zero\n", "a.inp")
    with pytest.raises(InputError, match=r"a\.inp:1: \*INCLUDE: .*a device"):
        read_mesh(tmp_path / "a.inp")


def test_a_file_that_was_read_already(tmp_path: Path) -> None:
    file = read_input(write(tmp_path, deck(LOAD)))
    file.path.unlink()
    assert load_deck(file).mesh.cell_count == 2


@pytest.mark.skipif(shutil.which("ccx") is None, reason="CalculiX isn't installed")
def test_a_deck_in_a_system_against_calculix(tmp_path: Path) -> None:
    """CalculiX has no *SYSTEM: it gets the nodes where they lie, as computed above."""
    nodes = f"{SYSTEM}*NODE, NSET=ALL\n{NODE_LINES}\n"
    found = load_deck(write(tmp_path, deck(LOAD, model=model(nodes))))
    (solution,) = found.solve(backend="numpy", tolerance=1e-10)
    rows = zip(LABELS, TURNED.tolist(), strict=True)
    flat = "".join(f"{n}, {x:.12e}, {y:.12e}, {z:.12e}\n" for n, (x, y, z) in rows)
    write(tmp_path, deck(LOAD, model=model(f"*NODE, NSET=ALL\n{flat}")), "flat.inp")
    subprocess.run(["ccx", "flat"], cwd=tmp_path, capture_output=True, check=True, timeout=60)
    table = np.loadtxt(tmp_path / "flat.dat", skiprows=3)
    assert table[:, 0].tolist() == LABELS.tolist()
    size = np.abs(table[:, 1:]).max()
    assert np.abs(solution.u - table[:, 1:]).max() <= 1e-6 * size
