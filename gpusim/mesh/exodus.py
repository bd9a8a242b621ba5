"""Exodus II files: meshes, and the nodal results that a solver wrote over time.

Classic netCDF is read through SciPy, netCDF-4 (HDF5) through h5py. Node and side orders are those
of the Exodus II manual (Schoof & Yarberry, SAND92-2137, section 4.8 and 4.9).
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import h5py
import numpy as np
import numpy.typing as npt
from scipy.io import netcdf_file

from gpusim.errors import InputError
from gpusim.mesh.cells import CELL_TYPES
from gpusim.mesh.mesh import Mesh

__all__ = [
    "ExodusFields",
    "ExodusSteps",
    "read_exodus",
    "read_exodus_fields",
    "read_exodus_steps",
]

PathLike = str | os.PathLike[str]
Float = npt.NDArray[np.float64]
Int = npt.NDArray[np.int32]
T = TypeVar("T")

# Family and nodes of an element -> our type; Exodus writes "HEX", "HEX8", "TETRA10", "TET4", ...
_TYPE = {
    ("HEX", 8): "hex8", ("HEX", 20): "hex20", ("HEX", 27): "hex27",
    ("TET", 4): "tet4", ("TET", 10): "tet10",
    ("WED", 6): "wedge6", ("WED", 15): "wedge15",
    ("PYR", 5): "pyramid5", ("PYR", 13): "pyramid13",
}  # fmt: skip

# Exodus counts vertical edges before top edges, and faces of a hex27 after its centre.
_ORDER = {
    "hex20": [*range(12), 16, 17, 18, 19, 12, 13, 14, 15],
    "hex27": [*range(12), 16, 17, 18, 19, 12, 13, 14, 15, 23, 24, 25, 26, 21, 22, 20],
    "wedge15": [*range(9), 12, 13, 14, 9, 10, 11],
}

# What the readers of the containers raise on damaged files, whatever place the damage is in.
_DAMAGE = (
    ArithmeticError, AssertionError, AttributeError, LookupError, MemoryError, RuntimeError,
    SyntaxError, TypeError, ValueError,
)  # fmt: skip

# Corners of each Exodus side, in the order of the side numbers.
_SIDES = {
    "hex": ((0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (0, 4, 7, 3), (0, 3, 2, 1), (4, 5, 6, 7)),
    "tet": ((0, 1, 3), (1, 2, 3), (0, 3, 2), (0, 2, 1)),
    "wed": ((0, 1, 4, 3), (1, 2, 5, 4), (0, 3, 5, 2), (0, 2, 1), (3, 4, 5)),
    "pyr": ((0, 1, 4), (1, 2, 4), (2, 3, 4), (0, 4, 3), (0, 3, 2, 1)),
}


@dataclass(frozen=True, eq=False)
class ExodusFields:
    """Results of an Exodus file.

    ``times`` (T,) float64. ``nodal`` maps a variable's name to (T,N) float64. ``info`` holds the
    information records, in which some solvers keep their whole input.
    """

    times: Float
    nodal: Mapping[str, Float]
    info: tuple[str, ...]

    def vector(self, names: tuple[str, str, str]) -> Float:
        """(T,N,3) float64 of three nodal variables, such as ``("disp_x", "disp_y", "disp_z")``.

        Raises InputError for an unknown name.
        """
        for name in names:
            if name not in self.nodal:
                known = ", ".join(self.nodal) or "none"
                raise InputError(
                    f"Exodus fields: unknown variable; got {name!r}; expected one of {known}"
                )
        return np.stack([self.nodal[name] for name in names], axis=2)


@dataclass(frozen=True, eq=False)
class ExodusSteps:
    """Nodal results that are read when they are asked for.

    ``times`` (T,) float64, ``names`` of the nodal variables.
    """

    path: PathLike
    times: Float
    names: tuple[str, ...]

    def values(self, name: str, step: int) -> Float:
        """(N,) float64 of a variable at a step. Raises InputError for a file that has changed."""
        return _guarded_call(self.path, lambda: self._values(name, step))

    def _values(self, name: str, step: int) -> Float:
        number = self.names.index(name)
        # mapped: only the pages of this step are read
        with _variables(self.path, mapped=True) as (variables, _):
            if "vals_nod_var" in variables:
                return _native(variables["vals_nod_var"][step, number]).astype(np.float64)
            return _native(variables[f"vals_nod_var{number + 1}"][step]).astype(np.float64)


def read_exodus(path: PathLike) -> Mesh:
    """The mesh: element blocks as cell sets, node sets, side sets as face sets.

    Sets without a name are called ``block_<id>``, ``nodeset_<id>``, ``sideset_<id>``. Sides of
    blocks that aren't solids are left out. Raises InputError: not an Exodus file, cut off, no
    solid elements, an element type that isn't known.
    """
    return _guarded(path, _mesh, results=False)


def read_exodus_fields(path: PathLike) -> ExodusFields:
    """Times, nodal variables and information records. Raises InputError as ``read_exodus``."""
    return _guarded(path, _fields)


def read_exodus_steps(path: PathLike) -> ExodusSteps:
    """Times and names of the nodal variables. Raises InputError as ``read_exodus``."""

    def steps(content: _Content) -> ExodusSteps:
        names = _strings(content.arrays["name_nod_var"]) if _has_nodal(content) else []
        return ExodusSteps(path, _times(content), tuple(names))

    return _guarded(path, steps, results=False)


@dataclass(frozen=True, eq=False)
class _Content:
    """Variables of the file as plain arrays, and the element type of each block's connectivity."""

    path: str
    arrays: Mapping[str, npt.NDArray[Any]]
    element_types: Mapping[str, str]

    def array(self, name: str) -> npt.NDArray[Any]:
        if name not in self.arrays:
            raise InputError(f"{self.path}: not a complete Exodus file; got no variable {name!r}")
        return self.arrays[name]

    def names(self, name: str, ids: str, default: str, count: int) -> list[str]:
        given = _strings(self.arrays[name]) if name in self.arrays else []
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


