"""Pictures of thousands of frames are few rows, for readers of plans, reports and progress."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from gpusim.cli.console import ProgressDisplay
from gpusim.report import Report, Stage, write_report
from gpusim.report.model import StageState
from gpusim.report.stage_rows import stage_rows
from gpusim.report.text import duration

FRONT, CALIB = "render/front/", "render/front/calib-"


def pictures(series: str, numbers: range, state: StageState = "run") -> list[Stage]:
    return [Stage(f"{series}{number:04d}", state, "not made yet", 0.5) for number in numbers]


def test_frames_beyond_the_tenth_that_are_alike_are_one_row() -> None:
    stages = [
        Stage("solve", "run", "not made yet", 1.0),
        *pictures(FRONT, range(8000)), *pictures(FRONT, range(8000, 8003), "reused"),
        *pictures(FRONT, range(8003, 8004)),
        *pictures(CALIB, range(3)), *pictures("a/render/render/", range(9, 12)),
    ]  # fmt: skip
    rows = stage_rows(stages)
    names = ["solve", *(f"{FRONT}{number:04d}" for number in range(10)), f"{FRONT}0010..7999",
             f"{FRONT}8000..8002", f"{FRONT}8003", f"{CALIB}0000..0002", "a/render/render/0009",
             "a/render/render/0010..0011"]  # fmt: skip
    assert [name for name, _ in rows] == names
    assert [stage for _, alike in rows for stage in alike] == stages


def test_other_cameras_and_reasons_are_other_rows() -> None:
    one, two = pictures(FRONT, range(10, 12)), pictures("render/back/", range(12, 14))
    two[1] = Stage(two[1].name, "run", "light changed", 0.5)
    names = [f"{FRONT}0010..0011", "render/back/0012", "render/back/0013"]
    assert [name for name, _ in stage_rows([*one, *two])] == names


def test_the_page_has_rows_and_the_numbers_have_stages(tmp_path: Path) -> None:
    stages = tuple(pictures(FRONT, range(2000)))
    write_report(Report("a", "none", "done", stages=stages), tmp_path)
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert page.count('<span class="name">render/') == 11
    assert f"{FRONT}0010..1999" in page and "not made yet; 1990 pictures" in page
    assert duration(1990 * 0.5) in page
    assert len(json.loads((tmp_path / "report.json").read_text())["stages"]) == 2000


def told(capsys: pytest.CaptureFixture[str], count: int, *others: str) -> list[str]:
    with ProgressDisplay(quiet=False, stream_is_result=False) as progress:
        for number in range(count):
            for done in (0.0, 0.5, 1.0):
                progress(f"{FRONT}{number:04d}", done, "words")
        for name in others:
            progress(name, 1.0, "")
    return [line.split()[2] for line in capsys.readouterr().out.splitlines()]


def test_progress_in_a_pipe(capsys: pytest.CaptureFixture[str]) -> None:
    singles = [f"{FRONT}{number:04d}" for number in range(10)]
    tens = [f"{FRONT}{first:04d}..{first + 9:04d}" for first in range(10, 100, 10)]
    assert told(capsys, 9) == singles[:9]
    assert told(capsys, 11, "report") == [*singles, f"{FRONT}0010", "report"]
    assert told(capsys, 25) == [*singles, tens[0], f"{FRONT}0020..0024"]
    assert told(capsys, 150, "truth", "report") == [
        *singles, *tens, "truth", f"{FRONT}0100..0149", "report"
    ]  # fmt: skip
    lines = told(capsys, 10_000)
    assert len(lines) == 37 and lines[-1] == f"{FRONT}9000..9999"
