"""Calls of native libraries that may die, hang or take all memory on a damaged file.

Such a call is made by an interpreter of its own, which gets the call through a pipe and returns
the result through another. What happens to it is one error that names the file; this process, its
device and its other work go on. It is no sandbox: it protects from accidents, not from a file that
was made to take over the library.

A `concurrent.futures.ProcessPoolExecutor` that spawns would run the caller's script again in the
child; one that forks would copy a process that has threads and holds a device.
"""

from __future__ import annotations

import os
import pickle
import re
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable
from contextlib import suppress
from threading import Thread, Timer
from typing import IO, Any, ParamSpec, TypeVar

from gpusim.errors import GpusimError, InputError
from gpusim.parallel.main_memory import memory_limit

__all__ = ["SECONDS", "call_in_child"]

P = ParamSpec("P")
R = TypeVar("R")

SECONDS = 600.0
"""Time limit unless the caller says another."""
_ENTRY = (
    "import pickle, sys; sys.path[:] = pickle.load(sys.stdin.buffer); "
    "from gpusim.parallel.child_process import serve; serve()"
)


def call_in_child(
    what: str, seconds: float, function: Callable[P, R], *args: P.args, **options: P.kwargs
) -> R:
    """Call a function of this package in a process of its own and return what it returns.

    Parameters
    ----------
    what : the file and what is done with it, which the messages begin with.
    seconds : time limit.
    function, args, options : the call; all, and the result, can be pickled.

    Raises
    ------
    InputError
        Naming ``what``: the child was ended by a signal, the time limit or the memory limit (80 %
        of the machine's memory); with its last words.
    Exception
        Those of gpusim that the function raises, as they are. Others become an InputError.

    An interrupt (Ctrl-C) ends the child, and so does the end of this process.
    """
    if not sys.executable or hasattr(sys, "frozen"):  # a program that is no interpreter
        return function(*args, **options)
    message = _pickled(sys.path) + _pickled((function, args, options))
    threads = dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"), "1")
    with tempfile.TemporaryFile() as words:
        child = subprocess.Popen(
            [sys.executable, "-P", "-c", _ENTRY],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=words,
            env={**os.environ, **threads},
        )  # fmt: skip
        late = Timer(seconds, child.kill)
        late.daemon = True
        late.start()
        try:
            assert child.stdin is not None and child.stdout is not None
            with suppress(OSError):  # it is gone: its status tells
                child.stdin.write(message)
                child.stdin.flush()
            answer = child.stdout.read()  # stdin stays open: the child ends when this process does
            child.wait()
        finally:
            timely = late.is_alive()
            late.cancel()
            child.kill()
            child.wait()
            for pipe in (child.stdin, child.stdout):
                with suppress(OSError):
                    pipe.close()  # type: ignore[union-attr]
        if child.returncode == 0 and answer:
            fine, result = pickle.loads(answer)
            if fine:
                return result  # type: ignore[no-any-return]
            raise result if isinstance(result, GpusimError) else InputError(f"{what}: {result}")
        how = (
            _ending(child.returncode)
            if timely
            else f"was not done after {seconds:g} s, its time limit"
        )
        raise InputError(f"{what}: the process that does this {how}{_last(words)}")


def _ending(code: int) -> str:
    if code > 0:
        return f"ended with status {code}"
    try:
        return f"died ({signal.Signals(-code).name}): the file is damaged, or too large"
    except ValueError:
        return f"died (signal {-code})"


def _last(words: IO[bytes]) -> str:
    words.seek(max(0, words.seek(0, os.SEEK_END) - 300))
    text = re.sub(r"\x1b\[[\d;]*m", "", words.read().decode("utf-8", "replace"))  # colours
    text = " ".join(text.split())
    return f"; got {text[-200:]!r}" if text else ""


def _pickled(what: Any) -> bytes:
    return pickle.dumps(what, protocol=pickle.HIGHEST_PROTOCOL)


def serve() -> None:
    """What the child does."""
    questions, answers = sys.stdin.buffer, os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what a library prints must not get into the answer
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the caller ends it
    _limit_memory()
    try:
        function, args, options = pickle.load(questions)
        Thread(target=_end_with_caller, args=(questions,), daemon=True).start()
        answer = _pickled((True, function(*args, **options)))
    except GpusimError as error:
        answer = _pickled((False, error))
    except MemoryError:
        answer = _pickled((False, "takes more than the memory that it may have"))
    except Exception as error:
        answer = _pickled((False, f"damaged, or not what it should be; got {_said(error)}"))
    answers.write(answer)
    answers.flush()
    os._exit(0)  # a damaged library must not spoil the answer when it is taken down


def _said(error: Exception) -> str:
    return f"{type(error).__name__}: {' '.join(str(error).split())[:200]}"


def _end_with_caller(questions: IO[bytes]) -> None:
    while os.read(questions.fileno(), 1):
        pass
    os._exit(1)


def _limit_memory() -> None:
    try:
        import resource
    except ImportError:  # Windows
        return
    most = memory_limit()
    hard = resource.getrlimit(resource.RLIMIT_AS)[1]
    if hard != resource.RLIM_INFINITY:
        most = min(most, hard)
    with suppress(ValueError, OSError):
        resource.setrlimit(resource.RLIMIT_AS, (most, hard))
