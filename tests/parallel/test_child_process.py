"""Calls in a process of their own: results, errors, deaths, limits, interrupts."""

from __future__ import annotations

import operator
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from gpusim.errors import InputError
from gpusim.mesh import box
from gpusim.parallel.processes import call_in_child


def test_the_call_is_made_elsewhere_and_its_result_comes_back() -> None:
    assert call_in_child("pid", 60, os.getpid) != os.getpid()
    assert call_in_child("sum", 60, sum, [1, 2], start=4) == 7
    assert call_in_child("print", 60, print, "x" * 100_000) is None


def test_errors_are_those_of_the_call_or_name_what_was_done() -> None:
    with pytest.raises(InputError, match=r"^box: divisions") as told:
        call_in_child("a.step", 60, box, (1.0, 1.0, 1.0), (0, 1, 1))
    assert "a.step" not in str(told.value)
    with pytest.raises(InputError, match=r"a\.step: damaged, .* got ValueError: invalid literal"):
        call_in_child("a.step", 60, int, "x")


@pytest.mark.skipif(sys.platform == "win32", reason="signals")
def test_deaths_and_limits_are_errors_that_name_the_file() -> None:
    with pytest.raises(InputError, match=r"a\.step: the process that does this died \(SIGABRT\)"):
        call_in_child("a.step", 60, os.abort)
    with pytest.raises(InputError, match=r"ended with status 7"):
        call_in_child("a.step", 60, os._exit, 7)
    with pytest.raises(InputError, match="takes more than the memory"):
        call_in_child("a.step", 60, operator.mul, b"x", 1 << 45)
    began = time.monotonic()
    with pytest.raises(InputError, match=r"a\.step: .* was not done after 0\.3 s, its time limit"):
        call_in_child("a.step", 0.3, time.sleep, 60)
    assert time.monotonic() - began < 30


def running(pid: int) -> bool:
    try:
        state = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0]
    except OSError:
        return False
    return state != "Z"


@pytest.mark.skipif(sys.platform != "linux", reason="looks into /proc")
@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGKILL])
def test_a_child_ends_with_its_caller(how: int, tmp_path: Path) -> None:
    note = tmp_path / "pid"
    work = f"open({str(note)!r}, 'w').write(str(__import__('os').getpid())),"
    code = (
        "import gpusim.parallel.processes as c; "
        f'c.call_in_child("x", 60, eval, "({work} __import__(\'time\').sleep(60))")'
    )
    # a run of the tests in the background ignores interrupts, and so would what it starts
    heard = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler); "
    parent = subprocess.Popen([sys.executable, "-c", heard + code], stderr=subprocess.DEVNULL)
    while not (note.exists() and note.read_text()):
        assert parent.poll() is None
        time.sleep(0.02)
    child = int(note.read_text())
    parent.send_signal(how)
    parent.wait(30)
    until = time.monotonic() + 20
    while running(child):
        assert time.monotonic() < until
        time.sleep(0.02)
