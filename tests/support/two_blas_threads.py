"""Two threads in BLAS, as users have them: the suite's processes run with one (scripts/test.sh)."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from threadpoolctl import ThreadpoolController


@contextmanager
def two_blas_threads() -> Iterator[None]:
    """Meanwhile, and whoever wants may change their number."""
    controller = ThreadpoolController()
    with controller.limit(limits=2, user_api="blas"):
        OpenBLAS = type(controller.lib_controllers[0])
        getattr(OpenBLAS, "clear_controlling_thread", lambda force: None)(force=True)
        yield
