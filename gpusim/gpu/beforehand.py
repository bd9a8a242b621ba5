"""The device opened, and programs compiled, before it is known whether they are needed."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from threading import Event, Thread
from typing import Any

from gpusim.errors import GpusimError
from gpusim.gpu.device import default_device

__all__ = ["beforehand", "meanwhile", "not_needed"]

_enough = Event()


@contextmanager
def beforehand(programs: Sequence[Any]) -> Iterator[None]:
    """Open the default device and compile what an earlier run asked for (`Programs.asked`), in a
    thread that goes on when the block has ended; it stops if the block raises.

    Without programs nothing is opened: an earlier run did without, or there was none.
    """
    _enough.clear()
    if programs:
        Thread(target=_open, args=(programs,), name="gpusim.beforehand").start()
    try:
        yield
    except BaseException:
        not_needed()
        raise


@contextmanager
def meanwhile() -> Iterator[None]:
    """Let what `beforehand` has begun go on while the block runs, and no longer: a run that fails
    or is interrupted needn't wait for programs that nobody will ask for."""
    try:
        yield
    finally:
        not_needed()


def not_needed() -> None:
    """Let what `beforehand` has begun end soon."""
    _enough.set()


def _open(programs: Sequence[Any]) -> None:
    try:
        device = default_device()
    except GpusimError:  # who needs the device will hear of it
        return
    device.programs.compile(programs, _enough)
