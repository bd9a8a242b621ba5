"""Work in other processes: guarded calls, and copies of this process.

- `call_in_child`: a call of a native library that may die, hang or take all memory on a damaged
  file, in an interpreter of its own. It protects from accidents; it is no sandbox.
- `in_copies`: the same work for several items in forked copies of this process, which have all
  that was set up without sending it, in a few milliseconds. Python lets one thread of a process
  run at a time, and work of many short array operations gains nothing from threads.
"""

from __future__ import annotations

import ctypes
import gc
import multiprocessing
import os
import pickle
import re
import signal
import subprocess
import sys
import threading
import time
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from importlib import import_module
from multiprocessing.connection import Connection
from typing import Any, ParamSpec, TypeVar

from gpusim.errors import GpusimError, InputError
from gpusim.parallel.machine import limited, memory_limit, processors

P = ParamSpec("P")
R = TypeVar("R")

CHILD_SECONDS = 600.0
"""Time limit of `call_in_child`, unless the caller says another."""
_ONE_BLAS_THREAD = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
_CHILD = (
    "import pickle, sys; sys.path[:] = pickle.load(sys.stdin.buffer); "
    "from gpusim.parallel.processes import serve; serve()"
)

_Found = dict[int, tuple[Any, Exception | None]]  # of each item: what was found, or the error


def end_with(parent: int) -> None:
    """This process, a child, ends when the thread that began it does; interrupts are its parent's.

    prctl(PR_SET_PDEATHSIG), Linux.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(1, signal.SIGKILL)
        if os.getppid() != parent:
            os._exit(1)


@contextmanager
def _interrupts_held() -> Iterator[None]:
    """What begins here isn't interrupted before it can say that it ignores that."""
    if not hasattr(signal, "pthread_sigmask"):  # Windows
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


# a guarded call


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
    call = pickle.dumps(sys.path) + pickle.dumps((os.getpid(), function, args, options))
    try:
        ran = subprocess.run(
            [sys.executable, "-P", "-c", _CHILD], input=call, capture_output=True,
            timeout=seconds, env={**os.environ, **_ONE_BLAS_THREAD},
        )  # fmt: skip
    except subprocess.TimeoutExpired as late:
        how, words = f"was not done after {seconds:g} s, its time limit", late.stderr
    else:
        if ran.returncode == 0 and ran.stdout:
            fine, result = pickle.loads(ran.stdout)
            if fine:
                return result  # type: ignore[no-any-return]
            raise result if isinstance(result, GpusimError) else InputError(f"{what}: {result}")
        how, words = f"ended with status {ran.returncode}", ran.stderr
        if ran.returncode < 0:
            name = signal.strsignal(-ran.returncode)
            with suppress(ValueError):
                name = signal.Signals(-ran.returncode).name
            how = f"died ({name}): the file is damaged, or too large"
    text = re.sub(r"\x1b\[[\d;]*m", "", (words or b"").decode("utf-8", "replace"))  # colours
    last = f"; got {' '.join(text.split())[-200:]!r}" if text.strip() else ""
    raise InputError(f"{what}: the process that does this {how}{last}")


def serve() -> None:
    """What the child of `call_in_child` does."""
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what a library prints must not get into the answer
    try:
        parent, function, args, options = pickle.load(sys.stdin.buffer)
        end_with(parent)
        _limit_memory()
        answer = pickle.dumps((True, function(*args, **options)))
    except GpusimError as error:
        answer = pickle.dumps((False, error))
    except MemoryError:
        answer = pickle.dumps((False, "takes more than the memory that it may have"))
    except Exception as error:
        said = f"{type(error).__name__}: {' '.join(str(error).split())[:200]}"
        answer = pickle.dumps((False, f"damaged, or not what it should be; got {said}"))
    answers.write(answer)
    answers.flush()
    os._exit(0)  # a damaged library must not spoil the answer when it is taken down


