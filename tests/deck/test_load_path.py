"""Nonlinear decks against CalculiX, and the order in which loads go on.

References are CalculiX 2.20's answers, to residuals of 1e-9, printed with seven digits; where it is
installed it is asked again, and all nodes and points are compared.
"""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from dataclasses import replace
from functools import cache
from pathlib import Path

import meshio
import numpy as np
import numpy.typing as npt
import pytest

import gpusim as gs
from gpusim.applications import solve_deck
from gpusim.applications.decks import _step_report
from gpusim.deck import Deck, load_deck
from gpusim.errors import InputError, NotConverged
from tests.support.deck_texts import FIXED, MATERIAL, METAL, deck, step, write
from tests.support.nonlinear_decks import DECKS

Float = npt.NDArray[np.float64]
# node that moves most, its displacement, and the mean stress xx yy zz xy yz zx of element 1
Reference = tuple[int, list[float], list[float]]

# CalculiX' C3D8I has other modes; its plasticity takes its flow from elastic stretches, which are
# some per mille; its heat doesn't turn with the material.
TOLERANCES = {
    "tip_c3d8i": (1e-2, 4e-2),
    "hole_c3d8": (2e-3, 3e-3),
    "cyclic_c3d8": (2e-3, 5e-3),
    "warm_c3d20r": (3e-4, 2e-4),
}
"""Of displacements and stresses, relative to the greatest one; others: 1e-5 or less."""
SAME = (1e-6, 2e-6)

REFERENCES: dict[str, list[Reference]] = {
    "tip_c3d8": [
        (
            18,
            [-0.9664163, -1.550923e-15, 4.155389],
            [11144.41, 1741.123, 1315.134, 270.5268, -18.72475, 1970.135],
        )
    ],
    "tip_c3d8i": [
        (
            18,
            [-1.570861, -1.015007e-15, 4.989811],
            [13744.73, 2157.812, 1406.611, 329.1289, -14.70929, 2522.733],
        )
    ],
    "tip_c3d20": [
        (
            10,
            [-1.514189, 5.132968e-16, 4.913715],
            [11966.56, 1269.949, 1756.411, 123.1024, -57.41182, 3518.792],
        )
    ],
    "tip_c3d20r": [
        (
            10,
            [-1.589537, 2.521505e-15, 5.018203],
            [11344.55, 137.0464, 509.0315, 79.36046, -122.5504, 3658.052],
        )
    ],
    "tip_c3d4": [
        (
            5,
            [-0.4666762, -0.222681, 2.076553],
            [-18532.63, -7295.399, 11106.88, 2261.806, -3394.705, 20100.88],
        )
    ],
    "tip_c3d10": [
        (
            8,
            [-0.8270781, -0.007737483, 2.937939],
            [-18767.75, -459.8646, -6501.812, -19.48553, -37.89025, -4224.329],
        )
    ],
    "tip_c3d6": [
        (
            5,
            [-0.7052618, 0.02919119, 2.517382],
            [32815.84, 98.1435, 3965.44, 1569.28, -1034.64, 21416.34],
        )
    ],
    "tip_c3d15": [
        (
            29,
            [-0.8285136, 0.0162862, 2.925371],
            [1057.328, 118.8398, 743.2786, 243.6293, -356.682, 4875.23],
        )
    ],
    "pressed_c3d20": [
        (
            5,
            [-0.06967308, -2.366531e-05, 1.710728],
            [4394.648, 454.7334, 437.3784, 35.21832, -17.12854, 804.6741],
        )
    ],
    "pressed_c3d20r": [
        (
            10,
            [-0.07639223, 1.663104e-15, 1.752456],
            [4239.621, 62.55957, 1.859657, 19.30057, -32.71765, 804.1758],
        )
    ],
    "rubber_c3d8": [
        (4, [0.8, 0.3, 0.0], [2.225102, 1.444855, 1.392912, 0.2762086, 0.02354947, 0.08670971])
    ],
    "rubber_c3d20r": [
        (
            3,
            [-0.5, 0.2, 0.0],
            [-0.8766023, -0.09724396, -0.1016719, 0.01851042, -2.602085e-18, 8.673617e-19],
        )
    ],
    "hole_c3d8": [
        (
            188,
            [0.5, -0.01898249, -0.001627866],
            [425.8268, -2.147, 38.04682, 3.102083, -4.181633, 3.07853],
        ),
        (
            68,
            [0.1393955, 0.009780537, 0.0],
            [-404.4003, 38.40722, 26.41757, 6.426542, -0.7639487, -2.660179],
        ),
    ],
    "cyclic_c3d8": [
        (5, [0.0, 0.04, 0.0], [561.3539, 181.3351, 187.1535, 158.9009, -2.276593, 15.22942])
    ],
    "loads_c3d20r": [
        (
            40,
            [0.0186883, -2.552442e-16, -0.2933261],
            [-721.6019, -13.80507, -52.03463, -3.265643, 3.88201, -61.75988],
        ),
        (
            45,
            [-0.7947452, -3.876725, -0.2407803],
            [-8722.898, -698.732, -219.5677, 931.5041, -21.55942, 4.062298],
        ),
        (
            35,
            [0.03817693, 0.9626874, -0.2917791],
            [1307.048, -10.18786, -20.28987, 150.2611, -6.133234, -83.54663],
        ),
    ],
    "turned_c3d20r": [
        (
            20,
            [-0.003912358, 1.116078, 3.226762e-15],
            [2600.622, -27.24795, 28.60114, 357.1224, -13.27356, 14.27563],
        )
    ],
    "wood_c3d20r": [
        (
            5,
            [-0.6342453, -0.2446137, 3.338175],
            [139.6778, 2.418394, 7.398269, 7.949233, 3.918631, 41.33604],
        )
    ],
    "warm_c3d20r": [
        (
            30,
            [-0.8047744, -3.874442, -1.838779e-15],
            [-8184.857, -671.6506, -171.3492, 841.9957, 9.35934, -46.81307],
        )
    ],
}


