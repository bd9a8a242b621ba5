"""Meshes for other programs: surfaces as STL, solids and results as VTU, and PVD collections."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from xml.sax.saxutils import escape, quoteattr

import meshio
import numpy as np
import numpy.typing as npt
from meshio._mesh import topological_dimension

from gpusim.arrays.array_types import Float, Long
from gpusim.arrays.unique import distinct
from gpusim.errors import InputError
from gpusim.files.atomic_files import PathLike, atomic_path, atomic_stream, safe_name, write_text
from gpusim.files.output_folder import inside
from gpusim.mesh.file_content.numbering import NODES
from gpusim.mesh.polygons import cut_at_dents, unit_normals
from gpusim.validation import require

_MM_PER_M = 1000.0
_COARSE = 1e-3
"""Of the size of what is written: steps of float32 that would spoil it."""
_FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])


def write_stl(
    path: PathLike,
    points: Float,
    faces: npt.NDArray[np.integer],
    *,
    title: str = "",
    origin: Sequence[float] | Float = (0.0, 0.0, 0.0),
) -> Path:
    """Write faces as a binary STL, atomically.

    STL has no unit: coordinates are written in **millimetres**, and the header says so. A quad
    (a, b, c, d) becomes the triangles (a, b, c) and (a, c, d), the same split in every step.

    STL holds float32: 7 digits. Far from zero give an ``origin`` near the points.

    Parameters
    ----------
    path
        Ends in ``.stl``.
    points
        (N, 3) float64, deformed position of the nodes, m, world frame.
    faces
        (M, 3) or (M, 4) integer, corners counter-clockwise seen from outside. Triangles with a
        repeated corner (a quad that stands for a triangle) are left out.
    title
        Goes into the header; ASCII, cut to what fits its 80 bytes.
    origin
        (3,), m, world frame: coordinates are relative to it, and the header says so.

    Raises
    ------
    InputError
        Wrong shape, index out of range, position not finite, beyond float32, or so far from the
        origin that float32 would spoil the shape.

    Examples
    --------
    >>> square = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0.0]])
    >>> gs.export.write_stl("square.stl", square, np.array([[0, 1, 2, 3]])).stat().st_size
    184
    """
    triangles = _triangles(points, faces)
    zero = np.asarray(origin, np.float64)
    known = zero.shape == (3,) and np.isfinite(zero).all()
    require(known, "origin", origin, "three finite numbers, m")
    corners = (points[triangles] - zero) * _MM_PER_M
    held = np.abs(corners).max(initial=0.0) <= np.finfo(np.float32).max
    require(held, "points", "values that STL's float32 can't hold", "metres")
    _check_steps(points, corners)
    facets = np.zeros(len(triangles), _FACET)
    facets["normal"] = unit_normals(corners)
    facets["corners"] = corners
    # A binary STL must not begin with "solid", the first word of the text form.
    place = " from ({:.10g}, {:.10g}, {:.10g}) m".format(*zero) if zero.any() else ""
    header = f"gpusim binary STL, unit mm{place}. {title}".encode("ascii", "replace")[:80].ljust(80)
    with atomic_stream(path) as stream:
        stream.write(header)
        stream.write(len(facets).to_bytes(4, "little"))
        stream.write(facets.tobytes())
    return Path(path)


def write_region_stls(
    folder: PathLike,
    points: Float,
    faces: npt.NDArray[np.integer],
    region_of_face: npt.NDArray[np.integer],
    region_names: Sequence[str],
    *,
    step: int,
    origin: Sequence[float] | Float = (0.0, 0.0, 0.0),
) -> tuple[Path, ...]:
    """Write ``folder/<region>/<step:04d>.stl`` for every region that has faces; return the paths.

    ``region_of_face`` is (M,) integer, an index into ``region_names``; other arguments and errors
    as in `write_stl`.

    Examples
    --------
    >>> square = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0.0]])
    >>> faces, region = np.array([[0, 1, 2, 3]]), np.array([0])
    >>> paths = gs.export.write_region_stls(".", square, faces, region, ["top"], step=0)
    >>> [path.as_posix() for path in paths]
    ['top/0000.stl']
    """
    shape, each = region_of_face.shape, (len(faces),)
    require(shape == each, "region_of_face", f"shape {shape}", f"{each}")
    _check_indices("region_of_face", "", region_of_face, len(region_names))
    require(step >= 0, "step", step, "0 or more")
    names = [safe_name(name) for name in region_names]
    differ = len({name.lower() for name in names}) == len(names)
    expected = "names that stay different as folder names"
    require(differ, "region_names", list(region_names), expected)
    written = []
    for index, name in enumerate(names):
        selected = faces[region_of_face == index]
        if len(selected):
            path = inside(folder, name, f"{step:04d}.stl")
            title = f"region {name}, step {step}"
            written.append(write_stl(path, points, selected, title=title, origin=origin))
    return tuple(written)


def _check_steps(points: Float, corners: Float) -> None:
    """Refuse corners (mm) among which float32 leaves steps that can be seen."""
    known = points[np.isfinite(points).all(axis=1)]
    size = float(np.ptp(known, axis=0).max(initial=0.0)) if len(known) else 0.0
    away = np.abs(corners).max(initial=0.0)
    step = float(np.spacing(np.float32(away)))
    got = f"a body {size * _MM_PER_M:.4g} mm long, up to {away / _MM_PER_M:.7g} m from the origin, "
    got += f"where STL's float32 goes in steps of {step:.3g} mm"
    fine = not corners.size or step <= _COARSE * size * _MM_PER_M
    require(fine, "points", got, "an origin near it")


def _triangles(points: Float, faces: npt.NDArray[np.integer]) -> Long:
    if points.ndim != 2 or points.shape[1] != 3:
        raise InputError(f"points: got shape {points.shape}; expected (N, 3)")
    corners = faces.ndim == 2 and faces.shape[1] in (3, 4) and faces.dtype.kind in "iu"
    got = f"shape {faces.shape}, {faces.dtype}"
    require(corners, "faces", got, "(M, 3) or (M, 4) integer")
    _check_indices("faces", "node ", faces, len(points))
    known = np.isfinite(points[distinct(faces)]).all()
    require(known, "points", "a value that is not finite", "finite numbers, m")
    indices = faces.astype(np.int64)
    if faces.shape[1] == 4:
        indices, _ = cut_at_dents(points, indices)
        indices = np.where(indices < 0, indices[:, [2]], indices)
        indices = indices[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3)
    a, b, c = indices.T
    proper: Long = indices[(a != b) & (b != c) & (c != a)]
    return proper


# Cell type -> meshio's name. gpusim's node order is VTK's, but for wedge6, which VTK numbers from
# the other side: meshio turns it on writing and reading.
_MESHIO_NAME = {
    "tet4": "tetra", "hex8": "hexahedron", "wedge6": "wedge", "pyramid5": "pyramid",
    "tet10": "tetra10", "hex20": "hexahedron20", "hex27": "hexahedron27", "wedge15": "wedge15",
    "pyramid13": "pyramid13", "tri3": "triangle", "quad4": "quad",
}  # fmt: skip
for _name in ("wedge15", "pyramid13"):  # which meshio 5.3 knows, but has no dimension for
    topological_dimension.setdefault(_name, 3)


def write_vtu(
    path: PathLike,
    points: Float,
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
    require(bool(blocks), "cells", "none", "at least one cell type")
    counts = [len(array) for _, array in blocks]
    for name, values in (point_data or {}).items():
        _check_field("point_data", name, values, len(points))
    for name, values in (cell_data or {}).items():
        _check_field("cell_data", name, values, sum(counts))
    borders = np.cumsum(counts)[:-1]
    mesh = meshio.Mesh(
        points,
        blocks,
        point_data={_attribute(name): values for name, values in (point_data or {}).items()},
        cell_data={
            _attribute(name): np.split(values, borders)
            for name, values in (cell_data or {}).items()
        },
    )
    with atomic_path(path) as part:
        meshio.write(part, mesh, file_format="vtu")
    return Path(path)


def _attribute(name: str) -> str:
    """A name as it stands between quotes in XML, which meshio leaves to others."""
    odd = re.search("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]", name)
    require(odd is None, "field name", repr(name), "characters that XML has")
    return escape(name, {'"': "&quot;", "\t": "&#9;", "\n": "&#10;", "\r": "&#13;"})


_PVD = """\
<?xml version="1.0"?>
<VTKFile type="Collection" version="0.1" byte_order="LittleEndian">
  <Collection>
{}
  </Collection>
