"""Silence of decoders in C, which print past Python what is wrong with a file.

Errors say it once. Python's own standard error goes nowhere either meanwhile, in all threads.
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from threading import Lock

_STDERR = 2
_lock = Lock()
_silent: list[int] = []
"""A copy of standard error for each thread that asks for silence, the first one the real one."""


@contextmanager
def silence() -> Iterator[None]:
    """Nothing is printed to standard error meanwhile; threads may ask for it at once."""
    with _lock, suppress(OSError):  # it may be closed
        _silent.append(os.dup(_STDERR))
        if len(_silent) == 1:
            with tempfile.TemporaryFile() as unread:
                os.dup2(unread.fileno(), _STDERR)
    try:
        yield
    finally:
        with _lock, suppress(IndexError):
            last = _silent.pop()
            if not _silent:
                os.dup2(last, _STDERR)
            os.close(last)