def _guarded(path: PathLike, convert: Callable[[_Content], T], results: bool = True) -> T:
    return _guarded_call(path, lambda: convert(_content(path, results)))


def _guarded_call(path: PathLike, read: Callable[[], T]) -> T:
    try:
        return read()
    except InputError as error:
        text = str(error)
        raise InputError(text if text.startswith(str(path)) else f"{path}: {text}") from None
    except OSError as error:
        reason = error.strerror or str(error)
        raise InputError(f"{path}: can't be read ({reason}); expected an Exodus file") from None
    except _DAMAGE as error:
        # SciPy and h5py meet damage in many ways
        raise InputError(
            f"{path}: damaged or cut off ({type(error).__name__}: {error}); "
            "expected a complete Exodus file"
        ) from None


def _content(path: PathLike, results: bool) -> _Content:
    """The variables in memory; without ``results``, all but the values over time."""
    with _variables(path) as (variables, kinds):
        wanted = {
            name: one for name, one in variables.items() if results or not name.startswith("vals_")
        }
        return _Content(str(path), {name: _native(one[()]) for name, one in wanted.items()}, kinds)


@contextmanager
def _variables(
    path: PathLike, mapped: bool = False
) -> Iterator[tuple[dict[str, Any], dict[str, str]]]:
    """The file's variables, to be sliced, and the element type of each block's connectivity."""
    with Path(path).open("rb") as stream:
        magic = stream.read(8)
    if magic[:4] in (b"CDF\x01", b"CDF\x02"):
        with netcdf_file(os.fspath(path), "r", mmap=mapped) as file:
            kinds = {
                name: _text(one.elem_type)
                for name, one in file.variables.items()
                if name.startswith("connect") and hasattr(one, "elem_type")
            }
            data = {name: one.data for name, one in file.variables.items()}
            try:
                yield data, kinds
            finally:
                data.clear()  # nothing may point into the map when it is closed
    elif magic == b"\x89HDF\r\n\x1a\n":
        with h5py.File(path, "r") as file:
            sets = {name: one for name, one in file.items() if isinstance(one, h5py.Dataset)}
            kinds = {
                name: _text(one.attrs["elem_type"])
                for name, one in sets.items()
                if name.startswith("connect") and "elem_type" in one.attrs
            }
            yield sets, kinds
    else:
        raise InputError(
            f"{path}: not an Exodus file; got first bytes {magic!r}; expected netCDF "
            "(classic, 64-bit offset, or netCDF-4)"
        )


def _native(data: Any) -> npt.NDArray[Any]:
    array = np.asarray(data)
    return array.astype(array.dtype.newbyteorder("="))


def _text(value: Any) -> str:
    return value.decode("ascii", "replace") if isinstance(value, bytes) else str(value)


def _strings(letters: npt.NDArray[Any]) -> list[str]:
    # as bytes, for NumPy's strings hide the zero that ends a text (rubbish may follow it)
    rows = np.ascontiguousarray(letters).reshape(-1, letters.shape[-1])
    return [row.tobytes().split(b"\0")[0].decode("utf-8", "replace").strip() for row in rows]


def _points(content: _Content) -> Float:
    if "coord" in content.arrays:
        points = np.asarray(content.array("coord"), dtype=np.float64).T
    else:
        axes = [f"coord{axis}" for axis in "xyz" if f"coord{axis}" in content.arrays]
        if not axes:
            content.array("coordx")
        points = np.stack([content.array(axis).astype(np.float64) for axis in axes], axis=1)
    if points.ndim != 2 or points.shape[1] != 3:
        raise InputError(
            f"{content.path}: not a solid mesh; got {points.shape[-1]} coordinates per node; "
            "expected 3"
        )
    return points


