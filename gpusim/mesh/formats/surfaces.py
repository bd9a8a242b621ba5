"""Surfaces: faces without solids in STL, PLY, OBJ, OFF and glTF files.

Each format has a function that takes a file and returns points (P, 3) float64 and faces (F, 4)
int64 as they are written there, -1 as the last corner of a triangle. All refuse, with the line
where there are lines, what they don't know.

That of glTF is `gpusim.mesh.formats.gltf`.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from gpusim.arrays.array_types import Float, Int, Long
from gpusim.errors import InputError
from gpusim.files.input_file import InputFile, read_input
from gpusim.mesh.file_content.byte_source import ByteSource
from gpusim.mesh.file_content.text import fail, numbers, statements, whole_numbers
from gpusim.mesh.formats.gltf.primitives import gltf_faces
from gpusim.mesh.formats.obj import read_obj
from gpusim.mesh.polygons import check_corners, cut_polygons

Surface = tuple[Float, Long]


def stl(file: InputFile) -> Surface:
    """All solids of a text file, or the triangles of a binary one."""
    data = file.data
    count = int.from_bytes(data[80:84], "little")
    if len(data) == 84 + 50 * count:
        rows = np.frombuffer(data, np.uint8, offset=84).reshape(count, 50)
        corners = rows[:, 12:48].copy().view("<f4").astype(np.float64).reshape(-1, 3)
    elif data.lstrip()[:5].lower() == b"solid":
        corners = _stl_corners(file)
    else:
        fail(file, f"an STL of {len(data)} bytes; got {count} triangles, which need "
                   f"{84 + 50 * count}: cut off, or no STL")  # fmt: skip
    faces = np.arange(len(corners)).reshape(-1, 3)
    return corners, np.column_stack([faces, np.full(len(faces), -1)])


def _stl_corners(file: InputFile) -> Float:
    corners: list[Sequence[float]] = []
    solids, open_facet = 0, False
    number = 0
    for number, line in enumerate(file.data.decode("latin-1").splitlines(), start=1):
        words = line.split()
        word = words[0].lower() if words else ""
        if word == "vertex":
            corners.append(numbers(file, words[1:], 3, number))
        elif word in ("facet", "endfacet"):
            if open_facet == (word == "facet") or len(corners) % 3:
                fail(file, f"{word}; got {len(corners)} corners so far; expected 3 of each", number)
            open_facet = word == "facet"
        elif word in ("solid", "endsolid"):
            solids += 1 if word == "solid" else -1
        elif word not in ("", "outer", "endloop"):
            fail(file, f"got {word[:40]!r}; expected vertex, facet, solid …", number)
    if solids or open_facet:
        fail(file, "no endsolid: the file is cut off", number)
    return np.array(corners, dtype=np.float64).reshape(-1, 3)


def off(file: InputFile) -> Surface:
    """OFF and COFF (colours are passed over)."""
    lines = ((line, [first, *rest.split("#")[0].split()])
             for line, first, rest in statements(file, "OFF"))  # fmt: skip
    number, words = next(lines, (1, [""]))
    kind = words.pop(0)
    if kind not in ("OFF", "COFF"):
        fail(file, f"got {kind[:40]!r}; expected OFF or COFF", number)
    if not words:
        number, words = next(lines, (number, []))
    points, faces = whole_numbers(file, words[:2], 2, number)
    rows = list(lines)
    if min(points, faces) < 0 or len(rows) < points + faces:
        fail(file, f"{points} points and {faces} faces; got {len(rows)} lines", number)
    if len(rows) > points + faces:
        fail(file, "more lines than its counts say", rows[points + faces][0])
    # of a COFF with three or four numbers of colour
    widths = (3,) if kind == "OFF" else (6, 7)
    place = []
    for line, words in rows[:points]:
        count = len(words) if len(words) in widths else widths[-1]
        place.append(numbers(file, words, count, line)[:3])
    corners: list[int] = []
    sizes = []
    for line, words in rows[points:]:
        (size,) = whole_numbers(file, words[:1], 1, line)
        if size < 3:
            fail(file, f"a face of {size} corners; expected at least 3", line)
        corners += whole_numbers(file, words[1 : 1 + size], size, line)
        sizes.append(size)
    return _cut(file, np.array(place).reshape(-1, 3), corners, sizes)


def obj(file: InputFile) -> Surface:
    """Points and faces of all groups."""
    content = read_obj(file)
    return content.points, content.faces


def _cut(file: InputFile, points: Float, corners: npt.ArrayLike, sizes: Sequence[int]) -> Surface:
    """Of polygons one after another, with their numbers of corners."""
    place = np.asarray(corners, np.int64)
    rows, _ = cut_polygons(str(file.path), points, place, np.array(sizes, np.int64))
    return points, np.where(rows < 0, -1, place[rows])


_TYPES = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1", "short": "i2", "int16": "i2",
    "ushort": "u2", "uint16": "u2", "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4",
    "float": "f4", "float32": "f4", "double": "f8", "float64": "f8", "int64": "i8", "uint64": "u8",
}  # fmt: skip
_ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
_CORNERS = ("vertex_indices", "vertex_index")


@dataclass
class _Element:
    """Name and count; each property's name, type, and that of its count where it is a list."""

    name: str
    count: int
    properties: list[tuple[str, str, str]] = field(default_factory=list)


