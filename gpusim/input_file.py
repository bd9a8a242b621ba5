"""Input files, read once: the bytes that are hashed are the bytes that are used.

Everything that reads a mesh, deck, field, picture, calibration or scene file begins with
`read_input` and goes on with what that returns. A file that is edited, replaced or removed while a
run goes on can therefore never be mistaken for what was read.
"""

from __future__ import annotations

import hashlib
import io
import os
import stat
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

from gpusim.errors import InputError

__all__ = ["InputFile", "read_input"]


@dataclass(frozen=True, eq=False)
class InputFile:
    """A file's bytes as they were at one moment, and where they came from."""

    path: Path
    data: bytes = field(repr=False)

    @cached_property
    def sha256(self) -> str:
        """Hexadecimal SHA-256 of `data`."""
        return hashlib.sha256(self.data).hexdigest()

    @property
    def suffix(self) -> str:
        """The name's ending in lower case: ``.vtu``."""
        return self.path.suffix.lower()

    def stream(self) -> io.BytesIO:
        """A new binary stream over `data`, at its beginning."""
        return io.BytesIO(self.data)

    def text(self, expected: str = "a text file") -> str:
        """`data` as UTF-8, without a byte order mark. Raises InputError for other bytes."""
        try:
            return self.data.decode("utf-8-sig")
        except UnicodeDecodeError as error:
            raise InputError(
                f"{self.path}: not a text; got byte {error.start} that is no UTF-8; "
                f"expected {expected}"
            ) from None

    @contextmanager
    def on_disk(self) -> Iterator[Path]:
        """A private copy of that name, for libraries that open files themselves."""
        with tempfile.TemporaryDirectory(prefix="gpusim-") as folder:
            copy = Path(folder) / self.path.name
            copy.write_bytes(self.data)
            yield copy


def read_input(
    source: str | os.PathLike[str] | InputFile,
    expected: str = "a file",
    sha256: str | None = None,
) -> InputFile:
    """Read a file whole; one that was read already is returned as it is.

    Parameters
    ----------
    source : a path, or what an earlier call returned.
    expected : what the file should be, for the message.
    sha256 : what it was when somebody looked before (None: nobody did).

    Raises
    ------
    InputError
        Naming the file: not found, a folder, a device or pipe, unreadable, larger than the memory,
        or changed since it had the hash ``sha256``.

    Examples
    --------
    >>> import tempfile, pathlib
    >>> path = pathlib.Path(tempfile.mkdtemp()) / "a.txt"
    >>> _ = path.write_text("abc")
    >>> read_input(path).sha256[:8]
    'ba7816bf'
    """
    file = source if isinstance(source, InputFile) else _read(source, expected)
    if sha256 is not None and file.sha256 != sha256:
        raise InputError(
            f"{file.path}: was changed after it was first read; got other bytes; "
            "expected the same file during a whole run: load the scene again"
        )
    return file


def _read(source: str | os.PathLike[str], expected: str) -> InputFile:
    path = Path(source)
    try:
        with open(path, "rb", opener=_open) as stream:
            if stat.S_ISREG(os.fstat(stream.fileno()).st_mode):
                return InputFile(path, stream.read())
        raise InputError(f"{path}: not a file; got a device or pipe; expected {expected}")
    except IsADirectoryError:
        raise InputError(f"{path}: not a file; got a folder; expected {expected}") from None
    except FileNotFoundError:
        problem = "not found"
    except ValueError as error:  # a NUL in the name
        if isinstance(error, InputError):
            raise
        problem = f"no name of a file ({error})"
    except MemoryError:
        problem = f"larger than the memory ({path.stat().st_size / 1e9:.1f} GB)"
    except OSError as error:
        problem = f"unreadable ({error.strerror or error})"
    raise InputError(f"{path}: {problem}; expected {expected}")


def _open(path: str, flags: int) -> int:
    # non-blocking: to open a pipe that nobody writes to would wait for ever
    return os.open(path, flags | getattr(os, "O_NONBLOCK", 0))
