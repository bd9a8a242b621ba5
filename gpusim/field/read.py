"""Reading displacement fields: VTU and its series, Exodus, CalculiX, and NumPy's .npz.

An .npz is the form in which a program of one's own hands a field over:

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
from collections.abc import Callable, Sequence
from functools import partial
from itertools import product
from os import PathLike
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import numpy.typing as npt

from gpusim.arrays.array_types import Float
from gpusim.errors import InputError
from gpusim.field.field import Field
from gpusim.field.frd import read_frd
from gpusim.files.input_file import (
    SERIES_SUFFIXES,
    InputFile,
    read_input,
    read_series,
    results_hint,
)
from gpusim.mesh import Mesh
from gpusim.mesh.file_content.cell_blocks import assemble, solid_nodes
from gpusim.mesh.formats.exodus import read_exodus_steps
from gpusim.mesh.formats.reader import PARALLEL
from gpusim.mesh.formats.vtu import VtuFile
from gpusim.parallel.machine import memory_limit
from gpusim.validation import checked, positive, require

_VECTORS = ("displacement", "displacements", "disp", "displ", "u", "dis", "depl", "def")
_SCALARS = ("disp", "displ", "displacement", "d", "u", "dis")
_ENDINGS = (("x", "y", "z"), ("1", "2", "3"))
_CELLS = "cells_"
_GREATEST_RATIO = 1040.0  # of bytes unpacked to those packed: deflate can't do better
_DAMAGE = (
    ArithmeticError, EOFError, LookupError, OSError, RuntimeError, SyntaxError, TypeError,
    ValueError, struct.error, zipfile.BadZipFile, zlib.error,
)  # fmt: skip


def vector_name(known: Sequence[str], wanted: str | None) -> str | None:
    """The name among ``known`` that is ``wanted``, or a usual one for displacements; else None."""
    if wanted is not None:
        return wanted if wanted in known else None
    by_fold = {name.casefold(): name for name in reversed(known)}
    return next((by_fold[usual] for usual in _VECTORS if usual in by_fold), None)


def scalar_names(known: Sequence[str], wanted: str | None) -> tuple[str, str, str]:
    """Three names that are one scalar per axis: ``disp_x``, ``disp_y``, ``disp_z`` or the like.

    Raises InputError listing what there is.
    """
    by_fold = {name.casefold(): name for name in reversed(known)}
    starts = _SCALARS if wanted is None else (wanted.casefold(),)
    for start, between, ends in product(starts, ("", "_", "-", " ", "."), _ENDINGS):
        x, y, z = (by_fold.get(f"{start}{between}{end}") for end in ends)
        if x is not None and y is not None and z is not None:
            return x, y, z
    if wanted in known:
        raise InputError(f"{wanted!r} has one number per node; expected a vector of three")
    raise InputError(
        f"no displacement among the nodal variables; got {', '.join(known) or 'none'}; expected "
        + (repr(wanted) if wanted is not None else "one called displacement, disp, U …: say which")
    )


def read_exodus_field(file: InputFile, name: str | None = None) -> Field:
    """The field of an Exodus file; ``name`` is what the three variables begin with."""
    mesh, steps = read_exodus_steps(file)
    solved = len(steps.times) > 0
    require(solved, f"{file.path}: no time steps", "a mesh without results", "one with them")
    names = scalar_names(steps.names, name)
    return Field(mesh, steps.times, partial(steps.values, names), name=str(file.path))


def read_vtu_field(file: InputFile, name: str | None = None) -> Field:
    """The field of a .vtu (a single state, at time 1) or of a series of them.

    The mesh is that of the first file; the others must have as many nodes. All pieces of a file
    are read, one after another.
    """
    if file.suffix in SERIES_SUFFIXES:
        steps = read_series(file)
        for _, path in steps:
            what = f"{file.path}: names {path.name}"
            require(path.suffix.lower() == ".vtu", what, path.suffix, ".vtu files")
            require(path.is_file(), f"{what}, which isn't there", "no file", "one")
        times = [time for time, _ in steps]
        # the first step is read now, the others, of a size that memory may not hold, when needed
        first_file = file.beside(steps[0][1].absolute(), "a .vtu file")
    else:
        times, first_file = [1.0], file
        steps = [(1.0, file.path)]
    first = VtuFile(first_file)
    raw = first.mesh()
    mesh = assemble(raw, str(first_file.path))
    used = solid_nodes(raw)
    _vtu_displacement(first, name)  # a wrong name shows at once

    hashes: dict[int, str] = {}  # of the steps that were read before

    def step(number: int) -> Float:
        path = steps[number][1]
        content = first
        if number:
            beside = file.beside(path.absolute(), "a .vtu file")
            later = read_input(beside, sha256=hashes.get(number))
            hashes[number] = later.sha256
            content = VtuFile(later)
        u = _vtu_displacement(content, name)
        expected = f"{len(used)}, as in {steps[0][1].name}"
        require(len(u) == len(used), f"{path}", f"{len(u)} nodes", expected)
        return u[used]

    return Field(mesh, times, step, name=str(file.path))


def _vtu_displacement(content: VtuFile, name: str | None) -> Float:
    """(N, 3) of all nodes in the file."""
    known = content.point_data()
    which = vector_name([key for key, (_, columns) in known.items() if columns > 1], name)
    if which is None:
        try:
            names = scalar_names([key for key, (_, columns) in known.items() if columns <= 1], name)
        except InputError as error:
            had = ", ".join(f"{key} ({columns})" for key, (_, columns) in known.items())
            content.arrays.fail(f"{error}; point data: {had or 'none'}")
        return np.stack([content.point_values(key).astype(np.float64) for key in names], axis=1)
    u = content.point_values(which).astype(np.float64)
    if u.ndim != 2 or u.shape[1] != 3:
        content.arrays.fail(f"{which}; got shape {u.shape}; expected (N, 3)")
    return u


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
    wanted = {
        "points": "points" in arrays,
        "cells_hex8 or the like": bool(cells),
        name or "displacement": which is not None,
    }
    missing = ", ".join(text for text, there in wanted.items() if not there)
    got = ", ".join(arrays) or "none"
    require(not missing, f"{path}: no array {missing}", got, f"all of {', '.join(wanted)}")
    assert which is not None
    u = arrays[which]
    single = u.ndim == 2
    timed = "times" in arrays or single or len(u) == 1
    require(timed, f"{path}: no array times", f"{which} of shape {u.shape}", "a time for each")
    times = arrays.get("times", np.ones(1))
    numbers = times.dtype.kind in "iuf" and u.dtype.kind in "iuf"
    got = f"{times.dtype} and {u.dtype}"
    require(numbers, f"{path}: times and {which}", got, "numbers")
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


_READERS: dict[str, Callable[[InputFile, str | None], Field]] = {
    ".vtu": read_vtu_field,
    ".pvd": read_vtu_field,
    ".series": read_vtu_field,
    ".e": read_exodus_field,
    ".ex2": read_exodus_field,
    ".exo": read_exodus_field,
    ".exodus": read_exodus_field,
    ".frd": read_frd,
    ".npz": read_npz,
}
FIELD_SUFFIXES = tuple(_READERS)
Factor = Annotated[float, positive("a factor > 0")]


@checked
def read_field(
    path: str | PathLike[str] | InputFile,
    *,
    name: str | None = None,
    scale: Factor = 1.0,
    magnify: Factor = 1.0,
) -> Field:
    """Read a mesh and its nodal displacements over time, as another program wrote them.

    Parameters
    ----------
    path
        ``.vtu`` (one state, time 1), ``.pvd`` and ``.vtu.series`` (ParaView: a ``.vtu`` per time),
        ``.e``/``.ex2``/``.exo``/``.exodus`` (Exodus), ``.frd`` (CalculiX, text),
        ``.npz`` (see `gpusim.field.read`), or what `gpusim.files.input_file.read_input` has read of
        one. Steps are unpacked when they are needed.
    name
        Of the nodal variable, where it isn't called displacement, disp, U or the like. Exodus and
        VTU may have a scalar per axis: their common beginning.
    scale
        Factor on coordinates and displacements: 1e-3 for a file in millimetres.
    magnify
        Factor on the displacements alone, to show them larger than they are.

    Raises
    ------
    InputError
        Names the file: absent, damaged, of another format, without solids or without such a
        variable; a node of a solid without a displacement.

    Examples
    --------
    >>> bar = gs.mesh.box(size=(1, 1, 1), divisions=(1, 1, 1))
    >>> gs.export.write_vtu("bar.vtu", bar.points, bar.cells, point_data={"u": bar.points}).name
    'bar.vtu'
    >>> float(gs.read_field("bar.vtu").at(1.0).max())
    1.0
    """
    source = path.path if isinstance(path, InputFile) else Path(path)
    suffix = source.suffix.lower()
    if suffix in PARALLEL:
        raise InputError(f"{source}: {PARALLEL[suffix]}; expected the blocks merged, saved as .vtu")
    file = read_input(path, "a file with a displacement field")
    expected = f"one of {', '.join(FIELD_SUFFIXES)}{results_hint(source)}"
    what = f"{source}: unknown kind of field"
    require(suffix in _READERS, what, repr(suffix or "no ending"), expected)
    try:
        field = _READERS[suffix](file, name)
    except InputError as error:
        text = str(error)
        raise InputError(text if str(source.parent) in text else f"{source}: {text}") from None
    except OSError as error:
        raise InputError(f"{source}: unreadable; got {error.strerror or error}") from None
    except MemoryError:
        raise InputError(f"{source}: the field is larger than the memory") from None
    if scale == 1.0 and magnify == 1.0:
        return field
    mesh = field.mesh
    if scale != 1.0:
        mesh = Mesh(mesh.points * scale, mesh.cells, mesh.node_sets, mesh.face_sets, mesh.cell_sets)
    return Field(mesh, field.times, lambda k: scale * magnify * field.step(k), name=field.name)
