"""report.json: its shape is a public contract."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

from gpusim._version import __version__
from gpusim.errors import InputError
from gpusim.report import Measurement, Overlay, Report, Series, SolutionSummary, Stage


def full_report() -> Report:
    return Report(
        scene="crane",
        adapter="llvmpipe",
        status="done",
        stages=(
            Stage("mesh", "run", "1 body", 0.25),
            Stage("solve", "reused", "unchanged", 0.0),
            Stage("truth", "skipped", "not asked for", 0.0),
        ),
        solution=SolutionSummary(300, 12, True, 3e-7, "multigrid"),
        measurements=(
            Measurement.compare("tip", "mm", 32.70, 32.68, tolerance_relative=1e-3),
            Measurement.compare("lost", "mm", math.nan, 1.0),
            Measurement("odd", "px", math.inf, -math.inf, math.nan, math.nan),
        ),
        warnings=("ä < b",),
    )


def test_json_is_exactly_the_documented_shape() -> None:
    content = json.loads(full_report().to_json())
    assert content == {
        "schema": 1,
        "version": __version__,
        "scene": "crane",
        "adapter": "llvmpipe",
        "status": "done",
        "stages": [
            {"name": "mesh", "state": "run", "reason": "1 body", "seconds": 0.25},
            {"name": "solve", "state": "reused", "reason": "unchanged", "seconds": 0.0},
            {"name": "truth", "state": "skipped", "reason": "not asked for", "seconds": 0.0},
        ],
        "solution": {
            "unknowns": 300,
            "iterations": 12,
            "converged": True,
            "error_estimate": 3e-7,
            "method": "multigrid",
        },
        "mesh": [],
        "mechanics": None,
        "fields": [],
        "load_path": None,
        "modes": [],
        "measurements": [
            {
                "name": "tip",
                "unit": "mm",
                "measured": 32.70,
                "truth": 32.68,
                "error": pytest.approx(0.02, rel=1e-9),
                "error_relative": pytest.approx(0.02 / 32.68, rel=1e-9),
            },
            {
                "name": "lost",
                "unit": "mm",
                "measured": None,
                "truth": 1.0,
                "error": None,
                "error_relative": None,
            },
            {
                "name": "odd",
                "unit": "px",
                "measured": None,
                "truth": None,
                "error": None,
                "error_relative": None,
            },
        ],
        "published": [],
        "budget": None,
        "explanations": [],
        "warnings": ["ä < b"],
        "facts": {},
    }


def test_json_without_solution_and_with_numpy_numbers() -> None:
    stage = Stage("mesh", "run", "", np.float64(0.5))
    solution = SolutionSummary(
        np.int64(3),  # type: ignore[arg-type]
        np.int32(4),  # type: ignore[arg-type]
        np.True_,  # type: ignore[arg-type]
        np.float32("nan"),  # type: ignore[arg-type]
    )
    text = Report("a", "b", "done", stages=(stage,), solution=solution).to_json()
    assert "NaN" not in text
    assert json.loads(text)["solution"] == {
        "unknowns": 3,
        "iterations": 4,
        "converged": True,
        "error_estimate": None,
        "method": "",
    }
    assert json.loads(Report("a", "b", "done").to_json())["solution"] is None


def test_a_failed_run_says_why() -> None:
    report = Report("a", "b", "failed", failure="solve: stagnated", warnings=("old",))
    content = json.loads(report.to_json())
    assert content["status"] == "failed"
    assert content["warnings"] == ["solve: stagnated", "old"]
    with pytest.raises(InputError, match="exactly if the run failed"):
        Report("a", "b", "failed")
    with pytest.raises(InputError, match="exactly if the run failed"):
        Report("a", "b", "done", failure="x")


@pytest.mark.parametrize(
    ("measured", "truth", "tolerance", "verdict"),
    [
        (1.001, 1.0, 0.002, "good"),
        (-1.001, -1.0, 0.002, "good"),
        (0.9979, 1.0, 0.002, "bad"),
        (math.nan, 1.0, 0.002, "bad"),
        (math.nan, 1.0, None, "bad"),
        (1.0, math.nan, 0.002, "unknown"),
        (1.0, 1.0, None, "unknown"),
        (0.0, 0.0, 0.002, "good"),
        (1e-9, 0.0, 0.002, "bad"),
    ],
)
def test_verdict(measured: float, truth: float, tolerance: float | None, verdict: str) -> None:
    item = Measurement.compare("a", "mm", measured, truth, tolerance_relative=tolerance)
    assert item.verdict == verdict


def test_relative_error_keeps_its_sign_and_needs_a_truth() -> None:
    assert Measurement.compare("a", "mm", -1.01, -1.0).error_relative == pytest.approx(-0.01)
    assert math.isnan(Measurement.compare("a", "mm", 1.0, 0.0).error_relative)


@pytest.mark.parametrize(("truth", "told"), [(0.2, True), (1e-3, False), (0.0, False)])
def test_a_truth_below_the_noise_has_no_relative_error_to_tell(truth: float, told: bool) -> None:
    item = Measurement.compare("exy", "um/m", truth - 0.5, truth)
    assert math.isfinite(item.relative_told) == told
    assert not told or item.relative_told == item.error_relative


def test_arrays_are_checked() -> None:
    x = np.arange(3.0)
    with pytest.raises(InputError, match=r"measured \(2,\)"):
        Series("s", x, x[:2], x, "x (mm)", "y", "mm")
    with pytest.raises(InputError, match="expected twice"):
        Series("s", x, x, x, "x (mm)", "y", "mm", truth_x=x)
    with pytest.raises(InputError, match=r"expected \(M, 2\)"):
        Overlay("o", "a.png", np.zeros((3, 3)), np.zeros((3, 3)))  # type: ignore[arg-type]
    with pytest.raises(InputError, match=r"expected \(3, 2\)"):
        Overlay("o", "a.png", np.zeros((3, 2)), np.zeros((2, 2)))  # type: ignore[arg-type]
    with pytest.raises(InputError, match="expected finite"):
        Overlay("o", "a.png", np.full((3, 2), np.nan), np.zeros((3, 2)))  # type: ignore[arg-type]
