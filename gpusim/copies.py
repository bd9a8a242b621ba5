"""The same work for several items in copies of this process, which share all it holds.

Python lets one thread of a process run at a time, and lines of work that are made of many short
array operations spend more time on waiting for each other than two processors gain. A copy of the
process (``os.fork``) has what was set up, without sending it, in a few milliseconds.

A copy has no other threads: no device may be used in it, no pool, and nothing may wait for a lock.
Arithmetic on arrays is what it is for. It answers through a file in memory and ends at once,
without handlers at exit, and without collecting garbage that may belong to the device.
"""

from __future__ import annotations

import gc
import os
import pickle
import signal
import sys
import warnings
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import Any, TypeVar

from gpusim.interrupts import interrupts_held
from gpusim.processors import limited, processors

__all__ = ["in_copies"]

R = TypeVar("R")


def in_copies(work: Callable[[int], R], count: int) -> list[R]:
    """``work(0)``, …, ``work(count - 1)``, shared out to this process and copies of it.

    Results must be such as can be pickled. An error is raised here, that of the first item that
    has one. Where there is one processor, or no way of copying, all is done here, one item after
    the other; so is what a copy leaves undone whose process was ended from outside.
    """
    ways = min(processors(), count)
    if ways < 2 or sys.platform != "linux" or not hasattr(os, "memfd_create"):
        return [work(item) for item in range(count)]
    shares = [range(first, count, ways) for first in range(ways)]
    results: dict[int, R] = {}
    copies: list[_Copy] = []
    try:
        with suppress(OSError):  # no room for another process: its share is done here
            for share in shares[1:]:
                copies.append(_Copy(work, share))
        with limited(max(1, processors() // ways)):
            results.update((item, work(item)) for item in shares[0])
        for copy in copies:
            results.update(copy.results())
    finally:
        for copy in copies:
            copy.end()
    return [results[item] if item in results else work(item) for item in range(count)]


class _Copy:
    """A process that does a share of the work, and the file in which it answers."""

    def __init__(self, work: Callable[[int], Any], share: Sequence[int]) -> None:
        self._answer = os.memfd_create("gpusim-copy")
        self._share = share
        try:
            with interrupts_held(), warnings.catch_warnings():
                # that other threads' locks stay locked in a copy is known: see above
                warnings.simplefilter("ignore", DeprecationWarning)
                self._process: int | None = os.fork()
                if not self._process:
                    _serve(work, share, self._answer)
        except OSError:
            os.close(self._answer)
            raise

    def results(self) -> dict[int, Any]:
        """What it has found, as far as it came; raises the error that it ended with."""
        self._wait()
        os.lseek(self._answer, 0, os.SEEK_SET)
        with open(self._answer, "rb", closefd=False) as file:
            try:
                found, error = pickle.load(file)
            except (EOFError, pickle.UnpicklingError):  # it didn't come to the end
                return {}
        if error is not None:
            raise error
        return dict(zip(self._share, found, strict=True))

    def end(self) -> None:
        """Whether or not it is still at work."""
        if self._process:
            with suppress(ProcessLookupError):
                os.kill(self._process, signal.SIGKILL)
            self._wait()
        os.close(self._answer)

    def _wait(self) -> None:
        assert self._process
        # a program that ignores the ends of its processes (SIGCHLD) has none left to ask for
        with suppress(ChildProcessError):
            os.waitpid(self._process, 0)
        self._process = None


def _serve(work: Callable[[int], Any], share: Sequence[int], answer: int) -> None:
    """The life of a copy; doesn't return."""
    status = 1
    try:
        gc.disable()
        # the original hears of interrupts, and ends its copies
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
        found, error = [], None
        try:
            with limited(1):
                found = [work(item) for item in share]
        except Exception as problem:
            error = problem
        with open(answer, "wb", closefd=False) as file:
            pickle.dump((found, error), file, protocol=pickle.HIGHEST_PROTOCOL)
        status = 0
    finally:
        os._exit(status)
