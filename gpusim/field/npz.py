"""Fields in NumPy's .npz: the form in which a program of one's own hands one over.

============== ============================================================================
``points``     (N, 3) reference position of the nodes
``cells_TYPE`` (M, k) node numbers from 0 per type of cell: ``cells_hex8``, ``cells_tet10`` …
               (`gpusim.mesh.CELL_TYPES`, node order of VTK and Abaqus)
``displacement`` (T, N, 3), or (N, 3) for one time
``times``      (T,) growing; may be left out for one time, which is 1 then
============== ============================================================================
"""

from __future__ import annotations

import io
import math
import struct
import zipfile
import zlib
from typing import Any

import numpy as np
import numpy.typing as npt

from gpusim.errors import InputError
from gpusim.field.field import Field
from gpusim.field.names import vector_name
from gpusim.files.input_file import InputFile
from gpusim.mesh import Mesh
from gpusim.parallel.machine import memory_limit

__all__ = ["read_npz"]

_CELLS = "cells_"
_GREATEST_RATIO = 1040.0  # of bytes unpacked to those packed: deflate can't do better
_DAMAGE = (
    ArithmeticError, EOFError, LookupError, OSError, RuntimeError, SyntaxError, TypeError,
    ValueError, struct.error, zipfile.BadZipFile, zlib.error,
)  # fmt: skip


def read_npz(file: InputFile, name: str | None = None) -> Field:
    """The field of an .npz file; ``name`` is that of the displacement array."""
    path = file.path
    try:
        with zipfile.ZipFile(file.stream()) as archive:
            arrays = {
                info.filename.removesuffix(".npy"): _array(archive, info)
                for info in archive.infolist()
            }
    except MemoryError:
        raise InputError(f"{path}: larger than the memory") from None
    except _DAMAGE as error:
        raise InputError(f"{path}: not an .npz of plain arrays ({str(error)[:200]!r})") from None
    which = vector_name(list(arrays), name)
    cells = {key[len(_CELLS) :]: array for key, array in arrays.items() if key.startswith(_CELLS)}
    missing = [
        text
        for text, there in (
            ("points", "points" in arrays),
            ("cells_hex8 or the like", bool(cells)),
            (name or "displacement", which is not None),
        )
        if not there
    ]
    if missing:
        raise InputError(
            f"{path}: no array {', '.join(missing)}; got {', '.join(arrays) or 'none'}"
        )
    assert which is not None
    u = arrays[which]
    single = u.ndim == 2
    if "times" not in arrays and not single and len(u) != 1:
        raise InputError(f"{path}: no array times; got {which} of shape {u.shape}")
    times = arrays.get("times", np.ones(1))
    if times.dtype.kind not in "iuf" or u.dtype.kind not in "iuf":
        raise InputError(
            f"{path}: times and {which}; got {times.dtype} and {u.dtype}; expected numbers"
        )
    return Field(Mesh(arrays["points"], cells), times, u, name=str(path))


def _array(archive: zipfile.ZipFile, info: zipfile.ZipInfo) -> npt.NDArray[Any]:
    """An array of the archive. Raises ValueError for one that isn't as large as it claims."""
    if info.file_size > min(_GREATEST_RATIO * info.compress_size + 1e5, memory_limit()):
        raise ValueError(f"{info.filename} claims {info.file_size} bytes")
    data = io.BytesIO(archive.read(info))
    version = np.lib.format.read_magic(data)
    header = np.lib.format.read_array_header_1_0 if version == (1, 0) else \
        np.lib.format.read_array_header_2_0  # fmt: skip
    shape, _, dtype = header(data)
    claimed = math.prod(shape) * dtype.itemsize
    if claimed != len(data.getvalue()) - data.tell():
        raise ValueError(f"{info.filename} of shape {shape} isn't of {claimed} bytes")
    data.seek(0)
    return np.asarray(np.lib.format.read_array(data, allow_pickle=False))
