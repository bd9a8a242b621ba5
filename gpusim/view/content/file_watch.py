"""Whether files have changed, by their number, time and size."""

from __future__ import annotations

import time
from collections.abc import Iterable
from pathlib import Path

from gpusim.files.input_file import Stamp, file_stamp

PERIOD = 0.25
"""s between two looks."""

QUIET = 0.1
"""s for which a file hasn't changed before it counts: editors write in several steps."""


class FileWatch:
    """Looks at some files, now and then.

    Examples
    --------
    >>> from gpusim.view.content.file_watch import FileWatch
    >>> watch = FileWatch([Path("bar.toml")])
    >>> watch.changed()
    False
    """

    def __init__(self, files: Iterable[Path]) -> None:
        self._next = 0.0
        self.files: tuple[Path, ...] = ()
        self.watch(files)

    def watch(self, files: Iterable[Path]) -> None:
        """Look at these files from now on, as they are."""
        self.files = tuple(dict.fromkeys(files))
        self._state = self._pending = self._found()

    def changed(self) -> bool:
        """Whether one of them is another since the last call that said so, or has come or gone."""
        now = time.monotonic()
        if now < self._next:
            return False
        found = self._found()
        waiting = found != self._pending
        self._next = now + (QUIET if waiting else PERIOD)
        self._pending = found
        if waiting or found == self._state:
            return False
        self._state = found
        return True

    def _found(self) -> list[Stamp | None]:
        return [file_stamp(path) for path in self.files]