def ply(file: InputFile) -> Surface:
    """Points and faces; colours, normals, edges and other elements are passed over."""
    order, elements, start = _header(file)
    for element in elements:
        if element.name in ("tristrips", "multi_patch"):
            fail(file, f"got element {element.name}; expected faces")
    reader = _Entries(file, start, order)
    points = np.zeros((0, 3))
    corners: npt.ArrayLike = []
    sizes: list[int] = []
    for element in elements:
        if element.count > len(file.data):
            fail(
                file, f"{element.count} entries {element.name} in {len(file.data)} bytes: cut off?"
            )
        columns = reader.rows(element)
        if element.name == "vertex":
            lacking = [axis for axis in "xyz" if not isinstance(columns.get(axis), np.ndarray)]
            if lacking:
                fail(file, f"no property {', '.join(lacking)} of vertex; expected x, y, z")
            points = np.stack([columns[axis].astype(np.float64) for axis in "xyz"], axis=1)
        elif element.name == "face":
            lists = [columns[name] for name in _CORNERS if name in columns]
            if not lists:
                fail(file, "no property list vertex_indices of face; expected one")
            corners = np.concatenate([np.zeros(0), *lists[0]])
            wrong = ~((np.abs(corners) < 2.0**53) & (corners == np.rint(corners)))
            if wrong.any():
                fail(file, f"a face names point {corners[wrong][0]:g}; expected whole numbers")
            sizes = [len(row) for row in lists[0]]
            if min(sizes, default=3) < 3:
                fail(file, f"a face of {min(sizes)} corners; expected at least 3")
    return _cut(file, points, corners, sizes)


def _header(file: InputFile) -> tuple[str, list[_Element], int]:
    mark = file.data.find(b"end_header", 0, 100_000)
    if not file.data.startswith(b"ply") or mark < 0:
        fail(file, f"got {file.data[:12]!r}; expected ply … end_header")
    order: str | None = None
    elements: list[_Element] = []
    for number, line in enumerate(file.data[:mark].decode("latin-1").splitlines(), start=1):
        words = line.split()
        if not words or words[0] in ("ply", "comment", "obj_info"):
            continue
        if words[0] == "format" and len(words) == 3 and words[1] in _ORDERS and words[2] == "1.0":
            order = _ORDERS[words[1]]
        elif words[0] == "element" and len(words) == 3 and words[2].isdigit():
            elements.append(_Element(words[1], int(words[2][:18])))
        elif words[0] == "property" and elements and len(words) == 3 and words[1] in _TYPES:
            elements[-1].properties.append((words[2], _TYPES[words[1]], ""))
        elif (
            words[:2] == ["property", "list"] and elements and len(words) == 5
            and {words[2], words[3]} <= _TYPES.keys() and "f" not in _TYPES[words[2]]
        ):  # fmt: skip
            elements[-1].properties.append((words[4], _TYPES[words[3]], _TYPES[words[2]]))
        else:
            fail(file, f"got {line.strip()[:60]!r}; expected format, element or property", number)
    for element in elements:
        names = [name for name, _, _ in element.properties]
        if len(set(names)) < len(names):
            fail(file, f"a property of {element.name} is there twice; got {', '.join(names)[:80]}")
    if len({element.name for element in elements}) < len(elements):
        fail(file, "an element is there twice")
    if order is None:
        fail(file, "no format; expected ascii, binary_little_endian or binary_big_endian 1.0")
    end = file.data.find(b"\n", mark)
    return order, elements, len(file.data) if end < 0 else end + 1


