"""Interrupts come where they break nothing: after an import, after what a library calls."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.skipif(not hasattr(signal, "setitimer"), reason="no timers")

MODULE = """
import os, signal
os.kill(os.getpid(), signal.SIGINT)
here = [number for number in range(100_000)]
whole = True
"""


def interrupted(code: str, folder: Path) -> subprocess.CompletedProcess[str]:
    """Python's end of a program that raises KeyboardInterrupt where it may."""
    start = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler)\n"
    start += "from gpusim.interrupts import raise_again; raise_again()\n"
    return subprocess.run(
        [sys.executable, "-c", start + code], capture_output=True, text=True, timeout=60,
        cwd=folder, env=os.environ | {"PYTHONPATH": os.getcwd()},
    )  # fmt: skip


def test_an_import_is_finished_first(tmp_path: Path) -> None:
    (tmp_path / "told.py").write_text(MODULE)
    ran = interrupted(
        "import sys, time\n"
        "try:\n"
        "    import told\n"
        "    time.sleep(30)\n"
        "except KeyboardInterrupt:\n"
        "    print('interrupted', sys.modules['told'].whole)\n",
        tmp_path,
    )
    assert (ran.stdout.split(), ran.stderr) == (["interrupted", "True"], "")


def test_what_hdf5_calls_is_finished_first(tmp_path: Path) -> None:
    ran = interrupted(
        "import os, pathlib, signal, time\n"
        "import numpy as np\n"
        "from gpusim.files import hdf5_file\n"
        "hdf5_file.memoryview = lambda data: [os.kill(os.getpid(), signal.SIGINT),"
        " memoryview(data)][1]\n"
        "try:\n"
        "    with hdf5_file.writing_hdf5(pathlib.Path('a.h5')) as file:\n"
        "        file['a'] = np.arange(100_000)\n"
        "        file.flush()\n"
        "    time.sleep(30)\n"
        "except KeyboardInterrupt:\n"
        "    print('interrupted')\n",
        tmp_path,
    )
    assert (ran.stdout.split(), ran.stderr) == (["interrupted"], "")
