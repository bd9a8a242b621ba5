"""Studies whose processes may be killed, and what they have recorded meanwhile.

`Local` and `Cluster` are who makes the samples: two processes of the client, or two workers of a
Dask scheduler. All end with the process that began them.
"""

from __future__ import annotations

import os
import random
import socket
import subprocess
import sys
import time
from collections.abc import Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any, Protocol

from gpusim.graph.folder import INNER
from gpusim.graph.log import read_log
from gpusim.parallel.processes import end_with
from tests.hostile.tiny_runs import LIMIT, Begun

__all__ = ["Cluster", "Local", "Makers", "Recorded"]


class Recorded:
    """The results that a study's processes have recorded in the store of ``out``, each time one
    was: logs that are put together with others are kept here, by links."""

    def __init__(self, out: Path, links: Path) -> None:
        self._logs, self._links = out / INNER / "log", links
        self._read_to: dict[Path, int] = {}
        self.lines: list[dict[str, Any]] = []
        links.mkdir()

    def look(self) -> int:
        """How many there are by now."""
        for path in self._logs.glob("[1-9]*.log"):  # those put together begin with 0
            link = self._links / path.name
            if link not in self._read_to:
                with suppress(FileNotFoundError):
                    os.link(path, link)
                    self._read_to[link] = 0
        for link, start in self._read_to.items():
            lines, self._read_to[link] = read_log(link, start)
            self.lines += [line for line in lines if "key" in line]
        return len(self.lines)


class Makers(Protocol):
    """``options`` of a client that has samples made, and ``kinds`` of processes that may die."""

    options: Sequence[object]
    kinds: Sequence[str]

    def kill(self, kind: str, client: Begun, chance: random.Random) -> bool:
        """Kill a process of a kind, if there is one, and start it anew where nobody else does."""

    def close(self) -> None:
        """Leave no process behind."""


class Local:
    """Two processes of the client, which starts them anew."""

    options = "--workers", 2
    kinds = "worker", "client"

    def __init__(self) -> None:
        self._seen: set[int] = set()

    def kill(self, kind: str, client: Begun, chance: random.Random) -> bool:
        """Of the client, or of one of its workers."""
        if (pid := client.process.pid) is None or not client.process.is_alive():
            return False
        workers = _workers(pid)
        self._seen |= workers
        if kind == "client":
            client.process.kill()
            client.process.join()
        elif workers:
            with suppress(ProcessLookupError):
                os.kill(chance.choice(sorted(workers)), 9)
        return kind == "client" or bool(workers)

    def close(self) -> None:
        """Workers end by themselves when their client has."""
        end = time.monotonic() + LIMIT
        while left := {pid for pid in self._seen if _is_worker(pid)}:
            assert time.monotonic() < end, f"workers without a client: {left}"
            time.sleep(0.01)


class Cluster:
    """A scheduler and two workers in ``folder``, started anew here."""

    kinds = "worker", "scheduler", "client"

    def __init__(self, folder: Path) -> None:
        folder.mkdir()
        self._folder, self._file = folder, folder / "scheduler.json"
        with socket.create_server(("127.0.0.1", 0)) as server:
            self._port = server.getsockname()[1]
        self.options: Sequence[object] = "--scheduler", self._file
        self._begun: list[subprocess.Popen[bytes]] = []
        self._start_all()

    def kill(self, kind: str, client: Begun, chance: random.Random) -> bool:
        """Of the client, a worker, or the scheduler; its workers die with it, or later."""
        if kind == "client":
            alive = client.process.is_alive()
            client.process.kill()
            client.process.join()
            return alive
        if kind == "worker":
            number = chance.randrange(2)
            self._end(self._workers[number])
            self._workers[number] = self._worker()
            return True
        self._end(self._scheduler)
        if chance.random() < 0.5:
            for worker in self._workers:
                self._end(worker)
        self._start_all()
        return True

    def close(self) -> None:
        """End all of it."""
        for process in self._begun:
            self._end(process)

    def _start_all(self) -> None:
        self._file.unlink(missing_ok=True)
        self._scheduler = self._start(
            "scheduler", "--host", "127.0.0.1", "--port", self._port, "--no-dashboard",
            "--scheduler-file", self._file,
        )  # fmt: skip
        end = time.monotonic() + LIMIT
        while not self._file.exists():
            assert time.monotonic() < end, (self._folder / "log").read_text()
            assert self._scheduler.poll() is None, (self._folder / "log").read_text()
            time.sleep(0.01)
        self._workers = [self._worker(), self._worker()]

    def _worker(self) -> subprocess.Popen[bytes]:
        return self._start(
            "worker", f"tcp://127.0.0.1:{self._port}", "--nthreads", 1, "--no-nanny",
            "--no-dashboard", "--local-directory", self._folder,
        )  # fmt: skip

    def _start(self, name: str, *arguments: object) -> subprocess.Popen[bytes]:
        words = [sys.executable, "-m", f"distributed.cli.dask_{name}", *map(str, arguments)]
        with (self._folder / "log").open("ab") as log:
            process = subprocess.Popen(
                words, stdout=log, stderr=log, preexec_fn=partial(end_with, os.getpid())
            )
        self._begun.append(process)
        return process

    @staticmethod
    def _end(process: subprocess.Popen[bytes]) -> None:
        process.kill()
        process.wait(LIMIT)


def _workers(client: int) -> set[int]:
    """Processes that a client has begun to make samples in."""
    children: list[str] = []
    for path in Path(f"/proc/{client}/task").glob("*/children"):
        with suppress(OSError):
            children += path.read_text().split()
    return {pid for pid in map(int, children) if _is_worker(pid)}


def _is_worker(pid: int) -> bool:
    try:
        return b"popen_loky_posix" in Path(f"/proc/{pid}/cmdline").read_bytes()
    except OSError:
        return False
