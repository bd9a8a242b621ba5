"""Imports of a command, made quicker."""

from __future__ import annotations

import gc
from collections.abc import Iterator
from contextlib import contextmanager

__all__ = ["importing"]


@contextmanager
def importing() -> Iterator[None]:
    """Without garbage collection meanwhile, nor later of what was made.

    What modules make while they are imported stays; to look through it again and again for garbage
    takes a sixth of the time that a command needs to start.
    """
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        gc.freeze()
        if enabled:
            gc.enable()
