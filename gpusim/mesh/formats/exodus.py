"""Exodus II files: meshes, and the nodal results that a solver wrote over time.

Classic netCDF is read through SciPy, netCDF-4 through HDF5. Node and side orders are those
of the Exodus II manual (Schoof & Yarberry, SAND92-2137, section 4.8 and 4.9).
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.io import netcdf_file

from gpusim.arrays.array_types import Float, Int, Long
from gpusim.errors import InputError
from gpusim.files.hdf5_file import read_hdf5
from gpusim.files.input_file import InputFile, read_input
from gpusim.mesh.file_content.cell_blocks import side_pairs
from gpusim.mesh.file_content.faults import file_faults
from gpusim.mesh.file_content.numbering import EXODUS_SIDES, from_upright_first
from gpusim.mesh.file_content.text import padded_text
from gpusim.mesh.mesh import Mesh
from gpusim.validation import require


@dataclass(frozen=True, eq=False)
class ExodusContent:
    """Variables of the file as plain arrays, and the element type of each block's connectivity."""

    file: InputFile
    arrays: Mapping[str, npt.NDArray[Any]]
    element_types: Mapping[str, str]

    @property
    def path(self) -> str:
        return str(self.file.path)

    def nodal(self, numbers: Sequence[int]) -> list[npt.NDArray[Any]]:
        """(T,N) values of each of these nodal variables, as they are stored."""
        arrays = self.arrays
        if _is_hdf5(self.file):  # where they were left until now
            each = "|".join(str(number + 1) for number in numbers)
            found = read_hdf5(self.file, f"vals_nod_var({each})?")
            arrays = {name: one.data for name, one in found.items() if one.data is not None}
        if "vals_nod_var" in arrays:
            return [arrays["vals_nod_var"][:, number] for number in numbers]
        names = [f"vals_nod_var{number + 1}" for number in numbers]
        return [ExodusContent(self.file, arrays, {}).array(name) for name in names]

    def array(self, name: str) -> npt.NDArray[Any]:
        if name not in self.arrays:
            raise InputError(f"{self.path}: no variable {name!r}; expected a complete Exodus file")
        return self.arrays[name]

    def names(self, name: str, ids: str, default: str, count: int) -> list[str]:
        given = strings(self.arrays[name]) if name in self.arrays else []
        given += [""] * (count - len(given))
        numbers = self.arrays.get(ids, np.arange(1, count + 1))
        return [
            text or f"{default}_{int(number)}"
            for text, number in zip(given[:count], numbers[:count], strict=True)
        ]

    def numbered(self, prefix: str) -> list[str]:
        """Names of the variables ``prefix1``, ``prefix2``, … as far as they go."""
        found = [name for name in self.arrays if name[len(prefix) :].isdigit()]
        found = [name for name in found if name.startswith(prefix)]
        return sorted(found, key=lambda name: int(name[len(prefix) :]))


def _is_hdf5(file: InputFile) -> bool:
    return file.data[:8] == b"\x89HDF\r\n\x1a\n"


def exodus_content(file: InputFile) -> ExodusContent:
    """The variables; of HDF5 files without the values over time."""
    if file.data[:4] in (b"CDF\x01", b"CDF\x02"):
        with netcdf_file(file.stream(), "r", mmap=False) as classic:
            variables = {
                name: (np.asarray(one.data), getattr(one, "elem_type", ""))
                for name, one in classic.variables.items()
            }
    elif _is_hdf5(file):
        variables = {
            name: (one.data, one.attributes.get("elem_type", ""))
            for name, one in read_hdf5(file, "(?!vals_)[^/]*").items()
            if one.data is not None
        }
    else:
        raise InputError(
            f"{file.path}: not an Exodus file; got first bytes {file.data[:8]!r}; expected netCDF "
            "(classic, 64-bit offset, or netCDF-4)"
        )
    arrays = {
        name: array if name.startswith("vals_") else native(array)
        for name, (array, _) in variables.items()
    }
    kinds = {name: padded_text(kind) for name, (_, kind) in variables.items()}
    return ExodusContent(file, arrays, kinds)


