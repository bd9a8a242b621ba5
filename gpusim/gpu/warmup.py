"""The device opened, and programs compiled, before it is known whether they are needed."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from threading import Event, Thread
from typing import Any

from gpusim.errors import GpusimError
from gpusim.gpu.device import Device, default_device

__all__ = ["compile_ahead", "compile_during", "stop_compiling"]

_enough = Event()
_thread: Thread | None = None


@contextmanager
def compile_ahead(programs: Sequence[Any]) -> Iterator[None]:
    """Open the default device and compile what an earlier run asked for (`Programs.asked`), in a
    thread that goes on when the block has ended; it stops if the block raises.

    Without programs nothing is opened: an earlier run did without, or there was none.
    """
    _begin(None, programs)
    try:
        yield
    except BaseException:
        stop_compiling()
        raise


@contextmanager
def compile_during(device: Device, programs: Sequence[Any]) -> Iterator[None]:
    """The same for a ``device`` while the block runs, and no longer: a run that fails or is
    interrupted needn't wait for programs that nobody will ask for. What `compile_ahead` is at goes
    on in place of that."""
    if _thread is None or not _thread.is_alive():
        _begin(device, programs)
    try:
        yield
    finally:
        stop_compiling()


def stop_compiling() -> None:
    """Let what `compile_ahead` has begun end soon."""
    _enough.set()


def _begin(device: Device | None, programs: Sequence[Any]) -> None:
    global _thread
    _enough.clear()
    if programs:
        _thread = Thread(target=_compile, args=(device, programs), name="gpusim.warmup")
        _thread.start()


def _compile(device: Device | None, programs: Sequence[Any]) -> None:
    try:
        device = device or default_device()
    except GpusimError:  # who needs the device will hear of it
        return
    device.programs.compile(programs, _enough)
