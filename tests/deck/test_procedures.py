"""Decks of vibration and buckling against CalculiX, and what they are refused for.

References are CalculiX 2.20's answers, printed with seven digits; where it is installed it is asked
again, and all nodes of the end and all instants and frequencies are compared.
"""

from __future__ import annotations

import json
import shutil
import subprocess
from collections.abc import Sequence
from functools import cache
from pathlib import Path

import meshio
import numpy as np
import pytest

import gpusim as gs
from gpusim.applications import solve_deck
from gpusim.deck import Deck, load_deck
from gpusim.deck.step import Result
from gpusim.errors import InputError, NotConverged
from tests.support.calculix_answers import REFERENCES
from tests.support.calculix_output import Answer, difference, printed
from tests.support.deck_texts import FIXED, LABELS, MATERIAL, METAL, MODEL, deck, step, write
from tests.support.vibration_decks import DECKS

# of frequencies and factors; of displacements, over the greatest at that time
SAME, ALIKE = 1e-6, 2e-6


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """With all decks, each solved once."""
    found = tmp_path_factory.mktemp("decks")
    for name, text in DECKS.items():
        write(found, text(), f"{name}.inp")
    return found


@cache
def solved(path: Path) -> tuple[Deck, tuple[Result, ...]]:
    found = load_deck(path)
    return found, found.solve(backend="numpy", tolerance=1e-10)


def agree(path: Path, answers: Sequence[Answer]) -> None:
    """Compare all answers of CalculiX."""
    assert answers
    for kind, answer in answers:
        limit = SAME if kind in ("modes", "buckling") else ALIKE
        assert difference(*solved(path), kind, answer) <= limit


@pytest.mark.parametrize("name", DECKS)
def test_stored_answers(name: str, folder: Path) -> None:
    agree(folder / f"{name}.inp", REFERENCES[name])


@pytest.mark.parametrize("name", DECKS)
def test_every_instant_as_calculix(name: str, folder: Path) -> None:
    program = shutil.which("ccx")
    if program is None:
        pytest.skip("CalculiX isn't installed (Debian: calculix-ccx)")
    done = subprocess.run(
        [program, name], cwd=folder, capture_output=True, text=True, check=False, timeout=120
    )
    assert done.returncode == 0 and "*ERROR" not in done.stdout, done.stdout[-2000:]
    text = (folder / f"{name}.dat").read_text(encoding="utf-8")
    answers = printed(text, name.startswith("steady"))
    assert [kind for kind, _ in answers].count("modes") == DECKS[name]().count("*FREQUENCY")
    agree(folder / f"{name}.inp", answers)


PULL = ["*CLOAD", "22, 1, 1."]
LINEAR = step(*PULL)
MODES = "*STEP\n*FREQUENCY\n3\n*END STEP\n"
ABOUT = MODES.replace("*STEP", "*STEP, PERTURBATION", 1)
MODAL = step(*PULL, static="*MODAL DYNAMIC\n0.1, 0.5")
DIRECT = step(*PULL, static="*DYNAMIC, DIRECT\n0.1, 0.5")
STEADY = step(*PULL, static="*STEADY STATE DYNAMICS\n0.1, 2.")
SPEED = "*INITIAL CONDITIONS, TYPE=VELOCITY\nALL, 1, 2.\n"