@cache
def solved(path: Path) -> tuple[Deck, tuple[gs.Solution, ...]]:
    found = load_deck(path)
    solutions = found.solve(backend="numpy", tolerance=1e-9)
    assert all(one.converged for one in solutions)
    return found, solutions


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """With all decks, each solved once."""
    found = tmp_path_factory.mktemp("decks")
    for name, text in DECKS.items():
        write(found, text(), f"{name}.inp")
    return found


def tables(path: Path, what: str) -> list[tuple[float, Float]]:
    """(time, rows) of each printed table of displacements or stresses."""
    found: list[tuple[float, list[list[float]]]] = []
    for line in path.read_text().splitlines():
        head = re.match(r" (\w+) \(.*\) for set \S+ and time\s+(\S+)", line)
        if head:
            inside = head.group(1) == what
            if inside:
                found.append((float(head.group(2)), []))
        elif line.strip() and inside:
            found[-1][1].append([float(word) for word in line.split() if word not in "GLO"])
    return [(time, np.array(rows)) for time, rows in found]


@pytest.mark.parametrize("name", DECKS)
def test_stored_answers(name: str, folder: Path) -> None:
    found, solutions = solved(folder / f"{name}.inp")
    for one, solution, (label, u, stress) in zip(
        found.steps, solutions, REFERENCES[name], strict=True
    ):
        moved, strained = TOLERANCES.get(name, SAME)
        own = solution.u[np.searchsorted(found.node_labels, label)]
        assert np.abs(own - u).max() <= moved * np.abs(u).max()
        points = found.point_stress(one.number, solution)
        size = max(np.abs(values).max() for values in points.values())
        mean = next(iter(points.values()))[0].mean(axis=0)
        assert np.abs(mean - stress).max() <= strained * size


@pytest.mark.parametrize("name", DECKS)
def test_every_node_and_point_as_calculix(name: str, folder: Path) -> None:
    program = shutil.which("ccx")
    if program is None:
        pytest.skip("CalculiX isn't installed (Debian: calculix-ccx)")
    found, solutions = solved(folder / f"{name}.inp")
    done = subprocess.run(
        [program, name], cwd=folder, capture_output=True, text=True, check=False, timeout=120
    )
    assert done.returncode == 0 and "*ERROR" not in done.stdout, done.stdout[-2000:]
    printed = [tables(folder / f"{name}.dat", what) for what in ("displacements", "stresses")]
    (kind,) = found.mesh.cells
    # CalculiX counts the points of these the other way round
    order = {"tet10": [3, 2, 1, 0], "wedge15": [2, 1, 0, 5, 4, 3, 8, 7, 6]}.get(kind)
    for one, solution in zip(found.steps, solutions, strict=True):
        u, stress = (
            next(rows for time, rows in table if abs(time - one.time) < 1e-5) for table in printed
        )
        moved, strained = TOLERANCES.get(name, SAME)
        assert np.abs(solution.u - u[:, 1:]).max() <= moved * np.abs(u[:, 1:]).max()
        own = found.point_stress(one.number, solution)[kind]
        own = (own if order is None else own[:, order])[..., [0, 1, 2, 3, 5, 4]]
        theirs = stress[:, 2:].reshape(own.shape)
        assert np.abs(own - theirs).max() <= strained * np.abs(theirs).max()