def _mesh(content: _Content) -> Mesh:
    points = _points(content)
    connects = content.numbered("connect")
    names = content.names("eb_names", "eb_prop1", "block", len(connects))
    by_type: dict[str, list[Int]] = {}
    # element number of the file -> (our type, row inside the type); -1 for what isn't a solid
    kind_of: list[str | None] = []
    row_of: list[npt.NDArray[np.int64]] = []
    other: list[str] = []
    for connect in connects:
        nodes = content.array(connect)
        written = content.element_types.get(connect, "").upper()
        kind = _TYPE.get((written[:3], nodes.shape[1]))
        if kind is None:
            if written[:3] in {family for family, _ in _TYPE}:
                raise InputError(
                    f"{content.path}: {connect}: element type {written} with {nodes.shape[1]} "
                    f"nodes; expected one of {', '.join(sorted(set(_TYPE.values())))}"
                )
            other.append(written or "unnamed")
            kind_of.append(None)
            row_of.append(np.full(len(nodes), -1, dtype=np.int64))
            continue
        block = nodes.astype(np.int32) - 1
        if kind in _ORDER:
            block = block[:, _ORDER[kind]]
        first = sum(len(part) for part in by_type.get(kind, []))
        by_type.setdefault(kind, []).append(block)
        kind_of.append(kind)
        row_of.append(first + np.arange(len(block)))
    if not by_type:
        raise InputError(
            f"{content.path}: no solid elements; got {', '.join(sorted(set(other))) or 'none'}; "
            f"expected one of {', '.join(sorted(set(_TYPE.values())))}"
        )
    cells = {kind: np.concatenate(parts) for kind, parts in by_type.items()}
    first_of, count = {}, 0
    for kind, block in cells.items():
        first_of[kind] = count
        count += len(block)
    number_of = [
        rows if kind is None else rows + first_of[kind]
        for kind, rows in zip(kind_of, row_of, strict=True)
    ]
    cell_sets = {
        name: numbers.astype(np.int32)
        for name, kind, numbers in zip(names, kind_of, number_of, strict=True)
        if kind is not None
    }
    side_kind = np.repeat([kind or "" for kind in kind_of], [len(rows) for rows in row_of])
    return Mesh(
        points,
        cells,
        _node_sets(content),
        _face_sets(content, side_kind, np.concatenate(number_of)),
        cell_sets,
    )


def _node_sets(content: _Content) -> dict[str, Int]:
    lists = content.numbered("node_ns")
    ids = [int(name[len("node_ns") :]) for name in lists]
    names = content.names("ns_names", "ns_prop1", "nodeset", max(ids, default=0))
    return {
        names[number - 1]: np.unique(content.array(name)).astype(np.int32) - 1
        for name, number in zip(lists, ids, strict=True)
    }


def _face_sets(
    content: _Content, kinds: npt.NDArray[np.str_], cells: npt.NDArray[np.int64]
) -> dict[str, Int]:
    lists = content.numbered("elem_ss")
    ids = [int(name[len("elem_ss") :]) for name in lists]
    names = content.names("ss_names", "ss_prop1", "sideset", max(ids, default=0))
    found = {}
    for name, number in zip(lists, ids, strict=True):
        element = content.array(name).astype(np.int64) - 1
        side = content.array(f"side_ss{number}").astype(np.int64) - 1
        local = np.full(len(side), -1)
        for kind in np.unique(kinds[element]):
            if not kind:
                continue
            mine = kinds[element] == kind
            table = _local_faces(str(kind))
            if side[mine].min() < 0 or side[mine].max() >= len(table):
                raise InputError(
                    f"{content.path}: side_ss{number}: got side {side[mine].max() + 1}; "
                    f"expected 1 … {len(table)} for {kind}"
                )
            local[mine] = table[side[mine]]
        solid = local >= 0
        found[names[number - 1]] = np.stack([cells[element[solid]], local[solid]], axis=1).astype(
            np.int32
        )
    return found


def _local_faces(kind: str) -> npt.NDArray[np.int64]:
    """Our local face number for each Exodus side, matched by the face's corners."""
    cell = CELL_TYPES[kind]
    ours = [frozenset(int(node) for node in row if 0 <= node < cell.corners) for row in cell.faces]
    return np.array([ours.index(frozenset(side)) for side in _SIDES[kind[:3]]])


def _times(content: _Content) -> Float:
    return np.asarray(content.arrays.get("time_whole", np.zeros(0)), dtype=np.float64)


def _has_nodal(content: _Content) -> bool:
    return "name_nod_var" in content.arrays


def _fields(content: _Content) -> ExodusFields:
    times = _times(content)
    nodal: dict[str, Float] = {}
    if _has_nodal(content):
        for number, name in enumerate(_strings(content.array("name_nod_var")), start=1):
            if "vals_nod_var" in content.arrays:
                nodal[name] = content.array("vals_nod_var")[:, number - 1].astype(np.float64)
            else:
                nodal[name] = content.array(f"vals_nod_var{number}").astype(np.float64)
    info = tuple(_strings(content.arrays["info_records"])) if _has_info(content) else ()
    return ExodusFields(times, nodal, info)


def _has_info(content: _Content) -> bool:
    return "info_records" in content.arrays and content.arrays["info_records"].ndim == 2
