"""The decks of CalculiX' own test suite, unchanged, against its published results.

They come from Debian's package calculix-ccx-test (GPL), which the tests look for in its folder or
in GPUSIM_CCX_TEST; nothing of it is part of this repository. Published numbers have seven digits.
"""

from __future__ import annotations

import gzip
import os
import re
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest

from gpusim.deck import Deck, load_deck
from gpusim.errors import InputError
from tests.support.calculix_output import difference
from tests.support.calculix_output import printed as answers_of

Float = npt.NDArray[np.float64]
Table = dict[int, list[float]]

FOLDER = Path(os.environ.get("GPUSIM_CCX_TEST") or "/usr/share/doc/calculix-ccx-test/examples/test")
pytestmark = pytest.mark.skipif(
    not FOLDER.is_dir(),
    reason=f"no decks: install calculix-ccx-test or set GPUSIM_CCX_TEST (looked in {FOLDER})",
)

# Every linear static deck of solids whose features are supported, with published displacements.
DECKS = [
    "achtel2", "achtel29", "achtel9", "achtelc", "achtelcas", "achteld", "achtelg", "achtelp",
    "aniso", "beam10p", "beam20p", "beam8p", "beam8t", "beamd", "beamidset", "beamp",
    "beamp2stage", "beampdepmpc", "beampis", "beampo1", "beampo2", "beampset", "beamptied1",
    "beamptied2", "beamt", "beamt2",
    "beamt3", "c3d15", "c3d6", "disk2", "resstress1",
    "segment1", "segment2", "segmentf",
]  # fmt: skip

# Nonlinear ones, whose published results are converged to some 1e-6; tests/deck/test_load_path.py
# has what is compared more closely.
NONLINEAR = ["beamnld", "beamnlmpc", "beamnlp", "beamnlptp", "beamp1rotate", "beamwrite"]

# Warm ones, plastic ones in one increment, a loose one of rubber; docs/decks.md tells what they
# differ by.
COARSE = {"beamnh": 3e-3, "beampiso": 0.05, "beampt": 0.01, "beamnlt": 1e-3}

# Vibration and buckling, with published frequencies, load factors and motions; what *DYNAMIC does
# in its first increments has changed since then. docs/decks.md has what they differ by.
VIBRATION = {
    **dict.fromkeys(["beam8b", "beam8f", "beamb", "beamf", "beamf2", "beamptied7"], 1e-6),
    **dict.fromkeys([f"beamdy{k}" for k in (1, 2, 3, 4, 5, 6, 8, 9, 10, 18, 19)], 1e-6),
    "beamdynamic": 1e-4, "beamimpdy1": 1e-3, "beamimpdy2": 5e-3,
    "beamnldy": 1e-6, "beamnldyp": 1e-4, "cube2": 1e-6,
}  # fmt: skip

# Decks that are read too: an iterative reference, forces only, stresses at nodes only; increments
# that CalculiX chooses otherwise by now; supports whose acceleration it takes from differences.
OTHERS = [
    "beampic", "mpcforce", "segmentm", "cubef2f3", "beamimpdy1nodirect", "beamnldynodirect",
    "beamdy7",
]  # fmt: skip

# Static decks of solids that are refused, each with the line and what it is refused for.
REFUSED = {
    "beam20t": (344, "*ELASTIC: depends on temperature"),
    "beamd2": (360, "*DLOAD: load P2NP isn't supported"),
    "beamdy11": (383, "*STEADY STATE DYNAMICS: HARMONIC=NO isn't supported"),
    "beamdy14": (364, "*MODAL DYNAMIC: DIRECT=NO isn't supported"),
    "beamdy17": (364, "*MODAL DYNAMIC: parameter STEADYSTATE isn't supported"),
    "beamnldye": (363, "*DYNAMIC: parameter EXPLICIT isn't supported"),
    "beampisof": (398, "*FREQUENCY: PERTURBATION about metal"),
    "rotor": (3442, "*COMPLEX FREQUENCY: not supported"),
    "beammrlin": (348, "*MPC: not supported"),
    "beampfix": (364, "*BOUNDARY: parameter FIXED isn't supported"),
    "beamprb": (355, "*RIGID BODY: not supported"),
    "beamt4": (349, "*ELASTIC: depends on temperature"),
    "changesolidsection": (363, "*CHANGE SOLID SECTION: not supported"),
    "inistrain": (33, "*INITIAL CONDITIONS: TYPE=PLASTIC STRAIN isn't supported"),
    "pret1": (217, "*PRE-TENSION SECTION: not supported"),
    "resstress2": (352, "*INITIAL CONDITIONS: parameter USER isn't supported"),
    "resstress3": (352, "*INITIAL CONDITIONS: parameter USER isn't supported"),
    "submodelbeamp": (361, "*SUBMODEL: not supported"),
    "submodeltwobeam": (100, "*SUBMODEL: not supported"),
}


