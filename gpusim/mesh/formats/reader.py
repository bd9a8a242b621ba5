"""Reading mesh files, by the ending of their name."""

from __future__ import annotations

from collections.abc import Callable
from os import PathLike
from pathlib import Path

import numpy as np

from gpusim.errors import InputError
from gpusim.files.input_file import InputFile, read_input
from gpusim.mesh.file_content.cell_blocks import RawMesh, assemble
from gpusim.mesh.formats.abaqus.reader import read_inp
from gpusim.mesh.formats.cad import CAD_SUFFIXES
from gpusim.mesh.formats.exodus import read_exodus
from gpusim.mesh.formats.med import read_med
from gpusim.mesh.formats.msh import read_msh
from gpusim.mesh.formats.nastran import read_bdf
from gpusim.mesh.formats.vtk import read_vtk
from gpusim.mesh.formats.vtu import VtuFile
from gpusim.mesh.mesh import Mesh
from gpusim.validation import require, require_one_of

# VTK's files that name others, with a part of the whole in each
PARALLEL = {
    ".pvtu": "names the pieces of a parallel grid, which are files of their own",
    ".vtm": "names the blocks of a multi-block data set, which are files of their own",
    ".vtpd": "names the parts of a partitioned data set, which are files of their own",
}

_READERS: dict[str, Callable[[InputFile], RawMesh | Mesh]] = {
    ".msh": read_msh,
    ".inp": read_inp,
    ".vtu": lambda file: VtuFile(file).mesh(),
    ".vtk": read_vtk,
    **dict.fromkeys((".e", ".ex2", ".exo", ".exodus"), read_exodus),
    ".med": read_med,
    **dict.fromkeys((".bdf", ".nas", ".fem", ".dat"), read_bdf),
}
MESH_SUFFIXES = tuple(_READERS)


def read_mesh(path: str | PathLike[str] | InputFile, *, scale: float = 1.0) -> Mesh:
    """Read a volume mesh: first- and second-order tetrahedra, hexahedra, wedges, pyramids.

    Parameters
    ----------
    path
        ``.msh`` (Gmsh 2.2 and 4.1, text or binary), ``.inp`` (Abaqus, CalculiX), ``.vtu``,
        ``.vtk``, ``.e``/``.ex2``/``.exo``/``.exodus`` (Exodus), ``.med``, ``.bdf``/``.nas``/
        ``.fem``/``.dat`` (Nastran), or what `gpusim.files.input_file.read_input` has read of one.
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

    Examples
    --------
    >>> bar = gs.mesh.box(size=(1, 1, 1), divisions=(2, 1, 1))
    >>> gs.export.write_vtu("bar.vtu", bar.points, bar.cells).name
    'bar.vtu'
    >>> gs.read_mesh("bar.vtu", scale=1e-3)
    Mesh(12 nodes, 2 hex8)
    """
    require(np.isfinite(scale) and scale > 0.0, "read_mesh: scale", scale, "a factor > 0")
    name = path.path if isinstance(path, InputFile) else Path(path)
    suffix = name.suffix.lower()
    if suffix in CAD_SUFFIXES:
        raise InputError(
            f"{name}: a CAD file, not a mesh; expected a call of mesh_cad, with a size"
        )
    if suffix in PARALLEL:
        raise InputError(f"{name}: {PARALLEL[suffix]}; expected the blocks merged, saved as .vtu")
    file = read_input(path, "a mesh file")
    require_one_of(f"{name}: unknown kind of mesh file", suffix or "no ending", MESH_SUFFIXES)
    if not file.data:
        raise InputError(f"{name}: the file is empty; expected a mesh")
    try:
        found = _READERS[suffix](file)
        mesh = found if isinstance(found, Mesh) else assemble(found, str(file.path))
    except InputError as error:
        text = str(error)
        raise InputError(text if str(name) in text else f"{name}: {text}") from None
    except OSError as error:
        raise InputError(f"{name}: unreadable; got {error.strerror or error}") from None
    except MemoryError:
        raise InputError(f"{name}: the mesh is larger than the memory") from None
    if scale == 1.0:
        return mesh
    return Mesh(mesh.points * scale, mesh.cells, mesh.node_sets, mesh.face_sets, mesh.cell_sets)
