"""Calls in processes of their own: what they return, what goes wrong, and who is left."""

from __future__ import annotations

import operator
import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from gpusim.parallel import helper_processes
from gpusim.parallel.cpu_budget import processors
from gpusim.report import prepare_figures
from gpusim.report.figures import draw_convergence

needs_helpers = pytest.mark.skipif(processors() < 2, reason="one core: calls stay here")


@pytest.fixture
def helpers() -> None:
    prepare_figures()


def test_a_call_without_helpers_is_made_here() -> None:
    code = (
        "import os; from gpusim.parallel import helper_processes as apart; "
        "print(apart.begin(os.getpid).result(), os.getpid())"
    )
    words = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    ).stdout.split()
    assert words[0] == words[1]


@needs_helpers
@pytest.mark.usefixtures("helpers")
def test_calls_are_made_elsewhere() -> None:
    calls = [helper_processes.begin(operator.mul, k, 2.5) for k in range(20)]
    assert [call.result() for call in calls] == [2.5 * k for k in range(20)]
    assert helper_processes.begin(os.getpid).result() != os.getpid()


@pytest.mark.usefixtures("helpers")
def test_errors_are_those_of_the_call() -> None:
    with pytest.raises(ZeroDivisionError):
        helper_processes.begin(operator.truediv, 1, 0).result()
    assert helper_processes.begin(operator.truediv, 1, 4).result() == 0.25


@needs_helpers
@pytest.mark.usefixtures("helpers")
def test_what_cannot_be_sent_is_called_here() -> None:
    assert (
        helper_processes.begin(lambda: os.getpid()).result() == os.getpid()
    )  # a lambda has no name


@needs_helpers
def test_a_helper_that_is_gone_fails_nobody(monkeypatch: pytest.MonkeyPatch) -> None:
    team = helper_processes._Team(1, ())
    try:
        monkeypatch.setattr(helper_processes, "_team", team)
        team.process.kill()
        team.process.wait()
        assert helper_processes.begin(os.getpid).result() == os.getpid()
        assert helper_processes.begin(operator.add, 1, 2).result() == 3
    finally:
        team.end()


@needs_helpers
@pytest.mark.skipif(sys.platform != "linux", reason="helpers divide under Linux alone")
def test_helpers_divide_and_end_with_their_caller() -> None:
    team = helper_processes._Team(2, ())
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
    team = helper_processes._Team(1, ())
    try:
        monkeypatch.setattr(helper_processes, "_team", team)
        assert helper_processes.begin(os.system, "echo printed").result() == 0
        assert helper_processes.begin(operator.add, 1, 2).result() == 3
    finally:
        team.end()


@needs_helpers
@pytest.mark.skipif(sys.platform != "linux", reason="descriptors and forks as under Linux")
@pytest.mark.parametrize("closed", [(0,), (1,), (0, 1), (0, 1, 2)])
def test_closed_standard_streams_are_no_pipes(closed: tuple[int, ...], tmp_path: Path) -> None:
    found = tmp_path / "found"
    code = f"""
import os, sys
for number in {closed}:
    os.close(number)
from gpusim.parallel import helper_processes as apart
apart.prepare()
calls = [apart.begin(os.getpid).result() for _ in range(20)]
open({str(found)!r}, "w").write(str(os.getpid() in calls))
"""
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert (ran.returncode, ran.stderr) == (0, "")
    assert found.read_text() == "False"


@needs_helpers
@pytest.mark.skipif(not hasattr(os, "fork"), reason="no copies of a process")
def test_a_copy_of_the_process_has_no_helpers_until_it_asks_for_some() -> None:
    code = """
import os
from gpusim.parallel import helper_processes as apart
apart.prepare()
print(apart.begin(os.getpid).result() != os.getpid(), flush=True)
if os.fork() == 0:
    print(apart.begin(os.getpid).result() == os.getpid())
    apart.prepare()
    print(apart.begin(os.getpid).result() != os.getpid(), flush=True)
    raise SystemExit
os.wait()
print(apart.begin(os.getpid).result() != os.getpid())
"""
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert ran.stdout.split() == ["True"] * 4, ran.stderr


@needs_helpers
def test_relative_names_are_those_of_the_call(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    team = helper_processes._Team(1, ())
    try:
        monkeypatch.chdir(tmp_path)
        assert team.call(os.getcwd, (), {}) == str(tmp_path)
    finally:
        team.end()


@needs_helpers
def test_helpers_leave_no_temporary_folders(tmp_path: Path) -> None:
    (tmp_path / "temporary").mkdir()
    code = "import os; from gpusim.parallel import helper_processes as apart;"
    code += "from gpusim.report import prepare_figures;"
    code += "prepare_figures(); print(apart.begin(os.getpid).result())"
    nowhere = {"HOME": str(tmp_path / "no/home"), "TMPDIR": str(tmp_path / "temporary")}
    nowhere |= {"XDG_CONFIG_HOME": "/dev/null", "XDG_CACHE_HOME": "/dev/null"}
    environ = {**os.environ, **nowhere, "MPLBACKEND": "of another program"}
    environ.pop("MPLCONFIGDIR", None)
    ran = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=120, env=environ
    )
    assert "Traceback" not in ran.stderr
    assert ran.stdout.strip().isdigit()
    assert not list((tmp_path / "temporary").iterdir())


@pytest.mark.usefixtures("helpers")
def test_a_figure_is_the_same_wherever_it_is_drawn(tmp_path: Path) -> None:
    residuals = (1.0, 0.1, 0.02, 1e-7)
    there, here = tmp_path / "there.png", tmp_path / "here.png"
    helper_processes.begin(draw_convergence, residuals, there).result()
    draw_convergence(residuals, here)
    assert there.read_bytes() == here.read_bytes()