def text_of(name: str) -> str:
    """A file of the suite, packed or not."""
    plain, packed = FOLDER / name, FOLDER / f"{name}.gz"
    if plain.is_file():
        return plain.read_text(encoding="latin-1")
    if packed.is_file():
        return gzip.decompress(packed.read_bytes()).decode("latin-1")
    pytest.skip(f"{name} isn't in {FOLDER}: another version of the suite")


def read(name: str, folder: Path) -> Deck:
    path = folder / f"{name}.inp"
    path.write_text(text_of(path.name), encoding="utf-8")
    return load_deck(path)


def printed(name: str, what: str = "displacements") -> list[tuple[float, Table]]:
    """(time, {node: values}) of each printed table of displacements or forces."""
    found: list[tuple[float, Table]] = []
    rows: Table | None = None
    for line in text_of(f"{name}.dat.ref").splitlines():
        head = re.match(rf" {what} \(.*\) for set \S+ and time\s+(\S+)", line)
        if head:
            rows = {}
            found.append((float(head.group(1)), rows))
        elif re.match(r" \S", line):
            rows = None
        elif rows is not None and line.strip():
            node, *values = line.split()
            rows[int(node)] = [float(value) for value in values]
    return found


def printed_stresses(name: str) -> list[dict[int, Float]]:
    """{element: (Q,6) xx yy zz xy xz yz} of each printed table of stresses."""
    tables: list[dict[int, list[list[float]]]] = []
    reading = False
    for line in text_of(f"{name}.dat.ref").splitlines():
        if re.match(r" \S", line):
            reading = line.startswith(" stresses (elem, integ.pnt.,sxx,syy,szz,sxy,sxz,syz)")
            tables += [{}] if reading else []
        elif reading and line.strip():
            element, _, *values = line.split()
            tables[-1].setdefault(int(element), []).append([float(value) for value in values])
    return [{k: np.array(values) for k, values in table.items()} for table in tables]


def stored(name: str) -> list[tuple[float, Table]]:
    """Displacements of the last table in a result file (.frd, fixed columns)."""
    rows: Table = {}
    reading, time = False, 0.0
    for line in text_of(f"{name}.frd.ref").splitlines():
        if line.startswith("  100C"):
            time = float(line[12:24])
        if line.startswith(" -4"):
            reading = line.split()[1] == "DISP"
            rows = {} if reading else rows
        elif line.startswith(" -1") and reading:
            numbers = [float(line[13 + 12 * k : 25 + 12 * k]) for k in range(3)]
            rows[int(line[3:13])] = numbers
        elif line.startswith(" -3"):
            reading = False
    return [(time, rows)]


def in_own_axes(deck: Deck, values: Float) -> Float:
    """As CalculiX prints without GLOBAL=YES: turned nodes in their own axes."""
    turned = values.copy()
    for node, axes in deck.node_axes.items():
        turned[node] = axes @ values[node]
    return turned


def greatest_error(deck: Deck, values: Float, table: Table) -> float:
    """Greatest difference over the greatest published value, at the nodes of cells."""
    published = np.array(list(table.values()))
    labels = np.array(list(table))
    solid = np.ones(deck.mesh.node_count, dtype=bool)
    solid[deck.mesh.dangling_nodes] = False
    known = np.isin(labels, deck.node_labels[solid])
    assert known.sum() >= 5
    own = values[np.searchsorted(deck.node_labels, labels[known])]
    assert np.isfinite(own).all() and np.isfinite(published).all()
    return float(np.abs(own - published[known]).max() / np.abs(published[known]).max())


@pytest.mark.parametrize("name", DECKS)
def test_published_displacements(name: str, tmp_path: Path) -> None:
    deck = read(name, tmp_path)
    tables = printed(name) or stored(name)
    solutions = deck.solve(backend="numpy", tolerance=1e-9)
    compared = 0
    for time, table in tables:
        for step, solution in zip(deck.steps, solutions, strict=True):
            if abs(step.time - time) <= 1e-6:
                local = "GLOBAL=YES" not in text_of(f"{name}.inp").upper()
                u = in_own_axes(deck, solution.u) if local else solution.u
                assert solution.converged
                assert greatest_error(deck, u, table) <= 1e-6
                compared += 1
    assert compared == len(tables) > 0


