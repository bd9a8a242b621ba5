"""Calls in processes of their own, beside the one that keeps the device busy.

Python lets one thread of a process run at a time: drawing a page in a thread takes from the device
what it is waiting for. A helper is a bare interpreter that is given functions and what to call them
with; it imports what it needs while the caller goes on. It holds nothing that has to be kept, and
ends with the caller.

A `concurrent.futures.ProcessPoolExecutor` does as much for a caller that is written for it. One
that spawns its processes runs the caller's script in each of them, which without a
``if __name__ == "__main__"`` begins the whole run anew and ends in an error; one that forks copies
a process whose driver has threads and holds a device.
"""

from __future__ import annotations

import atexit
import os
import pickle
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from importlib import import_module
from queue import SimpleQueue
from threading import Lock, Thread
from typing import Any, BinaryIO, ParamSpec, TypeVar, cast

from gpusim.parallel.cpu_budget import processors

__all__ = ["begin", "prepare", "serve"]

P = ParamSpec("P")
R = TypeVar("R")

MOST = 2
"""Helpers; a core that only draws isn't worth more."""
_GRACE = 5.0  # seconds at most for helpers with nothing to do to end by themselves
_ENTRY = """
import signal, os, pickle, sys
signal.signal(signal.SIGINT, signal.SIG_IGN)
try:
    sys.path[:] = pickle.load(sys.stdin.buffer)
except EOFError:  # the caller is gone already
    os._exit(0)
from gpusim.parallel.helper_processes import serve
serve()
"""

_lock = Lock()
_team: _Team | None = None


def prepare(*modules: str) -> None:
    """Start the helpers, unless they are there or there is one core, and let them import modules.

    Without helpers `begin` calls a function where it is.
    """
    global _team
    with _lock:
        if _team is None and processors() > 1 and sys.executable and not hasattr(sys, "frozen"):
            try:
                _team = _Team(min(MOST, processors()), modules)
            except OSError:  # no room for another process
                return


def begin(function: Callable[P, R], *args: P.args, **options: P.kwargs) -> Future[R]:
    """Begin with a call whose function, arguments and result can be pickled.

    A call that fails in a helper, or whose helper is gone, is made once more here, so that an
    error comes from the place that it belongs to. It may therefore happen twice.
    """
    if _team is not None:
        return _team.pool.submit(_team.call, function, args, options)
    done: Future[R] = Future()
    try:
        done.set_result(function(*args, **options))
    except Exception as error:
        done.set_exception(error)
    return done


@dataclass(frozen=True)
class _Helper:
    """Where a helper hears what to do, and where it answers."""

    ear: BinaryIO
    mouth: BinaryIO

    def tell(self, what: bytes) -> None:
        self.ear.write(what)
        self.ear.flush()

    def close(self) -> None:
        with suppress(OSError):
            self.ear.close()

    def forget(self) -> None:
        """Let go of this process's copy, without what was to be told."""
        nothing = os.open(os.devnull, os.O_RDWR)
        for end in (self.ear, self.mouth):
            with suppress(ValueError):  # closed already
                os.dup2(nothing, end.fileno(), inheritable=False)
        os.close(nothing)


