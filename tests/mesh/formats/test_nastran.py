"""Nastran's bulk data: coordinate systems, default fields, dialects, and cards that are refused."""

from __future__ import annotations

import copy
import itertools
from pathlib import Path

import numpy as np
import pytest

from gpusim.errors import InputError
from gpusim.files.input_file import read_input
from gpusim.mesh import Mesh, read_mesh
from gpusim.mesh.formats.nastran import read_bdf
from gpusim.scene.files import find_files

# a brick 2 x 3 x 5, in the order of its nodes
X, Y, Z = 2.0, 3.0, 5.0
POINTS = np.array(
    [(x, y, z) for z in (0.0, Z) for x, y in ((0.0, 0.0), (X, 0.0), (X, Y), (0.0, Y))]
)
CHEXA = "CHEXA,1,7,1,2,3,4,5,6,+\n+,7,8\n"


def grids(points: np.ndarray, system: object = "") -> str:
    rows = (
        f"GRID,{k},{system},{x!r},{y!r},{z!r}" for k, (x, y, z) in enumerate(points.tolist(), 1)
    )
    return "\n".join(rows) + "\n"


def read(folder: Path, text: str, name: str = "brick.bdf") -> Mesh:
    (folder / name).write_text(text)
    return read_mesh(folder / name)


BRICK = grids(POINTS) + CHEXA + "ENDDATA\n"

# A: (100, 0, 1); z' along (0, 3, 4)/5; x' in the plane of A, z' and the third point: along x
AXES = np.array([[1.0, 0.0, 0.0], [0.0, 0.8, -0.6], [0.0, 0.6, 0.8]])
CORD2 = "CORD2{kind},{number},{rid},100.,0.,1.,100.,3.,5.,+\n+,107.,6.,9.\n"
PLACED = POINTS @ AXES + [100.0, 0.0, 1.0]


def test_the_default_system_of_nodes_moves_them(tmp_path: Path) -> None:
    """Found read over: x 0..10 in place of 100..110."""
    text = """BEGIN BULK
CORD2R         5       0    100.      0.      0.    100.      0.      1.+C
+C          101.      0.      0.
GRDSET                 5
GRID           1           0.000   0.000   0.000
GRID           2          10.000   0.000   0.000
GRID           3          10.000  10.000   0.000
GRID           4           0.000  10.000   0.000
GRID           5           0.000   0.000  20.000
GRID           6          10.000   0.000  20.000
GRID           7       0 110.000  10.000  20.000
GRID           8           0.000  10.000  20.000
CHEXA          1       1       1       2       3       4       5       6+E1
+E1            7       8
ENDDATA
"""
    np.testing.assert_array_equal(read(tmp_path, text).bounds, [[100, 0, 0], [110, 10, 20]])


@pytest.mark.parametrize("kind", ["R", "C", "S"])
@pytest.mark.parametrize("default", [False, True])
def test_nodes_in_systems(kind: str, default: bool, tmp_path: Path) -> None:
    """Cylindrical: r, angle, z. Spherical: r, angle from z, angle about z."""
    x, y, z = POINTS.T
    far = np.sqrt(x * x + y * y + z * z)
    around = np.rad2deg(np.arctan2(y, x))
    tilt = np.rad2deg(np.arctan2(np.hypot(x, y), z))
    given = {
        "R": POINTS,
        "C": np.stack([np.hypot(x, y), around, z], 1),
        "S": np.stack([far, tilt, around], 1),
    }[kind]
    system = CORD2.format(kind=kind, number=9, rid="")
    nodes = "GRDSET,,9,,,,0,123456\n" + grids(given) if default else grids(given, 9)
    mesh = read(tmp_path, system + nodes + CHEXA + "ENDDATA\n")
    np.testing.assert_allclose(mesh.points, PLACED, atol=1e-12)


def test_systems_in_systems_and_at_nodes(tmp_path: Path) -> None:
    """A system given in another one; one given by three grid points of a third."""
    inner = "CORD2R,2,1,0.,0.,10.,0.,0.,11.,+\n+,0.,5.,10.\n"  # x'' = y', y'' = -x'
    text = CORD2.format(kind="R", number=1, rid=0) + inner
    turned = POINTS @ np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]) + [0, 0, 10]
    mesh = read(tmp_path, text + grids(POINTS, 2) + CHEXA + "ENDDATA\n")
    np.testing.assert_allclose(mesh.points, turned @ AXES + [100, 0, 1], atol=1e-12)
    corners = "GRID,21,1,0.,0.,0.\nGRID,22,1,0.,0.,4.\nGRID,23,1,3.,0.,3.\n"
    text = "CORD1R,3,21,22,23,4,21,22,23\n" + CORD2.format(kind="R", number=1, rid=0) + corners
    mesh = read(tmp_path, text + grids(POINTS, 4) + CHEXA + "ENDDATA\n")
    np.testing.assert_allclose(mesh.points, PLACED, atol=1e-12)


