"""What a command does before it works, made quicker."""

from __future__ import annotations

import gc
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from gpusim.cli.options import Backend
from gpusim.interrupts import end_at_once, raise_again

__all__ = ["importing", "starting"]


@contextmanager
def starting(output: Path, backend: Backend) -> Iterator[None]:
    """Begin with what a run into ``output`` will need, while the block reads and imports the rest:
    a process that draws figures, and what an earlier run has asked the device for."""
    from gpusim.report import prepare_figures

    prepare_figures()
    if backend is Backend.numpy:
        yield
        return
    from gpusim.gpu.warmup import compile_ahead
    from gpusim.plan.state import earlier_programs

    with compile_ahead(earlier_programs(output)):
        yield


@contextmanager
def importing() -> Iterator[None]:
    """Without garbage collection meanwhile, nor later of what was made.

    What modules make while they are imported stays; to look through it again and again for garbage
    takes a sixth of the time that a command needs to start. Interrupts end the command meanwhile.
    """
    enabled = gc.isenabled()
    end_at_once()
    gc.disable()
    try:
        yield
    finally:
        raise_again()
        gc.freeze()
        if enabled:
            gc.enable()
