"""Signals at any moment: the exit code says so, no traceback, and the next run makes the rest.

Ctrl-C is told apart from other errors (130); a run that is ended otherwise dies of the signal, as
programs do, which a shell shows as 143 or 129. SIGPIPE comes of a reader that is gone.
"""

from __future__ import annotations

import random
import signal
import subprocess
import time
from pathlib import Path

import pytest

from tests.hostile.amount import SEED, share
from tests.hostile.tiny_runs import LIMIT, Begun, command, results, stored, write_scene, wrong

pytestmark = pytest.mark.hostile

CODES = {
    signal.SIGINT: (0, 130),
    signal.SIGTERM: (0, -signal.SIGTERM),
    signal.SIGHUP: (0, -signal.SIGHUP),
    signal.SIGPIPE: (0,),
}


def until_imported(process: subprocess.Popen[bytes], log: Path) -> None:
    """Before that it is Python that answers signals, not the program."""
    while process.poll() is None and b"_multiarray_umath" not in (
        Path(f"/proc/{process.pid}/maps").read_bytes()
    ):
        time.sleep(0.01)


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, float]:
    """A folder with the scene and ``first``, what it gives; and how long that took."""
    folder = tmp_path_factory.mktemp("undisturbed")
    scene = write_scene(folder)
    began = time.monotonic()
    first = Begun(folder / "log", "run", scene, "-o", folder / "first", "--backend", "numpy")
    assert first.end() == 0, first.said
    return folder, time.monotonic() - began


@pytest.mark.parametrize("which", CODES)
def test_signals(which: signal.Signals, undisturbed: tuple[Path, float], tmp_path: Path) -> None:
    folder, whole = undisturbed
    scene, log = folder / "bar.toml", tmp_path / "log"
    expected = results(folder / "first")
    chance = random.Random(f"{SEED} {which.name}")
    for number in range(share(15)):
        told = f"SEED={SEED}, {which.name} {number}"
        words = ("run", scene, "-o", tmp_path / str(number), "--backend", "numpy")
        if number % 3 == 0:
            with log.open("wb") as stream:
                process = command(*words, stdout=stream)
                until_imported(process, log)
                time.sleep(chance.uniform(0.0, 1.5 * whole))
                process.send_signal(which)
                code = process.wait(LIMIT)
            said = log.read_text()
        else:
            begun = Begun(log, *words)
            begun.wait()
            time.sleep(chance.uniform(0.0, whole))
            begun.send(which)
            code, said = begun.end(), begun.said
        assert wrong(code, said, CODES[which]) == "", told
        last = Begun(log, *words)
        assert wrong(last.end(), last.said, (0,)) == "", told
        assert results(tmp_path / str(number)) == expected, told
        assert stored(tmp_path / str(number)) == stored(folder / "first"), told


def test_a_reader_that_is_gone(tmp_path: Path) -> None:
    """`gpusim run | head -1`, with nothing said of it."""
    scene = write_scene(tmp_path)
    process = command("run", scene, "-o", tmp_path / "out", "--backend", "numpy",
                      stderr=subprocess.PIPE)  # fmt: skip
    assert process.stdout is not None and process.stderr is not None
    process.stdout.close()
    said = process.stderr.read().decode()
    process.stderr.close()
    assert wrong(process.wait(LIMIT), said, (0, 1)) == ""
    assert said == ""
