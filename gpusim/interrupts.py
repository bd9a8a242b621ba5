"""Interrupts (Ctrl-C) while a command starts: modules that are being imported must not meet them.

A KeyboardInterrupt in the middle of an import comes out as any error, with a traceback, or is
swallowed by a library. Nothing has been begun then that would have to be put in order.
"""

from __future__ import annotations

import os
import signal
import threading
from types import FrameType

__all__ = ["INTERRUPTED", "end_at_once", "raise_again"]

INTERRUPTED = 130
"""Exit code of a command that was interrupted."""


def end_at_once() -> None:
    """From now on an interrupt ends the process, with one line; unless somebody handles it."""
    _replace(signal.default_int_handler, _end)


def raise_again() -> None:
    """From now on an interrupt raises KeyboardInterrupt again."""
    _replace(_end, signal.default_int_handler)


def _replace(old: object, new: signal._HANDLER) -> None:
    main = threading.current_thread() is threading.main_thread()
    if main and signal.getsignal(signal.SIGINT) is old:
        signal.signal(signal.SIGINT, new)


def _end(number: int, frame: FrameType | None) -> None:
    del number, frame
    os.write(2, b"error: interrupted\n")
    os._exit(INTERRUPTED)