def native(data: Any) -> npt.NDArray[Any]:
    array = np.asarray(data)
    return array.astype(array.dtype.newbyteorder("="))


def strings(letters: npt.NDArray[Any]) -> list[str]:
    # as bytes, for NumPy's strings hide the zero that ends a text (rubbish may follow it)
    rows = np.ascontiguousarray(letters).reshape(-1, letters.shape[-1])
    return [padded_text(row.tobytes()) for row in rows]


_KIND = "complete Exodus file"
PathLike = str | os.PathLike[str] | InputFile

# Family and nodes of an element -> our type; Exodus writes "HEX", "HEX8", "TETRA10", "TET4", ...
_TYPE = {
    ("HEX", 8): "hex8", ("HEX", 20): "hex20", ("HEX", 27): "hex27",
    ("TET", 4): "tet4", ("TET", 10): "tet10",
    ("WED", 6): "wedge6", ("WED", 15): "wedge15",
    ("PYR", 5): "pyramid5", ("PYR", 13): "pyramid13",
}  # fmt: skip

_KNOWN = ", ".join(sorted(_TYPE.values()))

# Elements that are no solids: their blocks are left out. Any other kind is refused.
_FLAT = (
    "SHE", "QUA", "TRI", "BAR", "BEA", "TRU", "EDG", "SPH", "CIR", "NOD", "POI", "LIN", "NUL",
    "ROD",
)  # fmt: skip


class ExodusSteps:
    """Nodal results, unpacked when they are asked for.

    ``times`` (T,) float64, ``names`` of the nodal variables. ``info`` holds the information
    records, in which some solvers keep their whole input.
    """

    def __init__(self, content: ExodusContent) -> None:
        self._content = content
        arrays = content.arrays
        self.times = np.asarray(arrays.get("time_whole", np.zeros(0)), dtype=np.float64)
        self.names = tuple(strings(arrays["name_nod_var"]) if "name_nod_var" in arrays else ())
        records = arrays.get("info_records", np.zeros(0))
        self.info = tuple(strings(records)) if records.ndim == 2 else ()
        self._kept: dict[str, npt.NDArray[Any]] = {}

    def values(self, names: Sequence[str], step: int) -> Float:
        """(N, names) float64 of variables at a step. Raises InputError for damage."""
        with file_faults(self._content.file, _KIND):
            new = [name for name in names if name not in self._kept]
            if new:
                found = self._content.nodal([self.names.index(name) for name in new])
                self._kept.update(zip(new, found, strict=True))
            columns = [native(self._kept[name][step]) for name in names]
            return np.stack(columns, axis=1).astype(np.float64)


def read_exodus(path: PathLike) -> Mesh:
    """The mesh: element blocks as cell sets, node sets, side sets as face sets.

    Sets without a name are called ``block_<id>``, ``nodeset_<id>``, ``sideset_<id>``. Sides of
    blocks that aren't solids are left out. Raises InputError: not an Exodus file, cut off, no
    solid elements, an element type that isn't known.
    """
    return read_exodus_steps(path)[0]


def read_exodus_steps(path: PathLike) -> tuple[Mesh, ExodusSteps]:
    """The mesh, and its nodal variables over time. Raises InputError as ``read_exodus``."""
    file = read_input(path, "an Exodus file")
    with file_faults(file, _KIND):
        content = exodus_content(file)
        return _mesh(content), ExodusSteps(content)


def _points(content: ExodusContent) -> Float:
    if "coord" in content.arrays:
        points = np.asarray(content.array("coord"), dtype=np.float64).T
    else:
        axes = [f"coord{axis}" for axis in "xyz" if f"coord{axis}" in content.arrays]
        if not axes:
            content.array("coordx")
        points = np.stack([content.array(axis).astype(np.float64) for axis in axes], axis=1)
    fits = points.ndim == 2 and points.shape[1] == 3
    got = f"{points.shape[-1]} coordinates per node"
    require(fits, f"{content.path}: not a solid mesh", got, "3")
    return points


