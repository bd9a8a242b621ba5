"""Reading mesh files, by the ending of their name."""

from __future__ import annotations

from collections.abc import Callable
from os import PathLike
from pathlib import Path

import numpy as np

from gpusim.errors import InputError
from gpusim.mesh.cad import CAD_SUFFIXES
from gpusim.mesh.mesh import Mesh
from gpusim.mesh.raw import assemble

__all__ = ["MESH_SUFFIXES", "read_mesh"]


def _msh(path: Path) -> Mesh:
    from gpusim.mesh.msh import read_msh

    return assemble(read_msh(path), str(path))


def _meshio(path: Path) -> Mesh:
    from gpusim.mesh.read_meshio import read_with_meshio

    return assemble(read_with_meshio(path), str(path))


def _vtk(path: Path) -> Mesh:
    from gpusim.mesh.vtk import read_vtk

    return assemble(read_vtk(path), str(path))


def _bdf(path: Path) -> Mesh:
    from gpusim.mesh.bdf import read_bdf

    return read_bdf(path)


def _inp(path: Path) -> Mesh:
    from gpusim.mesh.inp import read_inp

    return read_inp(path)


def _exodus(path: Path) -> Mesh:
    from gpusim.mesh.exodus import read_exodus

    return read_exodus(path)


_READERS: dict[str, Callable[[Path], Mesh]] = {
    ".msh": _msh,
    ".inp": _inp,
    ".vtu": _meshio,
    ".vtk": _vtk,
    ".e": _exodus,
    ".ex2": _exodus,
    ".exo": _exodus,
    ".exodus": _exodus,
    ".med": _meshio,
    ".bdf": _bdf,
    ".nas": _bdf,
    ".fem": _bdf,
    ".dat": _bdf,
}
MESH_SUFFIXES = tuple(_READERS)


def read_mesh(path: str | PathLike[str], *, scale: float = 1.0) -> Mesh:
    """Read a volume mesh: first- and second-order tetrahedra, hexahedra, wedges, pyramids.

    Parameters
    ----------
    path
        ``.msh`` (Gmsh 2.2 and 4.1, text or binary), ``.inp`` (Abaqus, CalculiX), ``.vtu``,
        ``.vtk``, ``.e``/``.ex2``/``.exo``/``.exodus`` (Exodus), ``.med``, ``.bdf``/``.nas``/
        ``.fem``/``.dat`` (Nastran).
    scale
        Factor on the coordinates: 1e-3 for a file in millimetres and a model in metres.

    Named groups (physical groups, Abaqus sets and surfaces, Exodus blocks and sets, MED families)
    become cell sets where they hold solids, face sets where they hold surfaces, node sets where
    they hold lines, points or nodes. Nodes that belong to no solid cell are left out of files with
    surfaces and lines.

    Raises
    ------
    InputError
        Names the file: absent, empty, cut off, of another format or version, without solid cells,
        with cells of an unknown type (named with their number), inverted cells.
    """
    if not (np.isfinite(scale) and scale > 0.0):
        raise InputError(f"read_mesh: scale; got {scale}; expected a factor > 0")
    file = Path(path)
    if not file.exists():
        raise InputError(f"{file}: no such file; expected a mesh file")
    if file.is_dir():
        raise InputError(f"{file}: is a folder; expected a mesh file")
    reader = _READERS.get(file.suffix.lower())
    if file.suffix.lower() in CAD_SUFFIXES:
        raise InputError(
            f"{file}: a CAD file, not a mesh; expected a call of mesh_cad, with a size"
        )
    if reader is None:
        raise InputError(
            f"{file}: unknown kind of mesh file; got {file.suffix or 'no ending'!r}; expected one "
            f"of {', '.join(MESH_SUFFIXES)}"
        )
    try:
        if file.stat().st_size == 0:
            raise InputError(f"{file}: the file is empty; expected a mesh")
        mesh = reader(file)
    except InputError as error:
        text = str(error)
        raise InputError(text if str(file) in text else f"{file}: {text}") from None
    except OSError as error:
        raise InputError(f"{file}: unreadable; got {error.strerror or error}") from None
    if scale == 1.0:
        return mesh
    return Mesh(mesh.points * scale, mesh.cells, mesh.node_sets, mesh.face_sets, mesh.cell_sets)
