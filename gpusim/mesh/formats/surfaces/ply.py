"""Points and faces of PLY files: text, or binary of either order."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from gpusim.files.input_file import InputFile
from gpusim.mesh.formats.surfaces.formats import Surface, fail

__all__ = ["ply"]

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
    reader = _Text(file, start) if not order else _Binary(file, start, order)
    points = np.zeros((0, 3))
    faces: list[npt.NDArray[np.int64]] = []
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
            for row in lists[0]:
                if len(row) not in (3, 4):
                    fail(file, f"a face of {len(row)} corners; expected 3 or 4 (triangulate first)")
            faces += [np.append(row, -1)[:4].astype(np.int64) for row in lists[0]]
    return points, np.array(faces, dtype=np.int64).reshape(-1, 4)


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


class _Text:
    """Entries of a text file: one after another, whatever their lines."""

    def __init__(self, file: InputFile, start: int) -> None:
        self.file, self.words, self.at = file, file.data[start:].split(), 0

    def rows(self, element: _Element) -> dict[str, Any]:
        found: dict[str, list[Any]] = {name: [] for name, _, _ in element.properties}
        for _ in range(element.count):
            for name, _, counted in element.properties:
                size = int(self.take(1, whole=True)[0]) if counted else 1
                values = self.take(size, whole=bool(counted))
                found[name].append(values if counted else values[0])
        lists = {name for name, _, counted in element.properties if counted}
        return {n: rows if n in lists else np.array(rows) for n, rows in found.items()}

    def take(self, count: int, whole: bool = False) -> npt.NDArray[np.float64]:
        words = self.words[self.at : self.at + count]
        if count < 0 or len(words) != count:
            fail(self.file, f"ends before its numbers do: got {len(words)}; expected {count}")
        self.at += count
        try:
            values = np.array(words, dtype=np.float64)
        except ValueError as error:
            fail(self.file, f"{error}; expected numbers")
        if whole and not ((np.abs(values) < 2.0**53).all() and (values == np.rint(values)).all()):
            fail(self.file, f"got {values}; expected whole numbers")
        return values


class _Binary:
    def __init__(self, file: InputFile, start: int, order: str) -> None:
        self.file, self.at, self.order = file, start, order

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
                    sizes[name] = int(self.take(np.dtype(self.order + counted), 1)[0])
                    if sizes[name] < 0:
                        fail(self.file, f"a list of {sizes[name]} entries in {element.name}")
                self.take(np.dtype(self.order + kind), sizes.get(name, 1))
            rows = (len(self.file.data) - start) // (self.at - start)
            self.at = start
            table = self.table(element, min(rows, element.count - done), sizes)
            alike = np.ones(len(table[element.properties[0][0]]), dtype=bool)
            for name, size in sizes.items():
                alike &= table[f"{name} count"] == size
            count = len(alike) if alike.all() else int(np.argmin(alike))
            for name in found:
                found[name] += list(table[name][:count])
            self.at = start + count * self.width
            done += count
        return found

    def table(self, element: _Element, count: int, sizes: dict[str, int]) -> dict[str, Any]:
        fields: list[Any] = []
        for name, kind, counted in element.properties:
            if counted:
                fields += [(f"{name} count", self.order + counted),
                           (name, self.order + kind, (sizes[name],))]  # fmt: skip
            else:
                fields.append((name, self.order + kind))
        try:
            dtype = np.dtype(fields)
        except ValueError as error:
            fail(self.file, f"properties of {element.name}: {error}")
        self.width = dtype.itemsize
        rows = self.take(dtype, count)
        return {name: rows[name] for name in rows.dtype.names or ()}

    def take(self, dtype: np.dtype[Any], count: int) -> npt.NDArray[Any]:
        if self.at + count * dtype.itemsize > len(self.file.data):
            fail(self.file, f"byte {self.at}: ends before its {count} entries do: cut off")
        rows = np.frombuffer(self.file.data, dtype, count, self.at)
        self.at += count * dtype.itemsize
        return rows
