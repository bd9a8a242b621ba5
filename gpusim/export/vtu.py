"""Meshes and results as VTU files (ParaView, meshio, PyVista) and PVD collections over steps."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np
import numpy.typing as npt

from gpusim.errors import InputError
from gpusim.files.atomic_files import PathLike, atomic_path, write_text
from gpusim.mesh.formats.meshio_types import meshio

__all__ = ["write_pvd", "write_vtu"]

# Cell type -> (meshio's name, nodes per cell). gpusim's node order is VTK's, but for wedge6,
# which VTK numbers from the other side: meshio turns it on writing and reading.
_VTK_NAME = {
    "tet4": ("tetra", 4),
    "hex8": ("hexahedron", 8),
    "wedge6": ("wedge", 6),
    "pyramid5": ("pyramid", 5),
    "tet10": ("tetra10", 10),
    "hex20": ("hexahedron20", 20),
    "hex27": ("hexahedron27", 27),
    "wedge15": ("wedge15", 15),
    "pyramid13": ("pyramid13", 13),
    "tri3": ("triangle", 3),
    "quad4": ("quad", 4),
}


def write_vtu(
    path: PathLike,
    points: npt.NDArray[np.float64],
    cells: Mapping[str, npt.NDArray[np.integer]],
    *,
    point_data: Mapping[str, npt.NDArray[np.generic]] | None = None,
    cell_data: Mapping[str, npt.NDArray[np.generic]] | None = None,
) -> Path:
    """Write a mesh with its fields, binary and zlib-compressed, atomically.

    Parameters
    ----------
    path
        Ends in ``.vtu``.
    points
        (N, 3) float64, reference position of the nodes, any length unit.
    cells
        Cell type (``"hex8"``, ``"tet4"``, …) -> (M, nodes) integer, VTK node order.
    point_data
        Field name -> (N,) or (N, C), for example ``{"u": displacement}``.
    cell_data
        Field name -> (M,) or (M, C), M = all cells in the order of ``cells``.

    Raises
    ------
    InputError
        Wrong shape, unknown cell type, node index out of range, value not finite.

    Examples
    --------
    >>> bar = gs.mesh.box(size=(1, 1, 1), divisions=(1, 1, 1))
    >>> gs.export.write_vtu("bar.vtu", bar.points, bar.cells, point_data={"u": 0 * bar.points}).name
    'bar.vtu'
    """
    _check_points(points)
    blocks = [_block(kind, array, len(points)) for kind, array in cells.items()]
    if not blocks:
        raise InputError("cells: got none; expected at least one cell type")
    counts = [len(array) for _, array in blocks]
    for name, values in (point_data or {}).items():
        _check_field("point_data", name, values, len(points))
    for name, values in (cell_data or {}).items():
        _check_field("cell_data", name, values, sum(counts))
    borders = np.cumsum(counts)[:-1]
    mesh = meshio.Mesh(
        points,
        blocks,
        point_data=dict(point_data or {}),
        cell_data={name: np.split(values, borders) for name, values in (cell_data or {}).items()},
    )
    with atomic_path(path) as part:
        meshio.write(part, mesh, file_format="vtu")
    return Path(path)


def write_pvd(path: PathLike, steps: Sequence[tuple[float, PathLike]]) -> Path:
    """Write a PVD collection that names one VTU file per time or load factor, atomically.

    File names are stored relative to the folder of ``path``, so the folder can be moved.

    Raises InputError if a step isn't finite, steps don't grow, or there are none.

    Examples
    --------
    >>> bar = gs.mesh.box(size=(1, 1, 1), divisions=(1, 1, 1))
    >>> steps = [(t, gs.export.write_vtu(f"{t}.vtu", bar.points, bar.cells)) for t in (0, 1)]
    >>> gs.export.write_pvd("bar.pvd", steps).name
    'bar.pvd'
    """
    times = [time for time, _ in steps]
    grows = all(a < b for a, b in pairwise(times))
    if not steps or not np.isfinite(times).all() or not grows:
        raise InputError(f"steps: got {times}; expected one or more finite, growing numbers")
    folder = Path(path).resolve().parent
    rows = []
    for time, file in steps:
        relative = Path(os.path.relpath(Path(file).resolve(), folder)).as_posix()
        rows.append(f'    <DataSet timestep="{time:.17g}" part="0" file={quoteattr(relative)}/>')
    text = "\n".join(
        [
            '<?xml version="1.0"?>',
            '<VTKFile type="Collection" version="0.1" byte_order="LittleEndian">',
            "  <Collection>",
            *rows,
            "  </Collection>",
            "</VTKFile>",
            "",
        ]
    )
    return write_text(path, text)


def _check_points(points: npt.NDArray[np.float64]) -> None:
    if points.ndim != 2 or points.shape[1] != 3 or len(points) == 0:
        raise InputError(f"points: got shape {points.shape}; expected (N, 3), N > 0")
    if not np.isfinite(points).all():
        raise InputError(f"points: {_first_bad(points)}; expected finite numbers")


def _block(
    kind: str, array: npt.NDArray[np.integer], nodes: int
) -> tuple[str, npt.NDArray[np.integer]]:
    if kind not in _VTK_NAME:
        raise InputError(f"cells: got type {kind!r}; expected one of {', '.join(_VTK_NAME)}")
    name, width = _VTK_NAME[kind]
    if array.ndim != 2 or array.shape[1] != width or not np.issubdtype(array.dtype, np.integer):
        raise InputError(
            f"cells[{kind!r}]: got shape {array.shape}, {array.dtype};"
            f" expected (M, {width}) integer"
        )
    if array.size and not (0 <= array.min() and array.max() < nodes):
        raise InputError(
            f"cells[{kind!r}]: got node {array.min()} to {array.max()}; expected 0 to {nodes - 1}"
        )
    return name, array


def _check_field(group: str, name: str, values: npt.NDArray[np.generic], rows: int) -> None:
    if values.ndim not in (1, 2) or len(values) != rows:
        raise InputError(
            f"{group}[{name!r}]: got shape {values.shape}; expected ({rows},) or ({rows}, C)"
        )
    if values.dtype.kind not in "iuf":
        raise InputError(f"{group}[{name!r}]: got {values.dtype}; expected numbers")
    if values.dtype.kind == "f" and not np.isfinite(values).all():
        raise InputError(f"{group}[{name!r}]: {_first_bad(values)}; expected finite numbers")


def _first_bad(values: npt.NDArray[np.generic]) -> str:
    index = np.argwhere(~np.isfinite(values.astype(np.float64)))[0]
    return f"got {values[tuple(index)]} at {index.tolist()}"