class _Entries(ByteSource):
    """Entries of elements from here on. Those of a text, whatever its lines, become float64."""

    def __init__(self, file: InputFile, start: int, order: str) -> None:
        super().__init__(file, start)
        self.order, self.text = order, not order
        if self.text:
            try:
                self.data = np.array(file.data[start:].split(), np.float64).tobytes()
            except ValueError as error:
                fail(file, f"{error}; expected numbers")
            self.at = 0

    @property
    def place(self) -> str:
        return f"number {self.at // 8} below its header" if self.text else super().place

    def kind(self, written: str) -> str:
        return "f8" if self.text else self.order + written

    def rows(self, element: _Element) -> dict[str, Any]:
        if not any(counted for _, _, counted in element.properties):
            return self.table(element, element.count, {})
        found: dict[str, list[Any]] = {name: [] for name, _, _ in element.properties}
        done = 0
        while done < element.count:
            # most files have lists of one length only: try as many rows as are like this one
            sizes, start = {}, self.at
            for name, kind, counted in element.properties:
                if counted:
                    size = float(self.take(self.kind(counted), 1)[0])
                    if not (size >= 0.0 and size.is_integer()):
                        self.fail(f"a list of {size:g} entries in {element.name}")
                    sizes[name] = int(size)
                self.take(self.kind(kind), sizes.get(name, 1))
            room = (len(self.data) - start) // (self.at - start)
            self.at = start
            table = self.table(element, min(room, element.count - done), sizes)
            alike = np.ones(len(table[element.properties[0][0]]), dtype=bool)
            for name, length in sizes.items():
                alike &= table[f"{name} count"] == length
            count = len(alike) if alike.all() else int(np.argmin(alike))
            for name in found:
                found[name] += list(table[name][:count])
            self.at = start + count * self.width
            done += count
        lists = {name for name, _, counted in element.properties if counted}
        return {n: rows if n in lists else np.array(rows) for n, rows in found.items()}

    def table(self, element: _Element, count: int, sizes: dict[str, int]) -> dict[str, Any]:
        fields: list[Any] = []
        for name, kind, counted in element.properties:
            if counted:
                fields += [(f"{name} count", self.kind(counted)),
                           (name, self.kind(kind), (sizes[name],))]  # fmt: skip
            else:
                fields.append((name, self.kind(kind)))
        try:
            dtype = np.dtype(fields)
        except ValueError as error:
            self.fail(f"properties of {element.name}: {error}")
        self.width = dtype.itemsize
        rows = self.take(dtype, count)
        return {name: rows[name] for name in rows.dtype.names or ()}


_FORMATS = {".stl": stl, ".ply": ply, ".obj": obj, ".off": off, ".glb": gltf_faces,
            ".gltf": gltf_faces}  # fmt: skip


def read_surface(
    path: str | os.PathLike[str] | InputFile,
) -> tuple[Float, Int]:
    """Points (P, 3) and faces (F, 4), the last column -1 for triangles; any unit of length.

    Points at the same place (an STL repeats them for every triangle) become one; faces that are
    no faces then are left out. Faces of more than four corners, and those with a dent, become
    triangles. Raises InputError, naming the file, and the line of a text: what is damaged, and
    whatever the format has that would change the surface and isn't read.

    Examples
    --------
    >>> cube = gs.mesh.box(size=(1, 1, 1), divisions=(1, 1, 1))
    >>> gs.export.write_stl("cube.stl", cube.points, gs.mesh.boundary_faces(cube).nodes).name
    'cube.stl'
    >>> points, faces = gs.mesh.read_surface("cube.stl")
    >>> points.shape, faces.shape
    ((8, 3), (12, 4))
    """
    name = path.path if isinstance(path, InputFile) else Path(path)
    kind = _FORMATS.get(name.suffix.lower())
    if kind is None:
        raise InputError(f"{name}: got {name.suffix!r}; expected one of {', '.join(_FORMATS)}")
    file = read_input(path, "a file of faces")
    return welded(str(name), *kind(file))[:2]


def welded(where: str, points: Float, faces: Long) -> tuple[Float, Int, Long]:
    """Points at the same place as one, faces that have an area, and which (F,) of all each is."""
    if not len(faces):
        raise InputError(f"{where}: no triangles or quadrilaterals in space; expected some")
    check_corners(where, points, faces[faces != -1])
    points, number = np.unique(points, axis=0, return_inverse=True)
    faces = np.where(faces < 0, -1, number.reshape(-1)[np.maximum(faces, 0)])
    last = np.where(faces[:, 3] < 0, faces[:, 2], faces[:, 3])
    a, b, c, d = (points[faces[:, 0]], points[faces[:, 1]], points[faces[:, 2]], points[last])
    flat = ~(np.linalg.norm(np.cross(c - a, np.where((faces[:, 3] < 0)[:, None], b - a, d - b)),
                            axis=1) > 0.0)  # fmt: skip
    if flat.all():
        raise InputError(f"{where}: {len(flat)} faces without area; expected some with")
    return points, faces[~flat].astype(np.int32), np.flatnonzero(~flat)