@pytest.mark.parametrize("name", [*NONLINEAR, *COARSE])
def test_published_displacements_of_nonlinear_decks(name: str, tmp_path: Path) -> None:
    deck = read(name, tmp_path)
    tables = printed(name) or stored(name)
    compared = 0
    for step, solution in zip(deck.steps, deck.solve(backend="numpy", tolerance=1e-9), strict=True):
        assert solution.converged
        for time, table in tables:
            if abs(step.time - time) <= 1e-6:
                u = in_own_axes(deck, solution.u)
                assert greatest_error(deck, u, table) <= COARSE.get(name, 1e-5)
                compared += 1
    assert compared == len(deck.steps)


@pytest.mark.parametrize("name", VIBRATION)
def test_published_vibration(name: str, tmp_path: Path) -> None:
    deck = read(name, tmp_path)
    results = deck.solve(backend="numpy", tolerance=1e-10)
    text = text_of(f"{name}.dat.ref")
    answers = answers_of(text, "STEADY STATE" in text_of(f"{name}.inp"))
    assert answers
    for kind, answer in answers:
        if np.any(answer[-1]):
            assert difference(deck, results, kind, answer) <= VIBRATION[name]


@pytest.mark.parametrize("name", ["beam8p", "beam20p", "beam10p", "c3d15", "beampo1"])
def test_published_displacements_on_the_device(name: str, tmp_path: Path) -> None:
    deck = read(name, tmp_path)
    (solution,) = deck.solve(tolerance=1e-8, method="multigrid", backend="gpu")
    assert solution.backend == "gpu"
    assert greatest_error(deck, solution.u, printed(name)[0][1]) <= 1e-6


@pytest.mark.parametrize("name", sorted(set(DECKS) - {"beamp", "beampis"}))
def test_published_stresses(name: str, tmp_path: Path) -> None:
    """At every integration point; beampis' own solver is iterative, beamp prints none."""
    deck = read(name, tmp_path)
    (solution,) = deck.solve(backend="numpy", tolerance=1e-9)
    (rows,) = printed_stresses(name)
    size = max(np.abs(values).max() for values in rows.values())
    stress = deck.point_stress(1, solution.u)
    compared = 0
    for kind, first, block in deck.mesh.blocks():
        labels = deck.cell_labels[first : first + len(block)].tolist()
        # CalculiX counts the points of a tetrahedron the other way round
        points = stress[kind][:, :: -1 if kind == "tet10" else 1]
        for label, values in rows.items():
            if label in labels:
                own = points[labels.index(label)][:, [0, 1, 2, 3, 5, 4]]
                assert np.abs(own - values).max() <= 1e-6 * size
                compared += 1
    assert compared == len(rows) > 0


@pytest.mark.parametrize("name", ["mpcforce", "segmentm"])
def test_published_forces_of_equations(name: str, tmp_path: Path) -> None:
    """CalculiX prints the whole internal force of a node: reaction and load together."""
    deck = read(name, tmp_path)
    (solution,) = deck.solve(backend="numpy")
    force = solution.reactions + deck.steps[0].forces
    ((_, table),) = printed(name, "forces")
    published = np.array(list(table.values()))
    own = force[np.searchsorted(deck.node_labels, list(table))]
    assert np.abs(own - published).max() <= 1e-6 * np.abs(published).max()


def test_a_loose_solver_of_the_reference(tmp_path: Path) -> None:
    """beampic asks CalculiX for an iterative solver, which stopped 2e-3 off; beampset has the
    same beam and load through its direct one."""
    deck = read("beampic", tmp_path)
    (solution,) = deck.solve(backend="numpy", tolerance=1e-9)
    assert 1e-3 <= greatest_error(deck, solution.u, printed("beampic")[0][1]) <= 2e-3
    assert greatest_error(deck, solution.u, printed("beampset")[0][1]) <= 1e-6


@pytest.mark.parametrize("name", sorted(REFUSED))
def test_refused_with_line(name: str, tmp_path: Path) -> None:
    line, reason = REFUSED[name]
    with pytest.raises(InputError) as caught:
        read(name, tmp_path)
    assert f"{name}.inp:{line}: {reason}" in str(caught.value)


def test_every_deck_of_the_suite_is_read_or_refused(tmp_path: Path) -> None:
    """Contact, creep, dynamics, shells, fluids: nothing passes as something else."""
    names = sorted(path.name.removesuffix(".gz") for path in FOLDER.glob("*.inp*"))
    assert len(names) > 300
    accepted = []
    for name in names:
        try:
            read(name.removesuffix(".inp"), tmp_path)
        except InputError as error:
            assert f"{name}:" in str(error)
        else:
            accepted.append(name.removesuffix(".inp"))
    assert accepted == sorted([*DECKS, *NONLINEAR, *COARSE, *VIBRATION, *OTHERS])
