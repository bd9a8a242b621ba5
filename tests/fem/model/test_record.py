"""Records: values over time, from arrays and from CSV files."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import gpusim as gs
from gpusim.errors import InputError


def test_it_is_linear_in_between_and_stays_at_its_ends() -> None:
    record = gs.Record([0.0, 1.0, 3.0], np.array([[0.0, 5.0], [2.0, 5.0], [-2.0, 1.0]]))
    found = record.at(np.array([-1.0, 0.5, 2.0, 9.0]))
    assert found.tolist() == [[0.0, 5.0], [1.0, 5.0], [0.0, 3.0], [-2.0, 1.0]]
    slopes = record.slope(np.array([0.0, 0.5, 1.0, 3.0]))
    assert slopes.tolist() == [[2.0, 0.0], [2.0, 0.0], [-2.0, -2.0], [-2.0, -2.0]]
    part = record.within(0.5, 2.0, "here")
    assert part.times.tolist() == [0.5, 1.0, 2.0]
    assert np.array_equal(part.at(np.array([0.7, 1.9])), record.at(np.array([0.7, 1.9])))
    with pytest.raises(InputError, match=r"here: times; got 0 to 3; expected -1 to 2"):
        record.within(-1.0, 2.0, "here")


@pytest.mark.parametrize(
    ("times", "values", "told"),
    [
        ([0.0, 1.0, 1.0], [1.0] * 3, "got 1 after 1, number 2; expected times that increase"),
        ([0.0, np.nan], [1.0] * 2, "finite"),
        ([0.0, 1.0], [1.0, np.nan], "finite"),
        ([0.0, 1.0], [1.0] * 3, r"\(2,\) or \(2, k\)"),
        ([0.0], [1.0], "at least 2"),
        ("a", [1.0], "finite"),
        ([[0.0], [1.0, 2.0]], [1.0, 1.0], "finite"),
    ],
)
def test_others_are_refused(times: Any, values: Any, told: str) -> None:
    with pytest.raises(InputError, match=told):
        gs.Record(times, values)


def test_files(tmp_path: Path) -> None:
    path = tmp_path / "quake.csv"
    path.write_text("\ufefftime;ax;ay\n0;0;1\n\n0.5;-2.5e0;1\n1;0;0\n", encoding="utf-8")
    record = gs.read_record(path)
    assert record.times.tolist() == [0.0, 0.5, 1.0]
    assert record.values.tolist() == [[0.0, 1.0], [-2.5, 1.0], [0.0, 0.0]]


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("t,a\n0,1\n1,nan\n", "line 3; got '1,nan'; expected 2 finite numbers"),
        ("0,1\n1,2,3\n", "line 2"),
        ("t,a\n0,1\nend,2\n", "line 3"),
        ("t,a\n0\n1\n", "line 2; got '0'; expected 2"),
        ("t,a\n0,1\n", "got 1 lines of numbers; expected at least 2"),
        ("", "got 0 lines"),
        (
            "t,a\n0,1\n0.2,5\n0.1,2\n",
            "quake.csv: line 4; got '0.1,2'; expected times that increase",
        ),
        ("0,1\n0,2\n", r"quake\.csv: line 2; got '0,2'; expected times that increase"),
        ("0,1.0.0\n1,2\n2,3\n", "line 1; got '0,1.0.0'; expected 2 finite numbers"),
        ("t,0\n0,1\n1,2\n", "line 1"),
    ],
)
def test_files_that_are_none_are_refused(tmp_path: Path, text: str, told: str) -> None:
    path = tmp_path / "quake.csv"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=told):
        gs.read_record(path)