def _mesh(content: ExodusContent) -> Mesh:
    points = _points(content)
    connects = content.numbered("connect")
    names = content.names("eb_names", "eb_prop1", "block", len(connects))
    kinds, sizes = [], []  # of each block; "" for what isn't a solid
    parts: dict[str, list[Long]] = {}
    for connect in connects:
        nodes = content.array(connect)
        kinds.append(_kind(content, connect, nodes.shape[1]))
        sizes.append(len(nodes))
        if kinds[-1]:
            rows = from_upright_first(kinds[-1], nodes.astype(np.int64) - 1)
            parts.setdefault(kinds[-1], []).append(rows)
    written = {content.element_types.get(name, "").upper() or "unnamed" for name in connects}
    got = ", ".join(sorted(written)) or "none"
    require(bool(parts), f"{content.path}: no solid elements", got, f"one of {_KNOWN}")
    cells = {kind: np.concatenate(rows).astype(np.int32) for kind, rows in parts.items()}
    kind_of = np.repeat(
        np.array(kinds), sizes
    )  # by element number of the file, as its cell: -1 for none
    cell_of = np.full(len(kind_of), -1, dtype=np.int64)
    first = 0
    for kind, block in cells.items():
        cell_of[kind_of == kind] = first + np.arange(len(block))
        first += len(block)
    of_block = np.split(cell_of, np.cumsum(sizes)[:-1])
    cell_sets = {
        name: numbers.astype(np.int32)
        for name, kind, numbers in zip(names, kinds, of_block, strict=True)
        if kind
    }
    mesh = Mesh(points, cells, _node_sets(content), cell_sets=cell_sets)
    return mesh.with_sets(face_sets=_face_sets(content, mesh, cell_of))


def _kind(content: ExodusContent, connect: str, width: int) -> str:
    """Our type of a block's elements, "" for what isn't a solid. Raises InputError."""
    written = content.element_types.get(connect, "").upper()
    kind = _TYPE.get((written[:3], width), "")
    if not kind and written[:3] in {family for family, _ in _TYPE}:
        raise InputError(
            f"{content.path}: {connect}: element type {written} with {width} nodes; expected one "
            f"of {_KNOWN}"
        )
    if not kind and written and not written.startswith(_FLAT):
        raise InputError(
            f"{content.path}: {connect}: elements of type {written[:40]}; expected one of {_KNOWN}"
        )
    return kind


def _node_sets(content: ExodusContent) -> dict[str, Int]:
    lists = content.numbered("node_ns")
    ids = [int(name[len("node_ns") :]) for name in lists]
    names = content.names("ns_names", "ns_prop1", "nodeset", max(ids, default=0))
    return {
        names[number - 1]: np.unique(content.array(name)).astype(np.int32) - 1
        for name, number in zip(lists, ids, strict=True)
    }


def _face_sets(content: ExodusContent, mesh: Mesh, cell_of: Long) -> dict[str, Int]:
    """``cell_of``: the cell of each element of the file, -1 for what isn't a solid."""
    lists = content.numbered("elem_ss")
    ids = [int(name[len("elem_ss") :]) for name in lists]
    names = content.names("ss_names", "ss_prop1", "sideset", max(ids, default=0))
    found = {}
    for name, number in zip(lists, ids, strict=True):
        element = content.array(name).astype(np.int64) - 1
        side = content.array(f"side_ss{number}").astype(np.int64) - 1
        if len(element) and not (0 <= element.min() and element.max() < len(cell_of)):
            raise InputError(
                f"{content.path}: {name}: got elements {element.min() + 1} to {element.max() + 1}; "
                f"expected 1 to {len(cell_of)}"
            )
        solid = cell_of[element] >= 0
        pairs = side_pairs(
            mesh, cell_of[element[solid]], side[solid], EXODUS_SIDES, element[solid] + 1,
            f"side_ss{number}",
        )  # fmt: skip
        found[names[number - 1]] = pairs.astype(np.int32)
    return found