@pytest.mark.parametrize(
    ("parts", "blocks", "message"),
    [
        (["*STEP\n*FREQUENCY\n*END STEP\n"], {}, "*FREQUENCY: number of modes; got 0"),
        (["*STEP\n*FREQUENCY\n2.5\n*END STEP\n"], {}, "number of modes; got 2.5"),
        (["*STEP\n*FREQUENCY, NORMALIZATION=MASS\n3\n*END STEP\n"], {},
         "parameter NORMALIZATION isn't supported"),
        ([ABOUT], {}, "PERTURBATION about no step"),
        ([LINEAR, step("*DLOAD", ", CENTRIF, 1., 0., 0., 0., 0., 0., 1."), ABOUT], {},
         "PERTURBATION about a state with CENTRIF"),
        ([LINEAR, ABOUT.replace("3\n", "3\n*BOUNDARY\n13, 2\n")], {},
         "other supports than in step 1"),
        ([MODAL], {}, "no modes; expected a step with *FREQUENCY before it"),
        ([STEADY], {}, "no modes"),
        ([LINEAR, ABOUT, *[MODAL.replace("*STEP", "*STEP, PERTURBATION")] * 2], {},
         "a second *MODAL DYNAMIC about a stressed state"),
        ([MODES, *[MODAL.replace("*CLOAD", "*CLOAD, AMPLITUDE=TOTAL")] * 2], {},
         "an amplitude over total time in a second step"),
        ([LINEAR, ABOUT, MODAL], {}, "PERTURBATION where *FREQUENCY has it"),
        ([MODES, MODAL.replace("*MODAL DYNAMIC", "*MODAL DYNAMIC, DIRECT=NO")], {}, "DIRECT=NO"),
        ([MODES, MODAL.replace("*MODAL DYNAMIC", "*MODAL DYNAMIC, STEADY STATE")], {},
         "STEADYSTATE"),
        ([MODES, STEADY.replace("DYNAMICS", "DYNAMICS, HARMONIC=NO")], {}, "HARMONIC=NO"),
        ([MODES, STEADY.replace("0.1, 2.", "2., 0.1")], {}, "band; got 2 to 0.1"),
        ([MODES, STEADY.replace("0.1, 2.", "0.1, 2., 1.E12")], {}, "got 1e+12; expected at most"),
        ([MODES, DIRECT], {}, "steps before that aren't *STATIC or *DYNAMIC"),
        ([DIRECT.replace("*CLOAD", "*TEMPERATURE\nALL, 5.\n*CLOAD")], {}, "a changed temperature"),
        ([DIRECT.replace("*STEP", "*STEP, AMPLITUDE=RAMP")], {}, "AMPLITUDE=RAMP of *STEP"),
        ([DIRECT, LINEAR], {}, "*STATIC: after a step in which the body moves"),
        ([DIRECT.replace("DIRECT", "EXPLICIT")], {}, "parameter EXPLICIT isn't supported"),
        ([DIRECT.replace("DIRECT", "ALPHA=-0.5")], {}, "ALPHA; got -0.5; expected -1/3 to 0"),
        ([DIRECT.replace("*CLOAD", "*BOUNDARY\n22, 1, 1, 0.1\n*CLOAD")], {},
         "displacements of supports"),
        ([MODES, step("*CLOAD, LOAD CASE=2", "22, 1, 1.", static="*MODAL DYNAMIC\n0.1, 0.5")], {},
         "LOAD CASE; got 2"),
        ([MODES, MODAL.replace("*CLOAD", "*MODAL DAMPING\n1, 2, 1.5\n*CLOAD")], {},
         "ratio; got 1.5"),
        ([MODES, MODAL.replace("*CLOAD", "*MODAL DAMPING, RAYLEIGH\n,, -1., 0.\n*CLOAD")], {},
         "got -1, 0"),
        ([step("*BASE MOTION, DOF=1, AMPLITUDE=A")], {}, "outside of modal superposition"),
        ([MODES, MODAL.replace("*CLOAD", "*BASE MOTION, DOF=4, AMPLITUDE=A\n*CLOAD")], {},
         "DOF; got 4"),
        ([MODES, MODAL.replace("*CLOAD", "*BASE MOTION, DOF=1\n*CLOAD")], {},
         "AMPLITUDE; got none"),
        (["*STEP\n*BUCKLE\n3\n*TEMPERATURE\nALL, 10.\n*END STEP\n"], {}, "in a step with *BUCKLE"),
        ([LINEAR], {"material": MATERIAL + SPEED}, "motion before the first step"),
        ([MODES], {"material": MATERIAL.replace("*DENSITY", "*DAMPING, ALPHA=-1.\n*DENSITY")},
         "ALPHA; got -1"),
        ([MODES], {"material": MATERIAL.replace("*DENSITY", "*DAMPING, COMPOSITE=1.\n*DENSITY")},
         "parameter COMPOSITE isn't supported"),
        ([LINEAR.replace("*STEP", "*STEP, NLGEOM"), DIRECT],
         {"material": MATERIAL.replace("*DENSITY", "*DAMPING, BETA=1.\n*DENSITY")},
         "BETA of *DAMPING"),
        ([LINEAR, ABOUT], {"material": METAL}, "PERTURBATION about metal"),
        ([LINEAR.replace("*STEP", "*STEP, NLGEOM"), "*STEP\n*BUCKLE\n3\n*END STEP\n"], {},
         "*BUCKLE at large displacements"),
    ],
)  # fmt: skip
def test_refused(parts: list[str], blocks: dict[str, str], message: str, tmp_path: Path) -> None:
    amplitude = "*AMPLITUDE, NAME=A\n0., 0., 1., 1.\n"
    amplitude += "*AMPLITUDE, NAME=TOTAL, TIME=TOTAL TIME\n0., 0., 1., 1.\n"
    text = deck(*parts, model=MODEL + amplitude, **blocks)
    with pytest.raises(InputError) as caught:
        load_deck(write(tmp_path, text))
    assert message in str(caught.value) and "two.inp:" in str(caught.value)


