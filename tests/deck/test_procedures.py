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
from tests.support.calculix_output import Answer, difference, printed
from tests.support.deck_texts import FIXED, LABELS, MATERIAL, METAL, MODEL, deck, step, write
from tests.support.vibration_decks import DECKS

# of frequencies and factors; of displacements, over the greatest at that time
SAME, ALIKE = 1e-6, 2e-6

REFERENCES: dict[str, list[Answer]] = {
    "modes_c3d8": [("modes", [17309.27, 17526.66, 100847.5, 104864.7, 105959.6, 165222.2])],
    "modes_c3d20": [("modes", [13524.53, 13524.53, 83231.3, 83231.3, 100565.3, 164195.8])],
    "modes_c3d20r": [("modes", [13115.02, 13115.02, 78038.1, 78038.1, 94144.35, 162801.5])],
    "modes_c3d4": [("modes", [121261.4, 135898.1, 450033.7, 456475.8, 554564.6, 578887.9])],
    "modes_c3d10": [("modes", [52334.93, 52770.74, 202526.0, 270518.3, 280413.4, 329268.4])],
    "modes_c3d6": [("modes", [94639.67, 128242.4, 355869.1, 447211.0, 487973.2, 573165.0])],
    "modes_c3d15": [("modes", [52252.83, 52304.08, 201301.0, 268623.9, 278032.9, 328360.9])],
    "modes_pulled": [("modes", [16844.14, 16844.14, 82908.41, 82908.41, 94410.19, 163384.9])],
    "modes_pulled_far": [("modes", [16836.61, 16836.61, 82897.25, 82897.25, 94409.36, 163383.0])],
    "modes_pressed": [("modes", [17269.78, 17535.08, 100935.0, 104884.8, 106038.0, 165575.2])],
    "modal_about": [
        ("modes", [20308.92, 20488.71, 101048.7, 108522.5, 109568.8, 165796.4]),
        ("motion", (1.000032, 14, [-0.0005455609, -1.009209e-15, -0.006020138])),
        ("motion", (1.00006, 14, [-0.000334031, 8.325489e-16, -0.003461219])),
    ],
    "buckled_c3d8": [("buckling", [11.89291, 12.22306, 102.9121])],
    "buckled_c3d20r": [("buckling", [6.754147, 6.754147, 56.21552])],
    "modal": [
        ("modes", [17309.27, 17526.66, 100847.5, 104864.7, 105959.6, 165222.2]),
        ("motion", (6.4e-05, 7, [0.0003864352, 0.0006701497, 0.003288284])),
        ("motion", (0.0001, 21, [-0.0007405462, 0.007184169, -0.001081603])),
    ],
    "modal_let_go": [
        ("modes", [17309.27, 17526.66, 100847.5, 104864.7, 105959.6, 165222.2]),
        ("motion", (1.000024, 14, [-0.002167123, 2.429741e-15, -0.02360815])),
        ("motion", (1.00004, 14, [-0.0006644286, 7.524577e-15, -0.007862428])),
    ],
    "steady_rayleigh": [
        ("modes", [17309.27, 17526.66, 100847.5, 104864.7, 105959.6, 165222.2]),
        (
            "response",
            (
                10000.0,
                14,
                [
                    (-0.0007054287 + 2.822817e-05j),
                    (1.265747e-15 - 9.111255e-17j),
                    (-0.007874462 + 0.0003243018j),
                ],
            ),
        ),
        (
            "response",
            (
                17526.66,
                14,
                [
                    (-4.17896e-05 + 0.009112423j),
                    (-1.869664e-13 + 8.949807e-14j),
                    (-0.0001384562 + 0.1061276j),
                ],
            ),
        ),
    ],
    "steady_loss": [
        ("modes", [17309.27, 17526.66, 100847.5, 104864.7, 105959.6, 165222.2]),
        (
            "response",
            (
                5000.0,
                21,
                [
                    (0.0006367654 + 0.002426912j),
                    (-0.001212967 - 0.02692374j),
                    (0.005814697 - 0.0002584965j),
                ],
            ),
        ),
        (
            "response",
            (
                17309.27,
                21,
                [
                    (0.05612497 - 0.005385825j),
                    (-0.6283446 - 0.001156277j),
                    (0.0238608 - 0.06681966j),
                ],
            ),
        ),
    ],
    "steady_displacement": [
        ("modes", [17309.27, 17526.66, 100847.5, 104864.7, 105959.6, 165222.2]),
        (
            "response",
            (
                10000.0,
                14,
                [
                    (0.0619921 - 0.00489564j),
                    (-4.392678e-13 + 2.949506e-14j),
                    (1.740692 - 0.08499984j),
                ],
            ),
        ),
        (
            "response",
            (
                17526.66,
                14,
                [(-0.140784 - 2.709427j), (5.598286e-11 - 2.613585e-11j), (-0.5814389 - 31.60859j)],
            ),
        ),
    ],
    "steady_acceleration": [
        ("modes", [17309.27, 17526.66, 100847.5, 104864.7, 105959.6, 165222.2]),
        (
            "response",
            (
                10000.0,
                14,
                [
                    (-1.570278e-11 + 1.24008e-12j),
                    (1.108491e-22 - 7.452592e-24j),
                    (-4.409224e-10 + 2.153071e-11j),
                ],
            ),
        ),
        (
            "response",
            (
                17480.72,
                14,
                [
                    (-1.210953e-11 + 2.226542e-10j),
                    (-5.17696e-21 + 1.281273e-21j),
                    (-2.287465e-10 + 2.597542e-09j),
                ],
            ),
        ),
    ],
    "direct": [
        ("motion", (3.2e-05, 14, [-0.0007969454, 2.288052e-16, -0.008816651])),
        ("motion", (6e-05, 14, [-0.000294396, -4.18458e-16, -0.002965238])),
    ],
    "direct_alpha": [
        ("motion", (3.2e-05, 16, [-1.015872e-18, -7.552115e-19, -0.009745085])),
        ("motion", (6e-05, 46, [-6.163757e-05, -1.879207e-07, -0.0003850856])),
    ],
    "growing": [
        ("motion", (2.3e-05, 14, [-0.0008509078, 1.086314e-18, -0.009327356])),
        ("motion", (6e-05, 14, [-0.0001710626, 1.078769e-18, -0.001342431])),
    ],
    "thrown": [
        ("motion", (2.4e-05, 7, [-0.002017191, -0.004007021, -0.008420929])),
        ("motion", (4e-05, 21, [0.0006495277, 0.0001099323, 0.01252173])),
    ],
    "again": [
        ("motion", (4.4e-05, 14, [-0.0002547866, 1.022264e-18, -0.002940178])),
        ("motion", (8e-05, 14, [-0.0003217292, -1.785823e-19, -0.003595807])),
    ],
    "far": [
        ("motion", (2.4e-05, 14, [-0.3447412, -1.490751e-16, 2.81862])),
        ("motion", (4e-05, 14, [-0.09638767, 7.483942e-16, 1.942944])),
    ],
    "let_go": [
        ("motion", (1.000024, 35, [-0.1337097, -3.066259e-16, -2.067527])),
        ("motion", (1.00004, 35, [0.01909357, 1.109477e-15, -0.9065667])),
    ],
}


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


def test_free_bodies_have_rigid_modes(tmp_path: Path) -> None:
    (found,) = load_deck(write(tmp_path, deck(MODES.replace("3\n", "8\n"), fixed=""))).solve()
    assert len(found.rigid) == 6 and (found.frequencies > 0.0).sum() == 2


def test_a_resonance_that_nothing_damps(tmp_path: Path) -> None:
    (modes,) = load_deck(write(tmp_path, deck(MODES))).solve()
    swept = STEADY.replace("0.1, 2.", f"0.1, {modes.frequencies[1]}")
    with pytest.raises(InputError, match=r"step 2: nothing damps a resonance; got [\d.]+ Hz"):
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
