"""Work for all processors on threads: what NumPy, SciPy and OpenCV do outside the lock of the
interpreter.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from typing import TypeVar

from gpusim.parallel.machine import processors, share_nothing

T = TypeVar("T")
R = TypeVar("R")


@cache
def _threads(count: int, process: int) -> ThreadPoolExecutor:
    """A copy of a process (`gpusim.parallel.processes`) has none of its threads."""
    del process
    return ThreadPoolExecutor(count, "gpusim", initializer=share_nothing)


def _pool() -> ThreadPoolExecutor:
    """As many threads as there are processors for this one."""
    return _threads(processors(), os.getpid())


def shared(work: Callable[[T], R], items: Sequence[T]) -> list[R]:
    """``work`` of each item in their order, on all processors that this thread may use. Called by
    ``work`` itself, it stays in that thread: waiting for others there would have them all wait."""
    if processors() == 1 or len(items) == 1:
        return [work(item) for item in items]
    return list(_pool().map(work, items))


def ahead(work: Callable[[T], R], items: Sequence[T]) -> Iterator[R]:
    """The same, at most a few beyond the one taken."""
    threads = processors()
    if threads == 1 or len(items) == 1:
        yield from map(work, items)
        return
    waiting = [_pool().submit(work, item) for item in items[:threads]]
    for number in range(len(items)):
        result = waiting.pop(0).result()
        if number + threads < len(items):
            waiting.append(_pool().submit(work, items[number + threads]))
        yield result
