"""The benchmark of vibration: its rows, other programs, and frequencies in extended precision."""

from __future__ import annotations

import shutil
import sys
from functools import partial

import numpy as np
import pytest
from scipy.sparse import csr_matrix, eye

from benchmarks.vibration import dense
from benchmarks.vibration.accuracy import HEADINGS, Quantity
from benchmarks.vibration.peers import calculix_modes, calculix_steps, eigensolvers
from benchmarks.vibration.rayleigh import rayleigh_frequencies
from benchmarks.vibration.speed import (
    MODES_HEADINGS,
    STEPS_HEADINGS,
    SpeedCase,
    modes_speed,
    newmark,
    steps_speed,
)
from gpusim.bench.solver_cases import STEEL, Case
from gpusim.mesh import box
from tests.support.vibration_reference import dense_modes, span_errors

SIZE, DIVISIONS = (100.0, 40.0, 20.0), (6, 3, 2)
needs_calculix = pytest.mark.skipif(shutil.which("ccx") is None, reason="CalculiX isn't installed")


def small(rule: str = "incompatible") -> SpeedCase:
    build = partial(box, SIZE, DIVISIONS)
    return SpeedCase.of(Case("tiny", "cube", "small", "hex8", rule, STEEL, build, (0.0, 3.0, -9.0),
                             DIVISIONS, SIZE))  # fmt: skip


def test_the_matrices_of_other_solvers_are_ours() -> None:
    case = small()
    (run,) = eigensolvers(*case.matrices(), 6, ["superlu"], 60.0)
    assert not run.failed and run.wall > 0.0 and run.processor > 0.0
    exact = dense_modes(case.model, case.rules).frequencies[:6]
    np.testing.assert_allclose(run.values, exact, rtol=1e-9)


def test_solvers_may_be_missing_or_fail(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("GPUSIM_PEERS_PYTHON", "/nowhere/python")
    # an interpreter that has no SLEPc
    monkeypatch.setenv("SLEPC_PYTHON", sys.executable)
    matrix = csr_matrix(eye(4, format="csr"))
    missing, failed = eigensolvers(matrix, matrix, 1, ["pardiso", "slepc"], 60.0)
    assert missing.failed == "missing" and "petsc4py" in failed.failed


@needs_calculix
def test_calculix_vibrates_alike() -> None:
    """Fully integrated cells have the same mass there; its C3D8I has a mass of its own."""
    case, rules = small("full"), {"hex8": "full"}
    exact = dense_modes(case.model, rules)
    run = calculix_modes(case.model, rules, 6, 60.0)
    np.testing.assert_allclose(run.values, exact.frequencies[:6], rtol=1e-6)
    step = 0.01 / exact.frequencies[0]
    moved = calculix_steps(case.model, rules, step, 10, 60.0)
    none = np.zeros(len(exact.angular))
    wanted = exact.newmark(case.model.load_cases[0], step, 10, none)[-1]
    assert moved.values is not None
    # it is content with half a per cent of the forces in each step
    assert np.abs(moved.values - wanted).max() <= 2e-4 * np.abs(wanted).max()
    _, ours, told = newmark(case, step, 20, 10)
    assert np.abs(ours - wanted).max() <= 1e-6 * np.abs(wanted).max() and "20 steps" in told


def test_extended_precision_finds_the_frequencies_of_any_basis() -> None:
    case = small()
    exact = dense_modes(case.model, case.rules)
    # in other combinations, and other sizes
    turn = np.random.default_rng(1).normal(size=(5, 5)) * np.geomspace(1e-3, 1e3, 5)[:, None]
    mixed = np.tensordot(turn, exact.shapes[:5], axes=1)
    found = rayleigh_frequencies(case.model, case.rules, mixed)
    np.testing.assert_allclose(found, exact.frequencies[:5], rtol=1e-10)
    # an error of the shapes enters by its square
    share = 1e-3
    moved = exact.shapes[:1] + share * exact.shapes[7:8]
    first, other = exact.frequencies[[0, 7]]
    wanted = np.sqrt((first**2 + (share * other) ** 2) / (1.0 + share**2))
    np.testing.assert_allclose(rayleigh_frequencies(case.model, case.rules, moved), wanted, 1e-10)


def test_rows_have_all_columns(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("benchmarks.vibration.speed.speed_cases", lambda size, name: [small()])
    (row,) = modes_speed("small", "", 4, 1, False, 60.0)
    cells = dict(zip(MODES_HEADINGS, row, strict=True))
    assert cells["modes"] == "4" and float(cells["error of f"]) < 1e-8
    (row,) = steps_speed("small", "", 20, False, 60.0)
    assert len(row) == len(STEPS_HEADINGS)
    one = Quantity("case", "mesh", 1, (0.0, 0.0), np.ones(2), np.array([1.0, 1.01]), 0.1, "nobody")
    cells = dict(zip(HEADINGS, one.row(), strict=True))
    assert cells["error"] == "0.990%" and cells["off what is published"] == ""


def test_a_wrong_shape_is_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two modes turned into one another have their frequencies, and other shapes."""
    (case,) = [one for one in dense.small_cases() if one.name == "hex8 full"]
    model = case.build()
    exact = dense_modes(model, case.formulation).lowest(8)
    row = dense.compared(case, model, exact.frequencies, exact.shapes, "dense")
    assert row[-2] == "yes" and len(row) == len(dense.HEADINGS)
    angle = 1e-3
    turned = exact.shapes.copy()
    turned[0] = np.cos(angle) * exact.shapes[0] + np.sin(angle) * exact.shapes[3]
    row = dense.compared(case, model, exact.frequencies, turned, "dense")
    assert row[-2] == "NO" and row[-3] == "1e-06"
    mass = csr_matrix(eye(turned[0].size, format="csr"))
    assert span_errors(exact.shapes, exact.shapes, mass, []).size == 0
