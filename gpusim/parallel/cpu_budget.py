"""How many processors there are to share work out to."""

from __future__ import annotations

import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache

__all__ = ["all_processors", "limited", "processors"]

_own = threading.local()


@cache
def all_processors() -> int:
    """Processors this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def processors() -> int:
    """Processors this thread may share its work out to: all of them, unless it is `limited`."""
    limit: int | None = getattr(_own, "limit", None)
    return all_processors() if limit is None else limit


@contextmanager
def limited(count: int) -> Iterator[None]:
    """This thread shares its work out to ``count`` processors meanwhile."""
    before: int | None = getattr(_own, "limit", None)
    _own.limit = count
    try:
        yield
    finally:
        _own.limit = before
