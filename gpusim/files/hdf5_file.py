"""HDF5 files: read whole, as arrays and attributes, and written to disks that may be full.

The HDF5 library runs in circles, or dies, on some damaged files: it reads in a process of its own.
Only what is in the file itself is read: links and data that are in other files are not followed.

It dies (SIGSEGV) of a disk that takes no more, too, and says so only in the text of its messages
where it doesn't. It writes through a stream that never fails, and learns nothing of it.
"""

from __future__ import annotations

import io
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from gpusim.errors import InputError
from gpusim.files.input_file import InputFile
from gpusim.interrupts import UNINTERRUPTED
from gpusim.parallel.processes import call_in_child

if TYPE_CHECKING:
    import h5py

_SECONDS, _BYTES_PER_SECOND = 15.0, 20e6  # time limit: some seconds, and longer for large files
_GREATEST_RATIO = 1040.0  # of the bytes of data to those stored: deflate can't do better


@dataclass(frozen=True, eq=False)
class Hdf5Object:
    """A group (``data`` None) or data set; attributes that are texts or numbers."""

    attributes: Mapping[str, Any]
    data: npt.NDArray[Any] | None = None


def read_hdf5(file: InputFile, wanted: str = ".*") -> dict[str, Hdf5Object]:
    """Path of an object (``a/b``) -> object, in the order of the file.

    ``wanted`` is a regular expression: data sets whose whole path doesn't match it, and those of
    anything else than numbers and letters, have no ``data``.

    Raises InputError, naming the file: not HDF5, damaged, data elsewhere or beyond the memory.
    """
    limit = _SECONDS + len(file.data) / _BYTES_PER_SECOND
    what = f"{file.path}: can't be read as HDF5"
    return call_in_child(what, limit, _objects, file.data, wanted, str(file.path))


def _objects(data: bytes, wanted: str, source: str) -> dict[str, Hdf5Object]:
    import h5py  # takes a tenth of a second

    found: dict[str, Hdf5Object] = {}

    def enter(path: str, one: Any) -> None:
        attributes = {}
        for name in one.attrs:
            value = one.attrs[name]
            if isinstance(value, str | bytes) or np.asarray(value).dtype.kind in "iufS":
                attributes[name] = value
        array = None
        if isinstance(one, h5py.Dataset) and one.dtype.base.kind in "iufS":
            if one.external or one.is_virtual:
                raise InputError(f"{source}: {path}: its data are in another file; expected here")
            if re.fullmatch(wanted, path):
                stored = one.id.get_storage_size()
                if one.nbytes > _GREATEST_RATIO * stored + 1e5:
                    what = f"{source}: {path}: claims {one.nbytes / 1e6:.4g} MB"
                    raise InputError(f"{what}; got {stored} bytes: cut off or damaged")
                array = one[()]
        found[path] = Hdf5Object(attributes, array)

    with h5py.File(io.BytesIO(data), "r") as file:
        file.visititems(enter)
    return found


@contextmanager
def writing_hdf5(path: Path, **options: Any) -> Iterator[h5py.File]:
    """A new HDF5 file with the ``options`` of `h5py.File`.

    Raises the OSError of the first write that failed, when the block ends or is left.
    """
    import h5py

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


UNINTERRUPTED.update((_Stream.write.__code__, _Stream.truncate.__code__))
