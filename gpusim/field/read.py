"""Reading displacement fields, by the ending of the file's name."""

from __future__ import annotations

from collections.abc import Callable
from os import PathLike
from pathlib import Path

import numpy as np

from gpusim.errors import InputError
from gpusim.field.field import Field
from gpusim.files.input_file import InputFile, read_input
from gpusim.mesh import Mesh
from gpusim.mesh.formats.reader import PARALLEL

__all__ = ["FIELD_SUFFIXES", "read_field"]


def _vtu(file: InputFile, name: str | None) -> Field:
    from gpusim.field.vtu import read_vtu_field

    return read_vtu_field(file, name)


def _exodus(file: InputFile, name: str | None) -> Field:
    from gpusim.field.exodus import read_exodus_field

    return read_exodus_field(file, name)


def _frd(file: InputFile, name: str | None) -> Field:
    from gpusim.field.frd import read_frd

    return read_frd(file, name)


def _npz(file: InputFile, name: str | None) -> Field:
    from gpusim.field.npz import read_npz

    return read_npz(file, name)


_READERS: dict[str, Callable[[InputFile, str | None], Field]] = {
    ".vtu": _vtu,
    ".pvd": _vtu,
    ".series": _vtu,
    ".e": _exodus,
    ".ex2": _exodus,
    ".exo": _exodus,
    ".exodus": _exodus,
    ".frd": _frd,
    ".npz": _npz,
}
FIELD_SUFFIXES = tuple(_READERS)


def read_field(
    path: str | PathLike[str] | InputFile,
    *,
    name: str | None = None,
    scale: float = 1.0,
    magnify: float = 1.0,
) -> Field:
    """Read a mesh and its nodal displacements over time, as another program wrote them.

    Parameters
    ----------
    path
        ``.vtu`` (one state, time 1), ``.pvd`` and ``.vtu.series`` (ParaView: a ``.vtu`` per time),
        ``.e``/``.ex2``/``.exo``/``.exodus`` (Exodus), ``.frd`` (CalculiX, text),
        ``.npz`` (see `gpusim.field.npz`), or what `gpusim.files.input_file.read_input` has read of
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
    for key, value in (("scale", scale), ("magnify", magnify)):
        if not (np.isfinite(value) and value > 0.0):
            raise InputError(f"read_field: {key}; got {value}; expected a factor > 0")
    source = path.path if isinstance(path, InputFile) else Path(path)
    suffix = source.suffix.lower()
    if suffix in PARALLEL:
        raise InputError(f"{source}: {PARALLEL[suffix]}; expected the blocks merged, saved as .vtu")
    file = read_input(path, "a file with a displacement field")
    if suffix not in _READERS:
        raise InputError(
            f"{source}: unknown kind of field; got {suffix or 'no ending'!r}; expected one of "
            f"{', '.join(FIELD_SUFFIXES)}"
        )
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
