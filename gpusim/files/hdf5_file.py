"""HDF5 files whole, as arrays and attributes.

The HDF5 library runs in circles, or dies, on some damaged files: it works in a process of its own.
Only what is in the file itself is read: links and data that are in other files are not followed.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from gpusim.errors import InputError
from gpusim.files.input_file import InputFile
from gpusim.parallel.processes import call_in_child

__all__ = ["Hdf5Object", "read_hdf5"]

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
    import io

    import h5py

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
                    raise InputError(
                        f"{source}: {path}: claims {one.nbytes / 1e6:.4g} MB; got {stored} bytes: "
                        "cut off or damaged"
                    )
                array = one[()]
        found[path] = Hdf5Object(attributes, array)

    with h5py.File(io.BytesIO(data), "r") as file:
        file.visititems(enter)
    return found