</VTKFile>
"""


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
    grows = all(a < b for a, b in pairwise(times)) and np.isfinite(times).all()
    require(bool(steps) and grows, "steps", times, "one or more finite, growing numbers")
    folder = Path(path).resolve().parent
    rows = []
    for time, file in steps:
        relative = Path(os.path.relpath(Path(file).resolve(), folder)).as_posix()
        rows.append(f'    <DataSet timestep="{time:.17g}" part="0" file={quoteattr(relative)}/>')
    return write_text(path, _PVD.format("\n".join(rows)))


def _check_points(points: Float) -> None:
    if points.ndim != 2 or points.shape[1] != 3 or len(points) == 0:
        raise InputError(f"points: got shape {points.shape}; expected (N, 3), N > 0")
    if not np.isfinite(points).all():
        raise InputError(f"points: {_first_bad(points)}; expected finite numbers")


def _block(
    kind: str, array: npt.NDArray[np.integer], nodes: int
) -> tuple[str, npt.NDArray[np.integer]]:
    known = kind in _MESHIO_NAME
    require(known, "cells", f"type {kind!r}", f"one of {', '.join(_MESHIO_NAME)}")
    what, width = f"cells[{kind!r}]", NODES[kind]
    fits = array.ndim == 2 and array.shape[1] == width and array.dtype.kind in "iu"
    require(fits, what, f"shape {array.shape}, {array.dtype}", f"(M, {width}) integer")
    _check_indices(what, "node ", array, nodes)
    return _MESHIO_NAME[kind], array


def _check_indices(what: str, of: str, indices: npt.NDArray[np.integer], count: int) -> None:
    """Refuse those that count what isn't there; ``of``: what they count, for the message."""
    if indices.size:
        low, high = indices.min(), indices.max()
        require(0 <= low and high < count, what, f"{of}{low} to {high}", f"0 to {count - 1}")


def _check_field(group: str, name: str, values: npt.NDArray[np.generic], rows: int) -> None:
    what, shape = f"{group}[{name!r}]", values.shape
    if values.ndim not in (1, 2) or len(values) != rows:
        raise InputError(f"{what}: got shape {shape}; expected ({rows},) or ({rows}, C)")
    require(values.dtype.kind in "iuf", what, values.dtype, "numbers")
    if values.dtype.kind == "f" and not np.isfinite(values).all():
        raise InputError(f"{what}: {_first_bad(values)}; expected finite numbers")


def _first_bad(values: npt.NDArray[np.generic]) -> str:
    index = np.argwhere(~np.isfinite(values.astype(np.float64)))[0]
    return f"got {values[tuple(index)]} at {index.tolist()}"