NLGEOM = "*STEP, NLGEOM"


def nonlinear(folder: Path, *steps: str, **blocks: str) -> Deck:
    return load_deck(write(folder, deck(*steps, **blocks).replace("*STEP", NLGEOM)))


def test_loads_go_straight_from_step_to_step(tmp_path: Path) -> None:
    """One load case for the end of each step; a solution for each, with its load steps."""
    found = nonlinear(
        tmp_path, step("*CLOAD", "22, 3, 1."), step("*DLOAD", "9, P4, -0.2", "*CLOAD", "22, 3, 3.")
    )
    assert found.nonlinear
    assert [type(one) for one in found.materials] == [gs.SaintVenantKirchhoff]
    first, second = found.steps
    assert first.increments.tolist() == [1.0] and second.increments.tolist() == [2.0]
    assert [len(one.loads) for one in found.steps] == [0, 1]
    assert second.forces.sum() == 3.0  # pressure follows and isn't a force
    model = found.model(1, 2)
    assert [load.case for load in model.loads] == [1]
    one, two = found.solve(backend="numpy", tolerance=1e-9)
    expected = gs.solve(model, geometry="nonlinear", factors=np.eye(2), formulation="full",
                        tolerance=1e-9)  # fmt: skip
    np.testing.assert_array_equal(one.u, expected.steps[0].u)
    np.testing.assert_array_equal(two.u, expected.steps[1].u)
    np.testing.assert_array_equal(two.reactions, expected.steps[1].reactions)
    np.testing.assert_allclose(two.strain_energy, expected.strain_energy, rtol=1e-14)
    assert 0.0 < one.strain_energy[0] < two.strain_energy[0]
    with pytest.raises(InputError, match="expected a step's Solution with load steps"):
        found.point_stress(1, one.u)


def test_amplitudes_bend_the_path(tmp_path: Path) -> None:
    """Loads go straight between the corners of tables; those without one ramp over the step."""
    quarter = "*STATIC\n.25, 1."
    own = "*AMPLITUDE, NAME=OWN\n0., 0., 0.5, 3., 2., 1.\n"
    found = nonlinear(
        tmp_path,
        step("*CLOAD, AMPLITUDE=OWN", "22, 1, 1.", "*CLOAD", "22, 2, 4.", static=quarter),
        step("*CLOAD", "22, 1, 5.", static=quarter),
        material=own + MATERIAL,
    )  # fmt: skip
    first, second = found.steps
    states = [*first.path, first]
    assert [one.time for one in states] == [0.25, 0.5, 1.0]
    at = np.searchsorted(found.node_labels, 22)
    np.testing.assert_allclose(
        [one.forces[at] for one in states], [[1.5, 1, 0], [3, 2, 0], [3 - 2 / 3, 4, 0]]
    )
    # the second step ramps from where the first one ended
    assert not second.path and second.forces[at].tolist() == [5.0, 4.0, 0.0]
    np.testing.assert_allclose(first.increments, [0.25, 0.5, 1.0])
    one, _ = found.solve(backend="numpy")
    np.testing.assert_allclose([step.factors for step in one.steps], np.eye(4)[:3])


def test_an_analysis_that_ends_early(tmp_path: Path) -> None:
    """Steps that weren't reached have no load steps, and say why."""
    crushed = "RIGHT, 1, 1, -12."  # twice the length
    found = nonlinear(
        tmp_path, step("*BOUNDARY", "RIGHT, 1, 1, -0.1"), step("*BOUNDARY", crushed),
        step("*CLOAD", "22, 2, 0."), fixed=FIXED + "RIGHT, 1\n",
    )  # fmt: skip
    one, two, three = found.solve(backend="numpy")
    assert one.converged and len(one.steps) == 1
    assert not two.converged and not three.converged and not three.steps
    assert "load step 2 of 3" in two.message
    np.testing.assert_array_equal(three.u, one.u)
    with pytest.raises(NotConverged):
        nonlinear(tmp_path, step("*BOUNDARY", crushed), fixed=FIXED + "RIGHT, 1\n").solve()


