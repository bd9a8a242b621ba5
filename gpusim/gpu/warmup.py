"""The device opened, and programs compiled, before it is known whether they are needed."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from threading import Thread
from typing import Any

from gpusim.errors import GpusimError
from gpusim.gpu.device import Device, default_device


@contextmanager
def compile_ahead(programs: Sequence[Any]) -> Iterator[None]:
    """Open the default device and compile what an earlier run asked for (`Programs.asked`), in
    threads that go on when the block has ended; they stop if the block raises.

    Without programs nothing is opened: an earlier run did without, or there was none.
    """
    thread = Thread(target=_begin, args=(programs,), name="gpusim.warmup")
    if programs:
        thread.start()
    try:
        yield
    except BaseException:
        if programs:
            thread.join()
            with suppress(GpusimError):
                default_device().programs.stop()
        raise


def _begin(programs: Sequence[Any]) -> None:
    with suppress(GpusimError):  # who needs the device will hear of it
        default_device().programs.begin(programs)


@contextmanager
def compile_during(device: Device, programs: Sequence[Any]) -> Iterator[None]:
    """The same for a ``device`` while the block runs, and no longer: a run that fails or is
    interrupted needn't wait for programs that nobody will ask for."""
    device.programs.begin(programs)
    try:
        yield
    finally:
        device.programs.stop()
