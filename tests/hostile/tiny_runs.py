"""A scene whose run takes tenths of a second, and runs of it in processes that may be killed.

The processes of `Begun` are divided from one that has imported everything (`multiprocessing`'s fork
server) and work on one processor, without helpers; `command` is the user's own.
"""

from __future__ import annotations

import hashlib
import multiprocessing
import os
import pkgutil
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from multiprocessing.context import ForkServerProcess
from pathlib import Path
from typing import Any

import gpusim
import gpusim.fem
import gpusim.measure
import gpusim.pipeline
import gpusim.report
from gpusim.graph.folder import INNER
from gpusim.mesh import box
from gpusim.parallel.machine import limited

__all__ = ["LIMIT", "Begun", "command", "files", "results", "stored", "write_scene",
           "wrong"]  # fmt: skip

LIMIT = 60.0
"""Seconds after which something hangs."""

SCENE = """schema = 1
name = "bar"

[[material]]
name = "steel"
youngs_modulus_GPa = 70.0
poissons_ratio = 0.33
density_kg_m3 = 2700.0

[[body]]
name = "bar"
material = "steel"
mesh = { file = "bar.inp", unit = "mm" }
support = [{ name = "clamp", where = { x_max_mm = 0.0 }, fix = ["x", "y", "z"] }]
load = [{ name = "push", type = "force", where = { x_min_mm = 60.0 }, force_N = [0, 0, -900] }]

[[body.paint]]
name = "grey"
type = "plain"
albedo = 0.4

[[body.paint]]
name = "side"
type = "markers"
where = { normal = "-y" }
albedo = 0.4
size_mm = 8.0
line = { start_mm = [12.0, 0.0, 5.0], end_mm = [48.0, 0.0, 5.0], count = 2 }

[[camera]]
name = "side"
sensor_mm = [6.4, 3.2]
resolution_px = [96, 48]
focal_mm = 30.0
position_mm = [30.0, -300.0, 5.0]
target_mm = [30.0, 0.0, 5.0]

[[measure]]
name = "tip"
type = "deflection"
camera = "side"
groups = ["side"]
direction = "-z"

[output]
truth = ["depth"]
"""

FILM = """
[analysis]
type = "transient"
duration_s = 0.007

[video]
frame_rate_Hz = 1000.0
format = "{format}"
"""
"""What makes a film of the scene."""

_TIMED = ("report.html", "report.json")
_context = multiprocessing.get_context("forkserver")
_packages = (gpusim, gpusim.fem, gpusim.measure, gpusim.pipeline, gpusim.report)
_context.set_forkserver_preload(
    ["gpusim.cli", "tests.hostile.tiny_runs"]
    + [module.name for one in _packages
       for module in pkgutil.walk_packages(one.__path__, f"{one.__name__}.")
       if not module.name.endswith("__main__")]
)  # fmt: skip


def write_scene(folder: Path, height_mm: float = 10.0, film: str = "") -> Path:
    """The scene's file, and the mesh that it names; ``film``: the format of one of its motion,
    of which nothing is measured."""
    bar = box((60.0, 20.0, height_mm), (4, 2, 1))
    nodes = [f"{number}, {x}, {y}, {z}" for number, (x, y, z) in enumerate(bar.points, 1)]
    bricks = [f"{number}, " + ", ".join(map(str, cell + 1))
              for number, cell in enumerate(bar.cells["hex8"], 1)]  # fmt: skip
    lines = ["*NODE", *nodes, "*ELEMENT, TYPE=C3D8", *bricks, ""]
    (folder / "bar.inp").write_text("\n".join(lines), encoding="utf-8")
    scene = folder / "bar.toml"
    text = SCENE.partition("[[measure]]")[0] + FILM.format(format=film) if film else SCENE
    scene.write_text(text, encoding="utf-8")
    return scene


def files(folder: Path) -> dict[str, str]:
    """What lies below a folder: hashes of files, targets of links, kinds of all else."""
    found = {}
    for path in sorted(folder.rglob("*")):
        name = path.relative_to(folder).as_posix()
        if path.is_symlink():
            found[name] = f"link to {os.readlink(path)}"
        elif path.is_file():
            found[name] = hashlib.sha256(path.read_bytes()).hexdigest()
        else:
            found[name] = "folder" if path.is_dir() else "device or pipe"
    return found


def results(out: Path) -> dict[str, str]:
    """`files` of an output folder that a run promises to be the same: reports hold timings, and
    the store's logs the order of work."""
    return {
        name: what for name, what in files(out).items()
        if name not in _TIMED and name.split("/")[0] != INNER
    }  # fmt: skip


def stored(out: Path) -> list[str]:
    """The names in an output folder's store, of logs put together without what is random; blobs
    have to hold what their names say."""
    names = []
    for name, what in files(out / INNER).items():
        if name == "programs.json":  # of the pictures that the last runs have drawn
            continue
        if name.startswith("blobs/") and what != "folder":
            assert name.rsplit("/", 1)[-1] == what, name
        names.append(re.sub(r"^log/0-[0-9a-f]+\.log$", "log/0.log", name))
    return names


def _run(arguments: list[str], log: str, before: Callable[[], None] | None) -> None:
    """What a process of `Begun` does."""
    from gpusim.cli import main

    sys.argv = ["gpusim", *arguments]
    if before is not None:
        before()
    with open(log, "wb") as stream:
        os.dup2(stream.fileno(), 1)
        os.dup2(stream.fileno(), 2)
    try:
        with limited(1):
            code = main()
    finally:
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # multiprocessing answers with a traceback
    sys.exit(code)


class Begun:
    """A command that has begun in a process of its own, and what it has said so far.

    ``before`` is called there first: it may limit what the process gets.
    """

    def __init__(
        self, log: Path, *arguments: object, before: Callable[[], None] | None = None
    ) -> None:
        log.unlink(missing_ok=True)
        self.log = log
        self.process: ForkServerProcess = _context.Process(
            target=_run, args=([str(one) for one in arguments], str(log), before)
        )
        self.process.start()

    @property
    def said(self) -> str:
        return self.log.read_text(errors="replace") if self.log.exists() else ""

    def wait(self) -> None:
        """Until it answers signals."""
        while self.process.is_alive() and not self.log.exists():
            time.sleep(0.002)

    def send(self, which: signal.Signals) -> None:
        if self.process.is_alive() and self.process.pid is not None:
            os.kill(self.process.pid, which)

    def end(self) -> int:
        """Its exit code; fails if it hangs."""
        self.process.join(LIMIT)
        if self.process.exitcode is None:
            self.process.kill()
            self.process.join()
            raise AssertionError(f"hangs for {LIMIT:g} s: {self.said}")
        return self.process.exitcode


def command(*arguments: object, **options: Any) -> subprocess.Popen[bytes]:
    """`gpusim` as a user starts it, its outputs together in one pipe."""
    words = [sys.executable, "-m", "gpusim", *map(str, arguments)]
    return subprocess.Popen(words, **{"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT,
                                      **options})  # fmt: skip


def wrong(code: int, said: str, good: tuple[int, ...] = (0, 2)) -> str:
    """Why a command's end isn't one that a user should see, or ""."""
    if re.search(r"Traceback|internal error|most recent call", said):
        return f"exit code {code} with {said[-2000:]}"
    return "" if code in good else f"exit code {code}; expected {good}; {said[-2000:]}"