def test_materials_of_different_loss(tmp_path: Path) -> None:
    """One factor for all of the body."""
    other = "*MATERIAL, NAME=SOFT\n*ELASTIC\n1., 0.\n*DAMPING, STRUCTURAL=0.1\n"
    apart = "*ELSET, ELSET=LAST\n9\n*SOLID SECTION, ELSET=LAST, MATERIAL=SOFT\n"
    with pytest.raises(InputError, match="different STRUCTURAL damping"):
        load_deck(write(tmp_path, deck(LINEAR, material=MATERIAL + other + apart)))


def test_only_modes_in_the_band(tmp_path: Path) -> None:
    """Those beyond are counted, as CalculiX does."""
    (every,) = load_deck(write(tmp_path, deck(MODES))).solve()
    low, middle, _ = every.frequencies
    band = MODES.replace("3\n", f"3, {0.5 * (low + middle)}\n")
    (found,) = load_deck(write(tmp_path, deck(band))).solve()
    np.testing.assert_array_equal(found.frequencies, every.frequencies[1:])
    assert found.shapes.shape == (2, 12, 3) and not found.rigid


def test_modes_beyond_the_band_are_superposed(tmp_path: Path) -> None:
    """As CalculiX does, which doesn't print them."""
    _, whole = load_deck(write(tmp_path, deck(MODES, MODAL))).solve()
    none = MODES.replace("3\n", "3, 0., 1.E-6\n")
    modes, history = load_deck(write(tmp_path, deck(none, MODAL))).solve()
    assert len(modes.frequencies) == 0 and np.abs(history.u).max() > 0.0
    np.testing.assert_array_equal(history.u, whole.u)


def test_free_bodies_have_rigid_modes(tmp_path: Path) -> None:
    (found,) = load_deck(write(tmp_path, deck(MODES.replace("3\n", "8\n"), fixed=""))).solve()
    assert len(found.rigid) == 6 and (found.frequencies > 0.0).sum() == 2


def test_a_resonance_that_nothing_damps(tmp_path: Path) -> None:
    (modes,) = load_deck(write(tmp_path, deck(MODES))).solve()
    swept = STEADY.replace("0.1, 2.", f"0.1, {modes.frequencies[1]}")
    with pytest.raises(InputError, match=r"step 2: frequencies.*a resonance of mode 1 that noth"):
        load_deck(write(tmp_path, deck(MODES, swept))).solve()


def test_no_motion_about_what_is_no_equilibrium(tmp_path: Path) -> None:
    pressed, crushed = (step("*BOUNDARY", f"RIGHT, 1, 1, {u}") for u in (-0.1, -12.0))
    nonlinear = pressed.replace("*STEP", "*STEP, NLGEOM")
    text = deck(nonlinear, crushed, ABOUT, fixed=FIXED + "RIGHT, 1\n")
    with pytest.raises(NotConverged, match="step 3: the static analysis before it"):
        load_deck(write(tmp_path, text)).solve()


