"""Errors beside published ones, and the error budget, as data and on the page."""

from __future__ import annotations

import json
import math
from pathlib import Path

import pytest

from gpusim.report import Budget, BudgetRow, Measurement, Published, Report, write_report

BUDGET = Budget(
    quantities=(("tip", "mm"), ("RMS", "px")),
    rows=(
        BudgetRow("all", "", (0.05, 0.004)),
        BudgetRow("none", "", (0.01, 0.001)),
        BudgetRow("only", "noise", (0.03, math.nan)),
        BudgetRow("no", "noise", (0.02, 0.0025)),
    ),
)


def test_what_an_effect_adds_is_the_difference_of_two_states() -> None:
    assert BUDGET.sources == ("noise",)
    added, removed = BUDGET.added("noise"), BUDGET.removed("noise")
    assert added[0] == pytest.approx(0.02) and math.isnan(added[1])
    assert removed == (pytest.approx(0.03), pytest.approx(0.0015))
    with pytest.raises(KeyError):
        BUDGET.added("psf")


def test_published_errors_and_what_is_better() -> None:
    assert Published("a", -0.001, 0.0026, "x").better
    assert not Published("a", 0.003, 0.0026, "x").better
    assert not Published("a", math.nan, 0.0026, "x").better


def test_both_stand_in_json_and_on_the_page(tmp_path: Path) -> None:
    published = (Published("tip of the crane", 0.0004, 0.0026, "Somebody 2021"),)
    own = (Measurement.compare("tip of the crane", "mm", 10.004, 10.0),)
    report = Report("a", "b", "done", measurements=own, published=published, budget=BUDGET)
    paths = write_report(report, tmp_path)
    content = json.loads(paths.json.read_text(encoding="utf-8"))
    assert content["published"] == [
        {"name": "tip of the crane", "error_relative": 0.0004, "published_relative": 0.0026,
         "source": "Somebody 2021"}
    ]  # fmt: skip
    assert content["budget"]["rows"][2] == {
        "state": "only", "source": "noise", "errors": [0.03, None]
    }  # fmt: skip
    page = paths.html.read_text(encoding="utf-8")
    for text in ("Somebody 2021", "only noise", "everything but noise", "0.0300", "Error budget"):
        assert text in page