def _limit_memory() -> None:
    with suppress(ImportError, ValueError, OSError):  # Windows, or no permission
        import resource

        hard = resource.getrlimit(resource.RLIMIT_AS)[1]
        most = memory_limit()
        most = most if hard == resource.RLIM_INFINITY else min(most, hard)
        resource.setrlimit(resource.RLIMIT_AS, (most, hard))


# copies of this process


def in_copies(work: Callable[[int], R], count: int) -> list[R]:
    """``work(0)``, …, ``work(count - 1)``, shared out to this process and copies of it.

    A copy has none of the other threads: no device may be used in it, no pool of theirs, and
    nothing may wait for a lock. Arithmetic on arrays is what it is for.

    Results must be such as can be pickled. An error is raised here, that of the first item that
    has one. Where there is one processor, or no way of copying, all is done here, one item after
    the other; so is what a copy can't tell, or leaves undone because it was ended from outside.
    """
    ways = min(processors(), count)
    if ways < 2 or not _can_be_copied():
        return [work(item) for item in range(count)]
    shares = [range(first, count, ways) for first in range(ways)]
    threads = processors() // ways
    copies: list[tuple[multiprocessing.process.BaseProcess, Connection]] = []
    try:
        with _copying(), suppress(OSError):  # no room for another: its share is done here
            for share in shares[1:]:
                copies.append(_copy(work, share, threads))
        with limited(threads):
            found = _do(work, shares[0])
        for _, answers in copies:
            with suppress(Exception):
                found.update(answers.recv())
    finally:
        for process, _ in copies:  # all of them before anything that an interrupt may end
            process.kill()
        for process, answers in copies:
            process.join()
            answers.close()
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
    if sys.platform != "linux" or multiprocessing.current_process().daemon:
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
def _copying() -> Iterator[None]:
    """No interrupt, no collection of garbage (which may belong to the device) and no warning that
    other threads' locks stay locked, while copies are made and in them."""
    collects = gc.isenabled()
    with _interrupts_held(), warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)
        gc.disable()
        try:
            yield
        finally:
            if collects:
                gc.enable()


def _copy(
    work: Callable[[int], Any], share: Sequence[int], threads: int
) -> tuple[multiprocessing.process.BaseProcess, Connection]:
    fork = multiprocessing.get_context("fork")
    answers, answer = fork.Pipe(duplex=False)
    with answer:
        process = fork.Process(
            target=_serve_copy, args=(os.getpid(), work, share, threads, answer), daemon=True
        )
        process.start()
    return process, answers


def _serve_copy(
    parent: int, work: Callable[[int], Any], share: Sequence[int], threads: int, answer: Connection
) -> None:
    try:
        end_with(parent)
        with limited(threads):
            found = _do(work, share)
        answer.send(found)
    finally:
        os._exit(0)  # nothing that belongs to the device is taken down


# a pool beside this process


def start_pool(count: int, modules: Sequence[str], env: Mapping[str, str]) -> Any:
    """An executor (loky's) of ``count`` processes that import ``modules`` and end with this one."""
    import loky  # takes 0.1 s, and few programs need it
    from loky.backend import resource_tracker

    # it would list the semaphores of a caller that was killed, and cleans them up all the same
    sys.warnoptions.append("ignore:resource_tracker:UserWarning")
    resource_tracker.ensure_running()
    sys.warnoptions.pop()
    with _interrupts_held():
        return loky.ProcessPoolExecutor(
            count, initializer=_begin_helper, initargs=(os.getpid(), modules), env=dict(env)
        )


def _begin_helper(caller: int, modules: Sequence[str]) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the caller ends it
    threading.Thread(target=_end_without, args=(caller,), daemon=True).start()
    for module in modules:
        import_module(module)


def _end_without(caller: int) -> None:
    while os.getppid() == caller:
        time.sleep(0.5)
    os._exit(1)
