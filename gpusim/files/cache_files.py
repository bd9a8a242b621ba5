"""The user's cache folder, and the files in caches: what gpusim can do without.

Somebody else may have put anything there: only regular files of bounded size are opened, without
following a link and without waiting for one who writes.
"""

from __future__ import annotations

import os
import stat
import sys
from pathlib import Path
from typing import BinaryIO

_AT_ONCE = getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_BINARY", 0)


def cache_folder() -> Path | None:
    """Where gpusim keeps what it can do without; None if there is no such place."""
    if os.environ.get("GPUSIM_NO_CACHE", "0") not in ("", "0"):
        return None
    try:
        if base := os.environ.get("XDG_CACHE_HOME"):
            return Path(base) / "gpusim"
        if sys.platform == "win32":
            return Path(os.environ["LOCALAPPDATA"]) / "gpusim" / "cache"
        if sys.platform == "darwin":
            return Path.home() / "Library" / "Caches" / "gpusim"
        return Path.home() / ".cache" / "gpusim"
    except (KeyError, RuntimeError):  # no home
        return None


def open_cached(path: Path, most_bytes: int, *, append: bool = False) -> BinaryIO:
    """A stream that reads a file, or appends to it.

    Raises OSError for a file that isn't there, for a link, pipe, device or folder, and for one of
    more than ``most_bytes``.
    """
    flags = os.O_WRONLY | os.O_CREAT | os.O_APPEND if append else os.O_RDONLY
    descriptor = os.open(path, flags | _AT_ONCE, 0o644)
    status = os.fstat(descriptor)
    if not stat.S_ISREG(status.st_mode) or status.st_size > most_bytes:
        os.close(descriptor)
        raise OSError(f"{path}: no plain file of at most {most_bytes} bytes")
    return os.fdopen(descriptor, "ab" if append else "rb")
