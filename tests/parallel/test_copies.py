"""Work in copies of the process: results, errors, and what is left behind."""

from __future__ import annotations

import gc
import hashlib
import multiprocessing
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

from gpusim.fem.sparse.matrix_product import shared
from gpusim.parallel import processes as parallel_processes
from gpusim.parallel.machine import all_processors, limited, processors
from gpusim.parallel.processes import _can_be_copied, in_copies

needs_copies = pytest.mark.skipif(
    all_processors() < 2 or sys.platform != "linux", reason="one core, or no way of copying"
)


@pytest.fixture(autouse=True)
def _by_themselves(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Threads that earlier tests have left, of BLAS or of a driver, are of no account here, nor is
    a shell that lets what it runs in the background ignore interrupts."""
    monkeypatch.setattr(parallel_processes, "_can_be_copied", lambda: sys.platform == "linux")
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.parametrize("count", [0, 1, 2, 3, 5])
def test_results_come_in_order(count: int) -> None:
    base = np.arange(100_000.0)
    found = in_copies(lambda item: base * item, count)
    assert len(found) == count
    for item, one in enumerate(found):
        np.testing.assert_array_equal(one, base * item)


@needs_copies
def test_the_work_is_shared_out_evenly() -> None:
    found = in_copies(lambda _: (os.getpid(), processors()), 2)
    (here, ours), (there, theirs) = found
    assert here == os.getpid() != there
    assert ours == theirs == all_processors() // 2
    assert processors() == all_processors()


@needs_copies
def test_copies_have_threads_of_their_own_where_there_are_processors_for_them() -> None:
    def work(item: int) -> tuple[int, set[int], list[int]]:
        seen: set[int] = set()

        def one(number: int) -> int:
            seen.add(threading.get_native_id())
            time.sleep(0.01)
            return number * item

        return processors(), seen, shared(one, list(range(20)))

    with limited(4):
        shared(abs, [1, 2])  # this process's threads are there already
        found = in_copies(work, 2)
    for item, (count, seen, results) in enumerate(found):
        assert count == 2
        assert len(seen) == 2
        assert results == [number * item for number in range(20)]


def test_without_processors_to_spare_all_is_done_here() -> None:
    with limited(1):
        assert in_copies(lambda _: os.getpid(), 3) == [os.getpid()] * 3


@needs_copies
def test_a_copys_error_is_raised_here() -> None:
    def work(item: int) -> int:
        if item == 1:
            raise ValueError(f"item {item}; got 1; expected another")
        return item

    with pytest.raises(ValueError, match="item 1; got 1"):
        in_copies(work, 2)


@needs_copies
def test_the_error_of_the_first_item_is_raised() -> None:
    def work(item: int) -> None:
        if item:
            raise ValueError(f"item {item}")

    # the second one's error is told by a copy
    with pytest.raises(ValueError, match="item 1"), limited(2):
        in_copies(work, 4)


class _Untold(Exception):
    """Can be pickled, but not read again."""

    def __init__(self, got: int, expected: int) -> None:
        super().__init__(f"got {got}; expected {expected}")


@needs_copies
def test_an_error_that_cant_be_told_is_found_here() -> None:
    def work(item: int) -> None:
        if item:
            raise _Untold(1, 2)

    with pytest.raises(_Untold, match="got 1; expected 2"):
        in_copies(work, 2)


@needs_copies
def test_what_a_copy_that_was_ended_leaves_is_done_here() -> None:
    me = os.getpid()

    def work(item: int) -> tuple[int, int]:
        if os.getpid() != me:
            os.kill(os.getpid(), signal.SIGKILL)
        return item, os.getpid()

    assert in_copies(work, 4) == [(item, me) for item in range(4)]


@needs_copies
def test_results_that_cant_be_told_are_found_here() -> None:
    found = in_copies(lambda item: lambda: item, 2)
    assert [one() for one in found] == [0, 1]


@needs_copies
def test_an_error_here_ends_the_copies(tmp_path: Path) -> None:
    note = tmp_path / "pid"

    def work(item: int) -> None:
        if item:
            note.with_suffix(".part").write_text(str(os.getpid()))
            note.with_suffix(".part").rename(note)
            time.sleep(600.0)
        while not note.exists():
            time.sleep(0.01)
        raise KeyboardInterrupt

    files = set(os.listdir("/proc/self/fd"))
    with pytest.raises(KeyboardInterrupt):
        in_copies(work, 2)
    with pytest.raises(ProcessLookupError):
        os.kill(int(note.read_text()), 0)
    # threads of other tests may close some meanwhile
    assert set(os.listdir("/proc/self/fd")) <= files


@needs_copies
def test_an_interrupt_while_copying_leaves_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    fork, made = os.fork, []

    def interrupted() -> int:
        made.append(fork())
        signal.raise_signal(signal.SIGINT)
        return made[-1]

    monkeypatch.setattr(os, "fork", interrupted)
    files = set(os.listdir("/proc/self/fd"))
    handler = signal.getsignal(signal.SIGINT)
    with pytest.raises(KeyboardInterrupt):
        in_copies(lambda item: item, 2)
    assert len(made) == 1
    with pytest.raises(ChildProcessError):
        os.waitpid(made[0], os.WNOHANG)
    # threads of other tests may close some meanwhile
    assert set(os.listdir("/proc/self/fd")) <= files
    assert signal.getsignal(signal.SIGINT) is handler
    assert not signal.pthread_sigmask(signal.SIG_BLOCK, [])
    assert gc.isenabled()


@needs_copies
def test_more_interrupts_leave_nothing_either(monkeypatch: pytest.MonkeyPatch) -> None:
    before = multiprocessing.active_children()

    def interrupted(process: int, options: int) -> tuple[int, int]:
        signal.raise_signal(signal.SIGINT)
        return process, options

    def work(item: int) -> None:
        if item:
            time.sleep(600.0)
        monkeypatch.setattr(os, "waitpid", interrupted)
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        in_copies(work, 3)
    monkeypatch.undo()
    until = time.monotonic() + 20.0
    while set(multiprocessing.active_children()) - set(before):
        assert time.monotonic() < until
        time.sleep(0.01)


@needs_copies
def test_a_copy_of_another_thread_hears_no_interrupt(monkeypatch: pytest.MonkeyPatch) -> None:
    fork = os.fork

    def interrupted() -> int:
        process = fork()
        if not process:
            signal.raise_signal(signal.SIGINT)
        return process

    monkeypatch.setattr(os, "fork", interrupted)
    with ThreadPoolExecutor(1) as pool:
        here, there = pool.submit(in_copies, lambda _: os.getpid(), 2).result()
    assert here == os.getpid() != there


@needs_copies
def test_nothing_is_copied_while_another_thread_is_at_work(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(parallel_processes, "_can_be_copied", _can_be_copied)
    with ThreadPoolExecutor(1) as pool:
        other = pool.submit(hashlib.pbkdf2_hmac, "sha256", b"", b"", 1_000_000)
        time.sleep(0.05)
        found = in_copies(lambda _: os.getpid(), 2)
        assert not other.done()
    assert found == [os.getpid()] * 2


@needs_copies
def test_copies_end_with_a_program_that_is_killed(tmp_path: Path) -> None:
    note = tmp_path / "pid"
    program = f"""
import os, signal, time
from pathlib import Path
from gpusim.parallel import processes as copies
from gpusim.parallel.processes import in_copies

copies._can_be_copied = lambda: True
me, note = os.getpid(), Path({str(note)!r})

def work(item):
    if os.getpid() != me:
        note.with_suffix(".part").write_text(str(os.getpid()))
        note.with_suffix(".part").rename(note)
        time.sleep(600.0)
    while not note.exists():
        time.sleep(0.01)
    os.kill(me, signal.SIGKILL)

in_copies(work, 2)
"""
    subprocess.run([sys.executable, "-c", program], timeout=60.0)
    copy = Path("/proc") / note.read_text() / "stat"
    for _ in range(500):
        # nobody may be there to ask for its end
        if not copy.exists() or ") Z" in copy.read_text():
            return
        time.sleep(0.01)
    pytest.fail("the copy is still at work")


@needs_copies
def test_a_program_that_ignores_the_ends_of_processes_gets_results() -> None:
    before = signal.signal(signal.SIGCHLD, signal.SIG_IGN)
    try:
        here, there = in_copies(lambda item: (item, os.getpid()), 2)
    finally:
        signal.signal(signal.SIGCHLD, before)
    assert (here[0], there[0]) == (0, 1)
    assert here[1] != there[1]