class _Team:
    """Helpers, and a thread each that waits for what one of them does.

    One process imports modules, then divides where the system can do that well: it has no threads.
    """

    def __init__(self, count: int, modules: tuple[str, ...]) -> None:
        twins = count - 1 if sys.platform == "linux" else 0
        self.idle: SimpleQueue[_Helper] = SimpleQueue()
        self.at_work: list[_Helper] = []
        self.pool = ThreadPoolExecutor(
            1 + twins, thread_name_prefix="gpusim.parallel.helper_processes"
        )
        # a backend for screens that isn't there is no reason not to draw files
        alone = {"OPENBLAS_NUM_THREADS": "1", "MPLBACKEND": "agg"}
        with _standard_streams() as error, _interrupts_held():
            pipes = [(os.pipe(), os.pipe()) for _ in range(twins)]
            theirs = [(hears, says) for (hears, _), (_, says) in pipes]
            self.process = subprocess.Popen(
                [sys.executable, "-P", "-c", _ENTRY], stdin=subprocess.PIPE,
                stdout=subprocess.PIPE, stderr=error, env={**os.environ, **alone},
                pass_fds=[end for both in theirs for end in both],
            )  # fmt: skip
        assert self.process.stdin is not None and self.process.stdout is not None
        self.all = [
            _Helper(cast(BinaryIO, self.process.stdin), cast(BinaryIO, self.process.stdout))
        ]
        for (hears, tells), (listens, says) in pipes:
            os.close(hears)
            os.close(says)
            self.all.append(_Helper(os.fdopen(tells, "wb"), os.fdopen(listens, "rb")))
        atexit.register(self.end)
        start = _pickled(sys.path) + _pickled((modules, theirs))
        Thread(target=self._join, args=(start,), daemon=True).start()

    def _join(self, start: bytes) -> None:
        for number, helper in enumerate(self.all):
            try:
                if number == 0:
                    helper.tell(start)
                pickle.load(helper.mouth)
            except (OSError, ValueError, EOFError, pickle.PickleError):
                helper.close()  # `call` will notice
            self.idle.put(helper)

    def call(self, function: Callable[..., Any], args: Any, options: Any) -> Any:
        """What a helper's call of ``function`` returns."""
        try:
            message = _pickled((_folder(), function, args, options))
        except (pickle.PickleError, AttributeError, TypeError):  # a function without a name
            return function(*args, **options)
        helper = self.idle.get()
        self.at_work.append(helper)
        try:
            helper.tell(message)
            fine, result = pickle.load(helper.mouth)
        except (OSError, ValueError, EOFError, pickle.PickleError, AttributeError, TypeError):
            helper.close()  # it is gone, or in the middle of an answer
            fine = False
        self.at_work.remove(helper)
        self.idle.put(helper)
        return result if fine else function(*args, **options)

    def end(self) -> None:
        # those that are still starting soon hear of it, too
        idle = not self.at_work
        for helper in self.all:  # who hears no more ends
            helper.close()
        if idle:
            with suppress(subprocess.TimeoutExpired):
                self.process.wait(_GRACE)
        self.process.kill()
        self.process.wait()


def _pickled(what: Any) -> bytes:
    return pickle.dumps(what, protocol=pickle.HIGHEST_PROTOCOL)


def _folder() -> str | None:
    """The working folder, which relative names belong to; None if it was deleted."""
    try:
        return os.getcwd()
    except OSError:
        return None


@contextmanager
def _standard_streams() -> Iterator[int | None]:
    """Stand-ins for standard streams that are closed: a pipe with one of their numbers would be
    taken for it. Gives where a helper's errors go, None for where the caller's go."""
    made = [os.open(os.devnull, os.O_RDWR)]
    try:
        while made[-1] <= 2:
            made.append(os.open(os.devnull, os.O_RDWR))
        yield subprocess.DEVNULL if 2 in made else None
    finally:
        for stand_in in made:
            os.close(stand_in)


@contextmanager
def _interrupts_held() -> Iterator[None]:
    """What begins here isn't interrupted before it can say that it ignores that: its caller ends
    it."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _forked() -> None:
    """In a copy of this process: its helpers, and the threads that wait for them, aren't there."""
    global _lock, _team
    _lock = Lock()
    if _team is not None:
        atexit.unregister(_team.end)
        for helper in _team.all:
            helper.forget()
    _team = None


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_forked)


def serve() -> None:
    """What a helper does until its caller is gone."""
    first = os.getpid()
    try:
        _serve()
    except (BrokenPipeError, EOFError):  # it went while we were starting, or answering
        if os.getpid() == first:
            with suppress(Exception):
                atexit._run_exitfuncs()
        os._exit(0)


def _serve() -> None:
    modules, twins = pickle.load(sys.stdin.buffer)
    for module in modules:
        import_module(module)
    twin = False
    for hears, says in twins:
        if os.fork() == 0:
            os.dup2(hears, 0)
            os.dup2(says, 1)
            twin = True
            break
    for hears, says in twins:
        os.close(hears)
        os.close(says)
    questions, answers = os.fdopen(os.dup(0), "rb"), os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what a library prints must not get between the answers
    answers.write(_pickled("ready"))
    answers.flush()
    while True:
        try:
            folder, function, args, options = pickle.load(questions)
        except EOFError:
            if not twin:
                atexit._run_exitfuncs()  # temporary folders are deleted, once
            os._exit(0)
        try:
            if folder is not None:
                os.chdir(folder)
            answer = _pickled((True, function(*args, **options)))
        except Exception:  # the caller meets it, too
            answer = _pickled((False, None))
        answers.write(answer)
        answers.flush()
