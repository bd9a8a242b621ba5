"""Interrupts (Ctrl-C) where they may not raise KeyboardInterrupt wherever they come.

While a command starts, one in the middle of an import comes out as any error, with a traceback, or
is swallowed by a library: it ends the process, for nothing has been begun that would have to be put
in order. Later in a command it waits for an import to end, which might leave a lock behind that a
thread waits for, and for what a library calls and must not fail. A window is closed between two
pictures, then the process ends as it was told to.
"""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Iterable
from types import CodeType, FrameType
from typing import Any

INTERRUPTED = 130
"""Exit code of a command that was interrupted."""
UNINTERRUPTED: set[CodeType] = set()
"""Functions that a library calls which doesn't expect KeyboardInterrupt."""
_PATIENCE_S = 0.02
_MOST_DELAYS = 500
_delays = 0


def end_at_once() -> None:
    """From now on an interrupt ends the process, with one line; unless somebody handles it."""
    _handle_by(_end)


def raise_again() -> None:
    """From now on an interrupt raises KeyboardInterrupt, as soon as it may."""
    _handle_by(_raise)


class DelayedSignals:
    """Signals that end a process, delayed until the block ends; then they do what they always do.

    ``told``: those that have come. What the block runs looks there, and stops.

    Examples
    --------
    >>> from gpusim.interrupts import DelayedSignals
    >>> with DelayedSignals() as signals:
    ...     signals.told
    []
    """

    def __init__(self) -> None:
        self.told: list[int] = []
        self._before: dict[int, Any] = {}

    def __enter__(self) -> DelayedSignals:
        before = {number: signal.getsignal(number) for number in _ending()}
        self._before = {k: v for k, v in before.items() if v is not None}
        self.take()
        return self

    def take(self) -> None:
        """Delay them from now on, whoever has taken them meanwhile."""
        for number, before in self._before.items():
            # nohup, and shells in the background, have some of them ignored
            ignored = before is signal.SIG_IGN
            signal.signal(number, before if ignored else lambda k, _: self.told.append(k))

    def __exit__(self, *_: object) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)
        for number in self.told[:1]:
            signal.raise_signal(number)


def _ending() -> Iterable[signal.Signals]:
    """SIGHUP is told by a terminal that is gone; Windows has none."""
    names = ("SIGINT", "SIGTERM", "SIGHUP")
    return [getattr(signal, name) for name in names if hasattr(signal, name)]


def _handle_by(handler: signal._HANDLER) -> None:
    main = threading.current_thread() is threading.main_thread()
    if main and signal.getsignal(signal.SIGINT) in (signal.default_int_handler, _end, _raise):
        signal.signal(signal.SIGINT, handler)


def _end(number: int, frame: FrameType | None) -> None:
    del number, frame
    os.write(2, b"error: interrupted\n")
    os._exit(INTERRUPTED)


def _raise(number: int, frame: FrameType | None) -> None:
    """Raise KeyboardInterrupt, or come again a little later; not for ever: an import may be what
    has called the command."""
    global _delays
    while frame is not None and _delays < _MOST_DELAYS and hasattr(signal, "setitimer"):
        code, frame = frame.f_code, frame.f_back
        if code in UNINTERRUPTED or code.co_filename.startswith("<frozen importlib"):
            _delays += 1
            signal.signal(signal.SIGALRM, _raise)
            signal.setitimer(signal.ITIMER_REAL, _PATIENCE_S)
            return
    _delays = 0
    raise KeyboardInterrupt
