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

import zipfile

import numpy as np

from gpusim.errors import InputError
from gpusim.field.field import Field
from gpusim.field.names import vector_name
from gpusim.input_file import InputFile
from gpusim.mesh import Mesh

__all__ = ["read_npz"]

_CELLS = "cells_"


def read_npz(file: InputFile, name: str | None = None) -> Field:
    """The field of an .npz file; ``name`` is that of the displacement array."""
    path = file.path
    try:
        with np.load(file.stream(), allow_pickle=False) as stored:
            arrays = {key: stored[key] for key in stored.files}
    except (ValueError, EOFError, zipfile.BadZipFile) as error:
        raise InputError(f"{path}: not an .npz of plain arrays ({error})") from None
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
