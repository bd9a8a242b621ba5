"""The same work for several items in copies of this process, which share all it holds.

Python lets one thread of a process run at a time, and lines of work that are made of many short
array operations spend more time on waiting for each other than two processors gain. A copy of the
process (``os.fork``) has what was set up, without sending it, in a few milliseconds.

A copy has none of the other threads: no device may be used in it, no pool of theirs, and nothing
may wait for a lock. Arithmetic on arrays is what it is for. It answers through a file in memory
and ends at once, without handlers of signals or at exit, and without collecting garbage that may
belong to the device.
"""

from __future__ import annotations

import ctypes
import gc
import os
import pickle
import signal
import sys
import threading
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from functools import partial
from typing import Any, TypeVar

from gpusim.parallel.cpu_budget import limited, processors

__all__ = ["in_copies"]

R = TypeVar("R")

# of each item: what was found, or the error
_Found = dict[int, tuple[Any, Exception | None]]

_END_WITH_PARENT = 1  # PR_SET_PDEATHSIG
_copying = threading.Lock()


def in_copies(work: Callable[[int], R], count: int) -> list[R]:
    """``work(0)``, …, ``work(count - 1)``, shared out to this process and copies of it.

    Results must be such as can be pickled. An error is raised here, that of the first item that
    has one. Where there is one processor, or no way of copying, all is done here, one item after
    the other; so is what a copy can't tell, or leaves undone because it was ended from outside.
    """
    ways = min(processors(), count)
    if ways < 2 or not _can_be_copied():
        return [work(item) for item in range(count)]
    shares = [range(first, count, ways) for first in range(ways)]
    threads = processors() // ways
    copies: list[_Copy] = []
    try:
        with _undisturbed(), suppress(OSError):  # no room for another: its share is done here
            for share in shares[1:]:
                copies.append(_Copy(work, share, threads))
        with limited(threads):
            found = _do(work, shares[0])
        for copy in copies:
            found.update(copy.answer())
    finally:
        with _undisturbed():
            for copy in copies:
                copy.end()
    results = []
    for item in range(count):
        result, error = found[item] if item in found else (work(item), None)
        if error is not None:
            raise error
        results.append(result)
    return results


def _do(work: Callable[[int], Any], share: Sequence[int]) -> _Found:
    """As far as the first error."""
    found: _Found = {}
    for item in share:
        try:
            found[item] = work(item), None
        except Exception as error:
            found[item] = None, error
            break
    return found


def _can_be_copied() -> bool:
    """Whether there is a way, and no other thread at work here, whose processor isn't free.

    OpenBLAS, moreover, ends its threads before a fork, and waits for them forever if they are
    multiplying for another thread.
    """
    if sys.platform != "linux" or not hasattr(os, "memfd_create"):
        return False
    me = str(threading.get_native_id())
    try:
        for thread in os.listdir("/proc/self/task"):
            with open(f"/proc/self/task/{thread}/stat", "rb") as file:
                if thread != me and file.read().rpartition(b") ")[2].startswith(b"R"):
                    return False
    except OSError:
        return False
    return True


@contextmanager
def _undisturbed() -> Iterator[None]:
    """No signal is handled, no garbage collected and no warning raised while copies are made or
    ended, nor in them; the handlers run afterwards."""
    heard: list[Callable[[], Any]] = []

    def hear(handler: Callable[..., Any], number: int, frame: Any) -> None:
        heard.append(partial(handler, number, frame))

    with _copying, ExitStack() as stack:
        stack.callback(gc.enable if gc.isenabled() else gc.disable)
        gc.disable()
        if threading.current_thread() is threading.main_thread():
            # that a signal is blocked here wouldn't do: another thread may get it for this one
            for number in signal.valid_signals():
                handler = signal.getsignal(number)
                if callable(handler):
                    stack.callback(signal.signal, number, handler)
                    signal.signal(number, partial(hear, handler))
        before = signal.pthread_sigmask(signal.SIG_BLOCK, signal.valid_signals())
        stack.callback(signal.pthread_sigmask, signal.SIG_SETMASK, before)
        stack.enter_context(warnings.catch_warnings())
        # that other threads' locks stay locked in a copy is known: see above
        warnings.simplefilter("ignore", DeprecationWarning)
        yield
    for handle in heard:
        handle()


class _Copy:
    """A process that does a share of the work, and the file in which it answers."""

    def __init__(self, work: Callable[[int], Any], share: Sequence[int], threads: int) -> None:
        control, parent = ctypes.CDLL(None).prctl, os.getpid()
        self._answer = os.memfd_create("gpusim-copy")
        try:
            self._process: int | None = os.fork()
        except OSError:
            os.close(self._answer)
            raise
        if not self._process:
            try:
                control(_END_WITH_PARENT, signal.SIGKILL)
                if os.getppid() == parent:
                    self._serve(work, share, threads)
            finally:
                os._exit(0)

    def _serve(self, work: Callable[[int], Any], share: Sequence[int], threads: int) -> None:
        """The life of a copy."""
        with limited(threads):
            found = _do(work, share)
        with open(self._answer, "wb", closefd=False) as file:
            pickle.dump(found, file, protocol=pickle.HIGHEST_PROTOCOL)

    def answer(self) -> _Found:
        """What it has found, or nothing if it didn't come to the end or can't tell."""
        self._wait()
        os.lseek(self._answer, 0, os.SEEK_SET)
        with suppress(Exception), open(self._answer, "rb", closefd=False) as file:
            found: _Found = pickle.load(file)
            return found
        return {}

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
