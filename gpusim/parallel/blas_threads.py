"""One thread in BLAS around batches of small products.

NumPy hands every matrix of a stack to BLAS by itself. For a few thousand numbers BLAS wakes all of
its threads, which then wait for each other: on a machine that has other work to do, ten times as
long as one thread takes alone. Work is shared out above BLAS, so that sums don't depend on how many
threads there are.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from functools import cache
from importlib import import_module

from threadpoolctl import ThreadpoolController


class _Limit:
    """BLAS's limit on threads is the process's: the first user sets it, the last one lifts it.

    Both is done by a thread of our own, because threadpoolctl lets nobody but the thread that has
    set a limit change it, and the last user needn't be the first one.
    """

    lock = threading.Lock()
    users = 0
    limits = ExitStack()
    thread: ThreadPoolExecutor | None = None


def _begin_in_copy() -> None:
    """A copy of a process has none of its threads, and nobody to open a lock that was closed."""
    _Limit.lock, _Limit.users, _Limit.thread = threading.Lock(), 0, None
    _Limit.limits = ExitStack()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_begin_in_copy)


@cache
def _controller() -> ThreadpoolController:
    """What BLAS libraries are loaded: NumPy's and SciPy's. To look for them takes milliseconds."""
    import_module("scipy.linalg.blas")
    return ThreadpoolController()


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """One thread in BLAS meanwhile, in all of the process; several threads may use it at once, and
    inside of each other. Also a decorator: ``@one_blas_thread()``.

    Examples
    --------
    >>> with one_blas_thread():
    ...     u = np.linalg.solve(matrices, right)  # doctest: +SKIP
    """
    with _Limit.lock:
        if _Limit.thread is None:
            _Limit.thread = ThreadPoolExecutor(1, thread_name_prefix="gpusim-blas")
            limit = _controller().limit
            _Limit.thread.submit(
                lambda: _Limit.limits.enter_context(limit(limits=1, user_api="blas"))
            ).result()
        _Limit.users += 1
    try:
        yield
    finally:
        with _Limit.lock:
            _Limit.users -= 1
            if not _Limit.users and _Limit.thread is not None:
                _Limit.thread.submit(_Limit.limits.close).result()
                _Limit.thread.shutdown()
                _Limit.thread = None