@pytest.mark.parametrize(
    ("steps", "message"),
    [
        ([step("*BOUNDARY", "13, 1")] * 2, ""),
        ([step("*CLOAD", "22, 1, 1."), step("*BOUNDARY", "13, 1")], "in all steps of a nonlinear"),
        ([step("*CLOAD", "22, 1, 1.", static="*STATIC, DIRECT\n.001, 1.")], "more than 100 incr"),
        ([step("*CLOAD", "22, 1, 1.").replace("*STEP", "*STEP, PERTURBATION")], "PERTURBATION"),
        (["*INITIAL CONDITIONS, TYPE=STRESS\n7, 1., 0., 0., 0., 0., 0.\n", step()],
         "in a nonlinear deck; got STRESS"),
    ],
)  # fmt: skip
def test_steps_that_are_refused(steps: list[str], message: str, tmp_path: Path) -> None:
    if message:
        with pytest.raises(InputError, match=message):
            nonlinear(tmp_path, *steps)
    else:
        assert len(nonlinear(tmp_path, *steps).steps) == 2


@pytest.mark.parametrize(
    "heads", [("*STEP", "*STEP, NLGEOM"), ("*STEP, NLGEOM", "*STEP, NLGEOM=NO")]
)
def test_linear_steps_beside_others(heads: tuple[str, str], tmp_path: Path) -> None:
    parts = [step("*CLOAD", "22, 1, 1.").replace("*STEP", head) for head in heads]
    with pytest.raises(InputError, match="linear, beside steps with NLGEOM"):
        load_deck(write(tmp_path, deck(*parts)))
    parts = [step("*CLOAD", "22, 1, 1.").replace("*STEP", head) for head in (NLGEOM, "*STEP")]
    assert load_deck(write(tmp_path, deck(*parts))).nonlinear


def test_the_command_tells_of_load_steps(tmp_path: Path) -> None:
    static = "*STATIC, DIRECT\n0.5, 1."
    text = deck(step("*DLOAD", "9, P4, -1.5", static=static), material=METAL)
    path = write(tmp_path, text.replace("*STEP", NLGEOM))
    told: list[str] = []
    done = solve_deck(path, tmp_path / "out", backend="numpy", stress=True,
                      progress=lambda stage, share, words: told.append(words))  # fmt: skip
    (one,) = done.report["steps"]
    assert one["converged"] and one["load_steps"] == 2
    assert one["newton_iterations"] == sum(len(s.iterations) for s in done.solutions[0].steps) > 2
    np.testing.assert_allclose(one["force"], -np.array(one["reaction"]), rtol=0, atol=1e-5)
    assert 20.0 < one["force"][0] < 1.5 * 15.0  # a pull on a face that gets smaller
    assert any("equilibrium 2 of 2" in words for words in told)
    written = meshio.read(tmp_path / "out" / "solution_0001.vtu").point_data
    told = done.solutions[0].steps[-1].stress.nodal_results
    assert set(told) == {"piola_stress", "green_lagrange_strain", "energy", "plastic_strain"}
    for name, values in told.items():
        np.testing.assert_allclose(
            written[name], values, rtol=1e-6, atol=1e-6 * np.abs(values).max()
        )
    assert one["strain_energy"] == done.solutions[0].steps[-1].strain_energy > 0.0
    assert one["external_work"] > one["strain_energy"]  # it has yielded


def test_energy_that_nobody_knows_is_none(tmp_path: Path) -> None:
    text = deck(step("*DLOAD", "9, P4, -1.5"), material=METAL).replace("*STEP", NLGEOM)
    found = load_deck(write(tmp_path, text))
    (one,) = found.solve(backend="numpy")
    last = replace(one.steps[-1], stress=None)
    ended = replace(one, steps=(last,), strain_energy=np.array([last.strain_energy]))
    report = _step_report(found, found.steps[0], ended)
    assert report["strain_energy"] is report["energy_balance"] is None
    assert json.loads(json.dumps(report, allow_nan=False))["external_work"] > 0.0
