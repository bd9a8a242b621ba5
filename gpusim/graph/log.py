"""A file of lines that is only ever appended to: a CRC-32 and JSON each.

What a killed writer has torn is left out when it is read; so is a line that was changed.
"""

from __future__ import annotations

import json
import os
import sys
import time
import zlib
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from threading import Lock
from typing import Any

from gpusim.files.cache_files import open_cached

_FLUSH_S = 0.5
"""How long a line may stay off the disk."""


class Log:
    """A log that is written to, a new file."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._descriptor, self._lock, self._flushed = -1, Lock(), 0.0
        self._torn = b""

    def append(self, content: Any) -> None:
        """Add a line."""
        text = json.dumps(content, separators=(",", ":")).encode()
        with self._lock:
            if self._descriptor < 0:
                self.path.parent.mkdir(parents=True, exist_ok=True)
                flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_APPEND
                self._descriptor = os.open(self.path, flags, 0o644)
            line = b"%s%08x %s\n" % (self._torn, zlib.crc32(text), text)
            self._torn = b"\n"  # if the disk takes a part of the line alone
            while line:
                line = line[os.write(self._descriptor, line) :]
            self._torn = b""
            due = time.monotonic() - self._flushed >= _FLUSH_S
            if due:
                self._flushed = time.monotonic()
        if due:  # others may add lines meanwhile
            os.fsync(self._descriptor)

    def close(self) -> None:
        """Flush it, if anything was written."""
        with self._lock:
            if self._descriptor >= 0:
                os.fsync(self._descriptor)
                os.close(self._descriptor)
                self._descriptor = -1


def read_log(path: Path, start: int = 0) -> tuple[list[Any], int]:
    """What was added after byte ``start``, and where to go on; nothing of what is no plain file."""
    try:
        with open_cached(path, sys.maxsize) as stream:
            stream.seek(start)
            data = stream.read()
    except OSError:  # put together with others meanwhile, a folder, a link, or not ours to read
        return [], start
    whole = data[: data.rfind(b"\n") + 1]
    return list(_contents(whole)), start + len(whole)


def _contents(lines: bytes) -> Iterator[dict[str, Any]]:
    for line in lines.splitlines():
        if line[:8] == b"%08x" % zlib.crc32(line[9:]):
            with suppress(ValueError, RecursionError):
                content = json.loads(line[9:])
                if isinstance(content, dict):
                    yield content