LINES = {
    "one line": "CHEXA,1,7,1,2,3,4,5,6,7,8\n",
    "marks inside": "CHEXA,1,7,1,2,3,4,5,6,+,7,8\n",
    "blank mark": "CHEXA,1,7,1,2,3,4,5,6,,7,8,,,,,\n",
    "named marks": "CHEXA,1,7,1,2,3,4,5,6,+E1\n+E1,7,8\n",
    "large": "CHEXA*,1,7,1,2,*\n*,3,4,5,6,*\n*,7,8\n",
    "no mark": "CHEXA   1       7       1       2       3       4       5       6\n"
    "        7       8\n",
    "tabs": "CHEXA\t1\t7\t1\t2\t3\t4\t5\t6\n\t7\t8\n",
}


@pytest.mark.parametrize("line", LINES.values(), ids=LINES.keys())
def test_forms_of_continuation(line: str, tmp_path: Path) -> None:
    mesh = read(tmp_path, grids(POINTS) + line + "ENDDATA\n")
    np.testing.assert_array_equal(mesh.points[mesh.cells["hex8"][0]], POINTS)


@pytest.mark.parametrize("suffix", [".bdf", ".dat", ".nas", ".fem"])
def test_latin_comments_no_enddata_and_suffixes(suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"brick{suffix}"
    text = "$ Träger \x85 GRID,1,,9.,9.,9.\n" + BRICK.replace("ENDDATA\n", "")
    path.write_bytes(text.encode("latin-1"))
    np.testing.assert_array_equal(read_mesh(path).bounds, [[0, 0, 0], [X, Y, Z]])
    path.write_bytes(text.encode("latin-1").rstrip(b"\n"))
    with pytest.raises(InputError, match="no ENDDATA"):
        read_mesh(path)


def test_control_sections_and_what_is_no_mesh(tmp_path: Path) -> None:
    head = "NASTRAN BUFFSIZE=65537\nSOL 101\nCEND\nTITLE = BEGIN BULK\nSPC = 1\nBEGIN BULK\n"
    cards = (
        "PARAM,WTMASS,.00259\nMAT1,1,2.1+5,,.3\nPSOLID,7,1,0\nSPOINT,901,THRU,905\n"
        "MPC,5,1,1,1.,2,1,-1.\nRBE2,9,1,123,2,3\nCELAS2,44,1.+3,1,1\nPLOTEL,45,1,2\n"
        "SPC1,1,123456,1,THRU,4\nFORCE,3,1,0,1.,1.,0.,0.\nMATHP,8,1.,2.\nTABLED1,3\n"
    )
    mesh = read(tmp_path, head + cards + BRICK)
    np.testing.assert_array_equal(mesh.points, POINTS)


def test_included_files(tmp_path: Path) -> None:
    (tmp_path / "sub").mkdir()
    (tmp_path / "sub" / "nodes.inc").write_text(grids(POINTS[:4]) + "INCLUDE 'more.inc'\n")
    (tmp_path / "sub" / "more.inc").write_text(grids(POINTS)[len(grids(POINTS[:4])) :])
    mesh = read(tmp_path, f"INCLUDE 'sub/\n nodes.inc'\n{CHEXA}ENDDATA\n".replace("/\n ", "/"))
    np.testing.assert_array_equal(mesh.points, POINTS)
    (tmp_path / "sub" / "more.inc").write_text("INCLUDE 'nodes.inc'\n")
    with pytest.raises(InputError, match=r"more\.inc: line 1: INCLUDE: the file includes itself"):
        read_mesh(tmp_path / "brick.bdf")
    with pytest.raises(InputError, match=r"brick\.bdf: line 1: INCLUDE: .*a device"):
        read(tmp_path, "INCLUDE '/dev/zero'\n" + BRICK)


def test_a_scene_knows_the_files_that_its_mesh_includes(tmp_path: Path) -> None:
    """Found not noticed: a changed included file left the scene, and its results, as they were."""
    (tmp_path / "a.bdf").write_text(f"INCLUDE 'b\nc.txt'\n{CHEXA}ENDDATA\n")
    (tmp_path / "bc.txt").write_text("  include d.txt\n")
    (tmp_path / "d.txt").write_text(grids(POINTS))
    (tmp_path / "a.inp").write_text("*Include,\n input = d.txt\n")
    for name in ("a.bdf", "a.inp"):
        document = {"body": [{"mesh": {"file": name}}]}
        faults, before = find_files(copy.deepcopy(document), tmp_path, {})
        assert not faults
        (tmp_path / "d.txt").write_text(grids(2.0 * POINTS))
        _, after = find_files(copy.deepcopy(document), tmp_path, {})
        assert {Path(one).name for one, _ in set(after) - set(before)} == {"d.txt"}
        (tmp_path / "d.txt").write_text(grids(POINTS))
    np.testing.assert_array_equal(read_mesh(tmp_path / "a.bdf").points, POINTS)


@pytest.mark.parametrize(
    ("card", "message"),
    [
        ("=,*(1),=,*(1.),==", r": not supported: it repeats the card before"),
        ("SELOC,1,2,3,4", r"SELOC: not supported: it parts the model into superelements"),
        ("GIRD,9,,1.,1.,1.", r"GIRD: unknown card; .*did you mean GRID"),
        ("CHEXAL,9,7,1,2,3,4,5,6", r"CHEXAL: unknown card"),
        ("CIHEX2,9,7,1,2", r"CIHEX2: not supported: it is a solid that gpusim doesn't have"),
        ("GRID,9,3,1.,1.,1.", r"GRID: in coordinate system 3; expected 0 or one that a CORD"),
        ("GRID,9,,1.,1_0.,1.", r"got '1_0\.'; expected a coordinate"),
        ("GRID,9.5,,1.,1.,1.", r"got '9\.5'; expected a whole number"),
        ("GRID,8,,1.,1.,1.", r"GRID: a second card for node 8"),
        ("GRDSET,,0\nGRDSET,,0", r"GRDSET: a second one; got the first in line 9"),
        ("CORD2R,3,3,0.,0.,0.,0.,0.,1.,+\n+,1.,0.,0.\nGRID,9,3,1.,1.,1.", r"defined by itself"),
        ("CORD2R,3,,0.,0.,0.,0.,0.,1.,+\n+,0.,0.,7.\nGRID,9,3,1.,1.,1.", r"points on one line"),
        ("CORD1R,3,1,2,77\nGRID,9,3,1.,1.,1.", r"CORD1R: names node 77, which isn't there"),
        ("CTETRA,9,7,1,2,3,2", r"CTETRA: 9 names node 2 twice"),
        ("CTETRA,9,7,1,2,3,99", r"CTETRA: 9 names node 99, which isn't there"),
        ("CTETRA,9,7,1,2,4,5,6,7,+E1\n+E2,8,3,2,1", r"line 10: continuation \+E2 after .* \+E1"),
        ("BEGIN SUPER=1", r"one of several models in a file"),
    ],
)  # fmt: skip
def test_what_moves_or_is_not_known_is_refused(card: str, message: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=message) as caught:
        read(tmp_path, grids(POINTS) + card + "\n" + CHEXA + "ENDDATA\n")
    lines = range(9, 10 + card.count("\n"))
    assert any(f"brick.bdf: line {line}: " in str(caught.value) for line in lines)


def test_lost_control_and_long_chains(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="line 2: CEND without BEGIN BULK"):
        read(tmp_path, "SOL 101\nCEND\n" + BRICK)
    with pytest.raises(InputError, match="line 1: continues nothing"):
        read(tmp_path, "+,1,2\n" + BRICK)
    chain = "".join(f"CORD2R,{k},{k + 1},0.,0.,0.,0.,0.,1.,+\n+,1.,0.,0.\n" for k in range(1, 3000))
    with pytest.raises(InputError, match="expected a chain that ends"):
        read(tmp_path, chain + grids(POINTS, 1) + CHEXA)


def test_a_file_that_was_read_already(tmp_path: Path) -> None:
    path = tmp_path / "brick.bdf"
    path.write_text(BRICK)
    file = read_input(path)
    path.unlink()
    assert read_bdf(file).cell_count == 1


def test_the_shuffled_file_is_the_same_mesh(tmp_path: Path) -> None:
    """Cards stand in any order."""
    lines = grids(POINTS).splitlines()
    wanted = read(tmp_path, BRICK).points
    for order in itertools.islice(itertools.permutations(range(8)), 7, 40000, 9001):
        nodes = "\n".join(lines[k] for k in order) + "\n"
        mesh = read(tmp_path, CHEXA + nodes + "ENDDATA\n")
        np.testing.assert_array_equal(mesh.points[mesh.cells["hex8"][0]], wanted)
