"""HDF5 files that are being written, on disks that may be full.

The HDF5 library dies (SIGSEGV) of a disk that takes no more, and says so only in the text of its
messages where it doesn't. It writes through a stream that never fails, and learns nothing of it.
"""

from __future__ import annotations

import io
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import h5py

__all__ = ["writing_hdf5"]


@contextmanager
def writing_hdf5(path: Path, **options: Any) -> Iterator[h5py.File]:
    """A new HDF5 file with the ``options`` of `h5py.File`.

    Raises the OSError of the first write that failed, when the block ends or is left.
    """
    with _Stream(path) as stream:
        try:
            with h5py.File(stream, "w", **options) as file:
                yield file
        except Exception:
            stream.check()  # what follows from it says less
            raise
        stream.check()


class _Stream(io.FileIO):
    """A file whose writes always succeed; the first error is kept, and nothing written after it."""

    def __init__(self, path: Path) -> None:
        super().__init__(path, "w+")
        self._error: OSError | None = None

    def check(self) -> None:
        """Raise what went wrong."""
        if self._error is not None:
            raise self._error

    def write(self, data: Any) -> int:
        """All of the data, or none after an error."""
        rest = memoryview(data).cast("B")
        whole = len(rest)
        while rest and self._error is None:
            try:
                rest = rest[super().write(rest) :]
            except OSError as error:
                self._error = error
        return whole

    def truncate(self, size: int | None = None) -> int:
        """To ``size`` bytes, or nothing after an error."""
        if self._error is None:
            try:
                return super().truncate(size)
            except OSError as error:
                self._error = error
        return size or 0
