"""The benchmark of large displacements: its rows, and CalculiX's run."""

from __future__ import annotations

import shutil
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.nonlinear.__main__ import markdown
from benchmarks.nonlinear.accuracy import HEADINGS, Row, measured
from benchmarks.nonlinear.calculix import _deck, calculix
from benchmarks.nonlinear.speed import bent_cantilever, waisted_plate
from benchmarks.nonlinear.stretch import HEADINGS as STRETCH_HEADINGS
from benchmarks.nonlinear.stretch import exact_force, stretched_block, torch_fem
from gpusim.fem import solve
from tests.support.nonlinear_cases import NonlinearCase, end_load


def coarse(factor: float = 1.0) -> NonlinearCase:
    case = end_load("hex8", (10, 1, 1), (1.0,))
    return replace(case, factors=factor * case.factors)


def test_a_row_says_what_was_measured() -> None:
    row = dict(zip(HEADINGS, measured(Row("hex8 10x1x1", coarse, 0.05)), strict=True))
    assert row["case"] == "elastica, end load" and row["unknowns"] == "120"
    assert row["wanted"] == "5.0%" and 0.0 < float(row["error"].removesuffix("%")) < 5.0
    value, reference = (np.array(row[k].split(), dtype=float) for k in ("value", "reference"))
    assert np.abs(value / reference - 1.0).max() < 0.05


def test_a_case_without_an_answer_has_its_row() -> None:
    row = measured(Row("hex8 10x1x1", lambda: coarse(1e9), 0.02))
    assert len(row) == len(HEADINGS) and "load step 1 of 1" in row[9]
    assert len(list(markdown(HEADINGS, [row]))) == 3


@pytest.mark.skipif(shutil.which("ccx") is None, reason="CalculiX isn't installed")
def test_calculix_bends_the_same_cantilever() -> None:
    model = bent_cantilever((40, 2, 1))
    other = calculix(model)
    assert other is not None
    own = solve(model, geometry="nonlinear").u
    assert np.abs(other.u - own).max() <= 2e-3 * np.abs(own).max()
    assert other.processor > 0.0 and other.wall > 0.0


def test_the_stretched_block_takes_the_force_of_its_law() -> None:
    model, end = stretched_block(5)
    factors = (np.geomspace(1.0, 10.0, 6)[1:] - 1.0) / 9.0
    found = solve(model, geometry="nonlinear", factors=factors, tolerance=1e-9)
    assert found.reactions[end, 0].sum() == pytest.approx(exact_force(), rel=1e-8)


def test_torch_fem_may_be_missing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("GPUSIM_PEERS_PYTHON", "/nowhere/python")
    row = torch_fem(5, exact_force())
    assert row[:2] == ["torch-fem", "missing"] and len(row) == len(STRETCH_HEADINGS)


def test_a_deck_of_metal_has_its_curve() -> None:
    """On coarse meshes CalculiX itself now and then finds nothing, so it isn't run here."""
    lines = _deck(waisted_plate((4, 2, 1)), 0.25)
    first = lines.index("*PLASTIC") + 1
    stress, strain = np.array([line.split(",") for line in lines[first : first + 201]], float).T
    np.testing.assert_allclose(stress, 400.0 - 150.0 * np.exp(-20.0 * strain) + 100.0 * strain)
    assert strain[0] == 0.0 and strain[-1] == 0.4 and lines[first + 201].startswith("*SOLID")
