"""Work in copies of the process: results, errors, and what is left behind."""

from __future__ import annotations

import os
import signal
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from gpusim.copies import in_copies
from gpusim.processors import all_processors, limited, processors

needs_copies = pytest.mark.skipif(
    all_processors() < 2 or sys.platform != "linux", reason="one core, or no way of copying"
)


@pytest.mark.parametrize("count", [0, 1, 2, 3, 5])
def test_results_come_in_order(count: int) -> None:
    base = np.arange(100_000.0)
    found = in_copies(lambda item: base * item, count)
    assert len(found) == count
    for item, one in enumerate(found):
        np.testing.assert_array_equal(one, base * item)


@needs_copies
def test_the_work_is_shared_out_and_copies_dont_share_theirs() -> None:
    found = in_copies(lambda _: (os.getpid(), processors()), 2)
    (here, left), (there, theirs) = found
    assert here == os.getpid() != there
    assert left == max(1, all_processors() // 2)
    assert theirs == 1
    assert processors() == all_processors()


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

    files = len(os.listdir("/proc/self/fd"))
    with pytest.raises(KeyboardInterrupt):
        in_copies(work, 2)
    with pytest.raises(ProcessLookupError):
        os.kill(int(note.read_text()), 0)
    assert len(os.listdir("/proc/self/fd")) == files


@needs_copies
def test_a_program_that_ignores_the_ends_of_processes_gets_results() -> None:
    before = signal.signal(signal.SIGCHLD, signal.SIG_IGN)
    try:
        here, there = in_copies(lambda item: (item, os.getpid()), 2)
    finally:
        signal.signal(signal.SIGCHLD, before)
    assert (here[0], there[0]) == (0, 1)
    assert here[1] != there[1]
