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

from gpusim.errors import InputError
from gpusim.files.input_file import InputFile, read_input
from gpusim.mesh.cell_types import CELL_TYPES
from gpusim.mesh.formats.exodus.variables import (
    ExodusContent,
    exodus_content,
    guarded,
    native,
    strings,
)
from gpusim.mesh.mesh import Mesh

__all__ = [
    "ExodusFields",
    "ExodusSteps",
    "read_exodus",
    "read_exodus_fields",
    "read_exodus_steps",
]

PathLike = str | os.PathLike[str] | InputFile
Float = npt.NDArray[np.float64]
Int = npt.NDArray[np.int32]

# Family and nodes of an element -> our type; Exodus writes "HEX", "HEX8", "TETRA10", "TET4", ...
_TYPE = {
    ("HEX", 8): "hex8", ("HEX", 20): "hex20", ("HEX", 27): "hex27",
    ("TET", 4): "tet4", ("TET", 10): "tet10",
    ("WED", 6): "wedge6", ("WED", 15): "wedge15",
    ("PYR", 5): "pyramid5", ("PYR", 13): "pyramid13",
}  # fmt: skip

# Elements that are no solids: their blocks are left out. Any other kind is refused.
_FLAT = (
    "SHE", "QUA", "TRI", "BAR", "BEA", "TRU", "EDG", "SPH", "CIR", "NOD", "POI", "LIN", "NUL",
    "ROD",
)  # fmt: skip

# Exodus counts vertical edges before top edges, and faces of a hex27 after its centre.
_ORDER = {
    "hex20": [*range(12), 16, 17, 18, 19, 12, 13, 14, 15],
    "hex27": [*range(12), 16, 17, 18, 19, 12, 13, 14, 15, 23, 24, 25, 26, 21, 22, 20],
    "wedge15": [*range(9), 12, 13, 14, 9, 10, 11],
}

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


class ExodusSteps:
    """Nodal results, unpacked when they are asked for.

    ``times`` (T,) float64, ``names`` of the nodal variables.
    """

    def __init__(self, content: ExodusContent) -> None:
        self._content = content
        self.times = _times(content)
        self.names = tuple(strings(content.arrays["name_nod_var"]) if _has_nodal(content) else ())
        self._kept: dict[str, npt.NDArray[Any]] = {}

    def values(self, names: Sequence[str], step: int) -> Float:
        """(N, names) float64 of variables at a step. Raises InputError for damage."""

        def read() -> Float:
            new = [name for name in names if name not in self._kept]
            if new:
                found = self._content.nodal([self.names.index(name) for name in new])
                self._kept.update(zip(new, found, strict=True))
            columns = [native(self._kept[name][step]) for name in names]
            return np.stack(columns, axis=1).astype(np.float64)

        return guarded(self._content.file, read)


def read_exodus(path: PathLike) -> Mesh:
    """The mesh: element blocks as cell sets, node sets, side sets as face sets.

    Sets without a name are called ``block_<id>``, ``nodeset_<id>``, ``sideset_<id>``. Sides of
    blocks that aren't solids are left out. Raises InputError: not an Exodus file, cut off, no
    solid elements, an element type that isn't known.
    """
    file = read_input(path, "an Exodus file")
    return guarded(file, lambda: _mesh(exodus_content(file)))


def read_exodus_fields(path: PathLike) -> ExodusFields:
    """Times, nodal variables and information records. Raises InputError as ``read_exodus``."""
    file = read_input(path, "an Exodus file")
    return guarded(file, lambda: _fields(exodus_content(file)))


def read_exodus_steps(path: PathLike) -> tuple[Mesh, ExodusSteps]:
    """The mesh, and its nodal variables over time. Raises InputError as ``read_exodus``."""
    file = read_input(path, "an Exodus file")

    def both() -> tuple[Mesh, ExodusSteps]:
        content = exodus_content(file)
        return _mesh(content), ExodusSteps(content)

    return guarded(file, both)


def _points(content: ExodusContent) -> Float:
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


def _mesh(content: ExodusContent) -> Mesh:
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
            if written and not written.startswith(_FLAT):
                raise InputError(
                    f"{content.path}: {connect}: elements of type {written[:40]}; expected one of "
                    f"{', '.join(sorted(set(_TYPE.values())))}"
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


def _node_sets(content: ExodusContent) -> dict[str, Int]:
    lists = content.numbered("node_ns")
    ids = [int(name[len("node_ns") :]) for name in lists]
    names = content.names("ns_names", "ns_prop1", "nodeset", max(ids, default=0))
    return {
        names[number - 1]: np.unique(content.array(name)).astype(np.int32) - 1
        for name, number in zip(lists, ids, strict=True)
    }


def _face_sets(
    content: ExodusContent, kinds: npt.NDArray[np.str_], cells: npt.NDArray[np.int64]
) -> dict[str, Int]:
    lists = content.numbered("elem_ss")
    ids = [int(name[len("elem_ss") :]) for name in lists]
    names = content.names("ss_names", "ss_prop1", "sideset", max(ids, default=0))
    found = {}
    for name, number in zip(lists, ids, strict=True):
        element = content.array(name).astype(np.int64) - 1
        side = content.array(f"side_ss{number}").astype(np.int64) - 1
        if len(element) and not (0 <= element.min() and element.max() < len(kinds)):
            raise InputError(
                f"{content.path}: {name}: got elements {element.min() + 1} to {element.max() + 1}; "
                f"expected 1 to {len(kinds)}"
            )
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


def _times(content: ExodusContent) -> Float:
    return np.asarray(content.arrays.get("time_whole", np.zeros(0)), dtype=np.float64)


def _has_nodal(content: ExodusContent) -> bool:
    return "name_nod_var" in content.arrays


def _fields(content: ExodusContent) -> ExodusFields:
    times = _times(content)
    nodal: dict[str, Float] = {}
    if _has_nodal(content):
        names = strings(content.array("name_nod_var"))
        for name, values in zip(names, content.nodal(range(len(names))), strict=True):
            nodal[name] = native(values).astype(np.float64)
    info = tuple(strings(content.arrays["info_records"])) if _has_info(content) else ()
    return ExodusFields(times, nodal, info)


def _has_info(content: ExodusContent) -> bool:
    return "info_records" in content.arrays and content.arrays["info_records"].ndim == 2
