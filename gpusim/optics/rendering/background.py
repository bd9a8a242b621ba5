"""Work on the host side by side, where arrays are long enough for it."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from types import TracebackType
from typing import ParamSpec, TypeVar

__all__ = ["FEWEST", "BackgroundTasks"]

FEWEST = 2000
"""Triangles of a view from which on threads gain: NumPy lets go of the interpreter in passes over
long arrays only, and threads that wait for it get it 5 ms later."""

P = ParamSpec("P")
R = TypeVar("R")


class BackgroundTasks:
    """A thread for a view of ``count`` triangles, or none; a context manager that ends it."""

    def __init__(self, count: int) -> None:
        self._pool = ThreadPoolExecutor(1) if count >= FEWEST else None

    def __enter__(self) -> BackgroundTasks:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._pool is not None:
            self._pool.shutdown()

    def begin(
        self, function: Callable[P, R], *args: P.args, **options: P.kwargs
    ) -> Callable[[], R]:
        """Begin with a call; what is returned waits for its result, or finds it."""
        if self._pool is None:
            return lambda: function(*args, **options)
        return self._pool.submit(function, *args, **options).result
