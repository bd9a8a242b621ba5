"""Calls in processes of their own: what they return, what goes wrong, and who is left."""

from __future__ import annotations

import operator
import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from gpusim import apart
from gpusim.report import prepare_figures
from gpusim.report.figures import draw_convergence

needs_helpers = pytest.mark.skipif(apart._cores() < 2, reason="one core: calls stay here")


@pytest.fixture
def helpers() -> None:
    prepare_figures()


def test_a_call_without_helpers_is_made_here() -> None:
    code = (
        "import os; from gpusim import apart; print(apart.begin(os.getpid).result(), os.getpid())"
    )
    words = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    ).stdout.split()
    assert words[0] == words[1]


@needs_helpers
@pytest.mark.usefixtures("helpers")
def test_calls_are_made_elsewhere() -> None:
    calls = [apart.begin(operator.mul, k, 2.5) for k in range(20)]
    assert [call.result() for call in calls] == [2.5 * k for k in range(20)]
    assert apart.begin(os.getpid).result() != os.getpid()


@pytest.mark.usefixtures("helpers")
def test_errors_are_those_of_the_call() -> None:
    with pytest.raises(ZeroDivisionError):
        apart.begin(operator.truediv, 1, 0).result()
    assert apart.begin(operator.truediv, 1, 4).result() == 0.25


@needs_helpers
@pytest.mark.usefixtures("helpers")
def test_what_cannot_be_sent_is_called_here() -> None:
    assert apart.begin(lambda: os.getpid()).result() == os.getpid()  # a lambda has no name


@needs_helpers
def test_a_helper_that_is_gone_fails_nobody(monkeypatch: pytest.MonkeyPatch) -> None:
    team = apart._Team(1, ())
    try:
        monkeypatch.setattr(apart, "_team", team)
        team.process.kill()
        team.process.wait()
        assert apart.begin(os.getpid).result() == os.getpid()
        assert apart.begin(operator.add, 1, 2).result() == 3
    finally:
        team.end()


@needs_helpers
@pytest.mark.skipif(sys.platform != "linux", reason="helpers divide under Linux alone")
def test_helpers_divide_and_end_with_their_caller() -> None:
    team = apart._Team(2, ())
    numbers: set[int] = set()
    for _ in range(200):  # until both have got ready
        numbers.add(team.call(os.getpid, (), {}))
        time.sleep(0.02 if len(numbers) < 2 else 0.0)
    assert len(numbers) == 2 and os.getpid() not in numbers
    team.end()
    for number in numbers:
        for _ in range(100):
            if (
                not Path(f"/proc/{number}").exists()
                or "Z" in Path(f"/proc/{number}/stat").read_text()
            ):
                break
            time.sleep(0.02)
        else:
            pytest.fail(f"process {number} is still there")


@needs_helpers
def test_what_a_library_prints_is_no_answer(monkeypatch: pytest.MonkeyPatch) -> None:
    team = apart._Team(1, ())
    try:
        monkeypatch.setattr(apart, "_team", team)
        assert apart.begin(os.system, "echo printed").result() == 0
        assert apart.begin(operator.add, 1, 2).result() == 3
    finally:
        team.end()


@pytest.mark.usefixtures("helpers")
def test_a_figure_is_the_same_wherever_it_is_drawn(tmp_path: Path) -> None:
    residuals = (1.0, 0.1, 0.02, 1e-7)
    there, here = tmp_path / "there.png", tmp_path / "here.png"
    apart.begin(draw_convergence, residuals, there).result()
    draw_convergence(residuals, here)
    assert there.read_bytes() == here.read_bytes()
