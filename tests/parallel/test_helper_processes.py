"""Calls in processes of their own: what they return, what goes wrong, and who is left."""

from __future__ import annotations

import operator
import os
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from gpusim.parallel import processes
from gpusim.parallel.machine import processors
from gpusim.report import prepare_figures
from gpusim.report.figures import draw_convergence

needs_helpers = pytest.mark.skipif(processors() < 2, reason="one core: calls stay here")


@pytest.fixture
def helpers() -> None:
    prepare_figures()


def test_a_call_without_helpers_is_made_here() -> None:
    code = (
        "import os; from gpusim.parallel import processes as apart; "
        "print(apart.begin(os.getpid).result(), os.getpid())"
    )
    words = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    ).stdout.split()
    assert words[0] == words[1]


@needs_helpers
@pytest.mark.usefixtures("helpers")
def test_calls_are_made_elsewhere() -> None:
    calls = [processes.begin(operator.mul, k, 2.5) for k in range(20)]
    assert [call.result() for call in calls] == [2.5 * k for k in range(20)]
    assert processes.begin(os.getpid).result() != os.getpid()


@pytest.mark.usefixtures("helpers")
def test_errors_are_those_of_the_call() -> None:
    with pytest.raises(ZeroDivisionError):
        processes.begin(operator.truediv, 1, 0).result()
    assert processes.begin(operator.truediv, 1, 4).result() == 0.25


@needs_helpers
@pytest.mark.usefixtures("helpers")
def test_what_cannot_be_sent_is_called_here() -> None:
    lock = threading.Lock()
    assert processes.begin(lambda: lock.locked() or os.getpid()).result() == os.getpid()


@needs_helpers
def test_helpers_that_are_gone_fail_nobody() -> None:
    code = """
import os, signal, time
from gpusim.parallel import processes
processes.prepare()
for _ in range(2):
    processes.begin(os.kill, processes.begin(os.getpid).result(), signal.SIGKILL)
    call = processes.begin(os.getppid)
    print(call.result() in (os.getpid(), os.getppid()))
"""
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert ran.stdout.split() == ["True"] * 2, ran.stderr


@needs_helpers
@pytest.mark.skipif(sys.platform != "linux", reason="looks into /proc")
@pytest.mark.parametrize("end", ["", "os.kill(os.getpid(), signal.SIGKILL)"])
def test_helpers_end_with_their_caller(end: str) -> None:
    code = f"""
import os, signal, time
from gpusim.parallel import processes
processes.prepare()
print(*{{processes.begin(os.getpid).result() for _ in range(20)}}, flush=True)
{end}
"""
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    numbers = ran.stdout.split()
    assert numbers
    assert ran.stderr == ""
    for number in numbers:
        stat = Path(f"/proc/{number}/stat")
        for _ in range(200):
            if not stat.exists() or ") Z" in stat.read_text():
                break
            time.sleep(0.02)
        else:
            pytest.fail(f"process {number} is still there")


@needs_helpers
def test_a_command_does_not_wait_for_helpers(tmp_path: Path) -> None:
    (tmp_path / "slow.py").write_text("import time; time.sleep(300)")
    code = "from gpusim.parallel import processes; processes.prepare('slow'); processes.stop()"
    ran = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=60,
        env=os.environ | {"PYTHONPATH": os.pathsep.join((os.getcwd(), str(tmp_path)))},
    )  # fmt: skip
    assert (ran.returncode, ran.stdout, ran.stderr) == (0, "", "")


@needs_helpers
def test_a_program_without_a_main_guard_is_not_run_again(tmp_path: Path) -> None:
    program = tmp_path / "program.py"
    program.write_text(
        "import os; from gpusim.parallel import processes\n"
        "print('here'); processes.prepare(); print(processes.begin(os.getpid).result() > 0)\n"
    )
    ran = subprocess.run([sys.executable, program], capture_output=True, text=True, timeout=60)
    assert (ran.stdout.split(), ran.stderr) == (["here", "True"], "")


@needs_helpers
@pytest.mark.skipif(sys.platform != "linux", reason="descriptors and forks as under Linux")
@pytest.mark.parametrize("closed", [(0,), (1,), (0, 1), (0, 1, 2)])
def test_closed_standard_streams_are_no_pipes(closed: tuple[int, ...], tmp_path: Path) -> None:
    found = tmp_path / "found"
    code = f"""
import os, sys
for number in {closed}:
    os.close(number)
from gpusim.parallel import processes as apart
apart.prepare()
calls = [apart.begin(os.getpid).result() for _ in range(20)]
open({str(found)!r}, "w").write(str(os.getpid() in calls))
"""
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert (ran.returncode, ran.stderr) == (0, "")
    # without a place for errors no helper starts, and calls are made here
    assert found.read_text() == str(2 in closed)


@needs_helpers
@pytest.mark.skipif(not hasattr(os, "fork"), reason="no copies of a process")
def test_a_copy_of_the_process_has_no_helpers_until_it_asks_for_some() -> None:
    code = """
import os
from gpusim.parallel import processes as apart
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
@pytest.mark.usefixtures("helpers")
def test_relative_names_are_those_of_the_call(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert processes.begin(os.getcwd).result() == str(tmp_path)


@needs_helpers
def test_helpers_leave_no_temporary_folders(tmp_path: Path) -> None:
    (tmp_path / "temporary").mkdir()
    code = "import os; from gpusim.parallel import processes as apart;"
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
    processes.begin(draw_convergence, residuals, there).result()
    draw_convergence(residuals, here)
    assert there.read_bytes() == here.read_bytes()
