"""Work on the host side by side, where arrays are long enough for it."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from types import TracebackType
from typing import ParamSpec, TypeVar

__all__ = ["BackgroundTasks"]

P = ParamSpec("P")
R = TypeVar("R")


class BackgroundTasks:
    """A ``thread`` beside this one, or none; a context manager that ends it."""

    def __init__(self, thread: bool) -> None:
        # one: more would wait for the interpreter
        self._pool = ThreadPoolExecutor(1) if thread else None

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
