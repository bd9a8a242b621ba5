"""Calls in processes of their own, beside the one that keeps the device busy.

Python lets one thread of a process run at a time: drawing a page in a thread takes from the device
what it is waiting for. A helper is a bare interpreter that is given functions and what to call them
with; it imports what it needs while the caller goes on. It holds nothing that has to be kept, and
ends with the caller.
"""

from __future__ import annotations

import atexit
import os
import pickle
import subprocess
import sys
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from importlib import import_module
from queue import SimpleQueue
from threading import Lock, Thread
from typing import TYPE_CHECKING, Any, ParamSpec, TypeVar

if TYPE_CHECKING:
    _Process = subprocess.Popen[bytes]

__all__ = ["begin", "prepare", "serve"]

P = ParamSpec("P")
R = TypeVar("R")

MOST = 2
"""Helpers; a core that only draws isn't worth more."""
_ENTRY = (
    "import signal, pickle, sys; signal.signal(signal.SIGINT, signal.SIG_IGN); "
    "sys.path[:] = pickle.load(sys.stdin.buffer); "
    "from gpusim.apart import serve; serve()"
)

_lock = Lock()
_team: _Team | None = None


def prepare(*modules: str) -> None:
    """Start the helpers, unless they are there or there is one core, and let them import modules.

    Without helpers `begin` calls a function where it is.
    """
    global _team
    with _lock:
        if _team is None and _cores() > 1 and sys.executable and not hasattr(sys, "frozen"):
            try:
                _team = _Team(min(MOST, _cores()), modules)
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


class _Team:
    """Helpers, and a thread each that waits for what one of them does."""

    def __init__(self, count: int, modules: tuple[str, ...]) -> None:
        self.idle: SimpleQueue[_Process] = SimpleQueue()
        self.pool = ThreadPoolExecutor(count, thread_name_prefix="gpusim.apart")
        self.all: list[_Process] = []
        atexit.register(self.end)
        self._start()
        Thread(target=self._join, args=(count, modules), daemon=True).start()

    def _start(self) -> None:
        process = subprocess.Popen(
            [sys.executable, "-P", "-c", _ENTRY], stdin=subprocess.PIPE, stdout=subprocess.PIPE
        )
        self.all.append(process)

    def _join(self, count: int, modules: tuple[str, ...]) -> None:
        """Let one after the other begin: together they would hold up the caller's own start."""
        for number in range(count):
            if number:
                try:
                    self._start()
                except OSError:
                    return
            process = self.all[number]
            try:
                _tell(process, _pickled(sys.path) + _pickled(modules))
                assert process.stdout is not None
                pickle.load(process.stdout)
            except (OSError, EOFError, pickle.PickleError):
                process.kill()  # `call` will notice
            self.idle.put(process)

    def call(self, function: Callable[..., Any], args: Any, options: Any) -> Any:
        """What a helper's call of ``function`` returns."""
        try:
            message = _pickled((function, args, options))
        except (pickle.PickleError, AttributeError, TypeError):  # a function without a name
            return function(*args, **options)
        process = self.idle.get()
        try:
            _tell(process, message)
            assert process.stdout is not None
            fine, result = pickle.load(process.stdout)
        except (OSError, EOFError, pickle.PickleError, AttributeError, TypeError):
            process.kill()  # it is gone, or in the middle of an answer
            fine = False
        self.idle.put(process)
        return result if fine else function(*args, **options)

    def end(self) -> None:
        for process in self.all:
            process.kill()
            process.wait()


def _pickled(what: Any) -> bytes:
    return pickle.dumps(what, protocol=pickle.HIGHEST_PROTOCOL)


def _tell(process: _Process, message: bytes) -> None:
    assert process.stdin is not None
    process.stdin.write(message)
    process.stdin.flush()


def _cores() -> int:
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def serve() -> None:
    """What a helper does until its caller is gone."""
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what a library prints must not get between the answers
    for module in pickle.load(sys.stdin.buffer):
        import_module(module)
    answers.write(_pickled("ready"))
    answers.flush()
    while True:
        try:
            function, args, options = pickle.load(sys.stdin.buffer)
        except EOFError:
            os._exit(0)
        try:
            answer = _pickled((True, function(*args, **options)))
        except Exception:  # the caller meets it, too
            answer = _pickled((False, None))
        answers.write(answer)
        answers.flush()