def test_moving_supports_exactly(tmp_path: Path) -> None:
    """CalculiX takes second differences for the acceleration of a support, and comes to the exact
    motion as its increments become shorter; ours is exact with all modes: a bar that is pulled at
    both ends and in the middle moves as it does by direct integration in short steps."""
    amplitude = "*AMPLITUDE, NAME=A\n0., 0., 20., 1., 100., 1.\n"
    moved = "*STEP\n*MODAL DYNAMIC\n0.5, 40.\n*BASE MOTION, DOF=3, AMPLITUDE=A\n*END STEP\n"
    text = deck(MODES.replace("3\n", "24\n"), moved, model=MODEL + amplitude)
    found = load_deck(write(tmp_path, text))
    _modes, history = found.solve(tolerance=1e-10)
    times = history.times
    fixed = found.steps[0].fixed
    np.testing.assert_allclose(
        history.u[:, fixed[:, 2], 2].T, np.tile(np.minimum(times / 20.0, 1.0), (4, 1))
    )
    # in the moving frame: a blow at the beginning, and the opposite one when the supports stop
    model = gs.Model(found.mesh, found.materials, fixed)
    rigid = np.zeros_like(found.mesh.points)
    rigid[:, 2] = 1.0 / 20.0
    inner = np.where(fixed, 0.0, rigid)
    blow = gs.transient(
        model, times=times, count=24, initial=(0.0 * rigid, -inner), formulation="full"
    )
    relative = np.asarray(blow.u)
    late = times > 20.0
    relative[late] -= relative[: late.sum() + 1][1:]
    own = np.asarray(history.u) - np.minimum(times / 20.0, 1.0)[:, None, None] * rigid * 20.0
    assert np.abs(own - relative).max() <= 1e-6 * np.abs(relative).max()


def test_files_and_report(tmp_path: Path) -> None:
    """Of all kinds of steps."""
    damped = STEADY.replace("*CLOAD", "*MODAL DAMPING\n1, 3, 0.1\n*CLOAD")
    buckled = step(*PULL, static="*BUCKLE\n2").replace("22, 1, 1.", "22, 1, -1.")
    path = write(tmp_path, deck(LINEAR, MODES, MODAL, damped, buckled))
    done = solve_deck(path, tmp_path / "out", backend="numpy")
    assert not done.failure and [type(one).__name__ for one in done.solutions] == [
        "Solution", "Modes", "History", "HarmonicResponse", "Buckling",
    ]  # fmt: skip
    names = sorted(one.name for one in (tmp_path / "out").iterdir())
    assert names == [
        "displacements.npz", "report.json", "solution.pvd",
        *(f"solution_000{k}.vtu" for k in range(1, 6)), *(f"step_000{k}.npz" for k in range(2, 6)),
    ]  # fmt: skip
    report = json.loads((tmp_path / "out" / "report.json").read_text(encoding="utf-8"))
    kinds = ["static", "modes", "history", "harmonic response", "buckling"]
    assert [one["kind"] for one in report["steps"]] == kinds and report["mass_rule"] == "calculix"
    _, modes, history, response, found = done.solutions
    assert report["steps"][1]["frequencies"] == modes.frequencies.tolist()
    assert report["steps"][4]["factors"] == found.factors.tolist()
    size = np.linalg.norm(np.asarray(history.u), axis=2)
    assert report["steps"][2]["largest_displacement"] == pytest.approx(size.max(), rel=1e-12)
    with np.load(tmp_path / "out" / "step_0003.npz") as stored:
        np.testing.assert_array_equal(stored["times"], history.times)
        u = np.tensordot(stored["amplitudes"], stored["shapes"], axes=1)
        np.testing.assert_allclose(u, history.u, rtol=1e-12, atol=1e-14 * size.max())
    with np.load(tmp_path / "out" / "step_0004.npz") as stored:
        u = np.tensordot(stored["amplitudes"], stored["shapes"], axes=1)
        np.testing.assert_array_equal(u, response.u)
    greatest = np.linalg.norm(response.amplitude, axis=2)
    k, node = np.unravel_index(greatest.argmax(), greatest.shape)
    assert report["steps"][3]["at_frequency"] == response.frequencies[k]
    assert report["steps"][3]["largest_displacement_node"] == LABELS[node]
    mesh = meshio.read(tmp_path / "out" / "solution_0004.vtu")
    np.testing.assert_allclose(mesh.point_data["u"], response.at(int(k)), rtol=1e-12)
    with np.load(tmp_path / "out" / "displacements.npz") as stored:
        assert stored["u"].shape == (1, 12, 3)
