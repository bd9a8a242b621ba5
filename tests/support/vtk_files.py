"""VTK's files, written by hand from the format's description: every layout that others write."""

from __future__ import annotations

import base64
import lzma
import zlib
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

BRICK = np.array([[0, 0, 0], [3, 0, 0], [3, 2, 0], [0, 2, 0],
                  [0, 0, 20], [3, 0, 20], [3, 2, 20], [0, 2, 20]], float)  # fmt: skip
_NAMES = {"f": "Float", "i": "Int", "u": "UInt"}
_PACK = {"vtkZLibDataCompressor": zlib.compress, "vtkLZMADataCompressor": lzma.compress}


@dataclass
class Vtu:
    """How a .vtu is written; ``text`` gives its bytes."""

    layout: str = "ascii"  # binary, raw, base64
    order: str = "<"
    header: str = "u4"
    compressor: str = ""
    version: str = "1.0"
    joined: bool = True  # header and numbers in one piece of base64
    block: int = 40
    extra: str = ""

    def text(self, pieces: list[dict[str, Any]]) -> bytes:
        self.appended = b""
        attributes = f'version="{self.version}" type="UnstructuredGrid" '
        attributes += f'byte_order="{"LittleEndian" if self.order == "<" else "BigEndian"}" '
        attributes += f'header_type="UInt{8 * int(self.header[1])}"'
        if self.compressor:
            attributes += f' compressor="{self.compressor}"'
        body = "".join(map(self._piece, pieces))
        head = f"<VTKFile {attributes}><UnstructuredGrid>{self.extra}{body}</UnstructuredGrid>"
        if not self.appended:
            return f'<?xml version="1.0"?>\n{head}</VTKFile>\n'.encode()
        start = f'{head}\n<AppendedData encoding="{self.layout}">\n  _'
        return start.encode() + self.appended + b"\n</AppendedData></VTKFile>\n"

    def _piece(self, piece: dict[str, Any]) -> str:
        points, data = piece["points"], piece.get("data", {})
        cells = np.asarray(piece["cells"])
        width = cells.shape[1]
        kind = {8: 12, 4: 10}[width]
        parts = {
            "PointData": "".join(self._array(name, values) for name, values in data.items()),
            "CellData": "".join(
                self._array(name, values) for name, values in piece.get("cell_data", {}).items()
            ),
            "Points": self._array("Points", points.astype(np.float32)),
            "Cells": self._array("connectivity", cells.ravel())
            + self._array("offsets", width * np.arange(1, len(cells) + 1, dtype=np.int32))
            + self._array("types", np.full(len(cells), kind, np.uint8)),
        }
        inner = "".join(f"<{name}>{text}</{name}>" for name, text in parts.items())
        counts = f'NumberOfPoints="{len(points)}" NumberOfCells="{len(cells)}"'
        return f"<Piece {counts}>{inner}</Piece>"

    def _array(self, name: str, values: npt.NDArray[Any]) -> str:
        kind = f"{_NAMES[values.dtype.kind]}{8 * values.dtype.itemsize}"
        columns = values.shape[1] if values.ndim == 2 else 1
        head = f'<DataArray Name="{name}" type="{kind}" NumberOfComponents="{columns}" '
        if self.layout == "ascii":
            words = " ".join(repr(x) for x in values.ravel().tolist())
            return f'{head} format="ascii">\n{words}\n</DataArray>'
        data = values.astype(values.dtype.newbyteorder(self.order)).tobytes()
        packed = self._packed(data)
        if self.layout == "binary":
            return f'{head} format="binary">\n{packed.decode()}\n</DataArray>'
        tag = f'{head} format="appended" offset="{len(self.appended)}"/>'
        self.appended += packed
        return tag

    def _packed(self, data: bytes) -> bytes:
        def numbers(*values: int) -> bytes:
            return np.array(values, self.order + self.header).tobytes()

        encode = bytes if self.layout == "raw" else base64.b64encode
        if not self.compressor:
            head = numbers(len(data))
            return encode(head + data) if self.joined else encode(head) + encode(data)
        blocks = [data[k : k + self.block] for k in range(0, len(data), self.block)]
        pack = [_PACK[self.compressor](block) for block in blocks]
        last = len(blocks[-1]) % self.block
        head = numbers(len(blocks), self.block, last, *map(len, pack))
        return encode(head) + encode(b"".join(pack))


def legacy(
    points: npt.NDArray[Any], cells: npt.NDArray[Any], binary: bool, version: str, field: bool
) -> bytes:
    """A legacy .vtk of bricks; version 5.1 has OFFSETS and CONNECTIVITY."""

    def numbers(values: Any, layout: str) -> bytes:
        array = np.asarray(values)
        if binary:
            return array.astype(layout).tobytes() + b"\n"
        return " ".join(repr(x) for x in array.ravel().tolist()).encode() + b"\n"

    count = len(cells)
    out = f"# vtk DataFile Version {version}\n".encode() + b"\xff\xfe no UTF-8\n"
    out += (b"BINARY" if binary else b"ASCII") + b"\nDATASET UNSTRUCTURED_GRID\n"
    if field:
        out += b"FIELD FieldData 2\nTIME 1 1 double\n" + numbers([0.5], ">f8")
        out += b"title 1 2 string\n"
        out += b"\xc3abc\xc0" + b"\n" if binary else b"abc\n\n"
    out += f"POINTS {len(points)} double\n".encode() + numbers(points, ">f8")
    if version == "5.1":
        out += b"METADATA\nINFORMATION 0\n\n"
        out += f"CELLS {count + 1} {cells.size}\nOFFSETS vtktypeint64\n".encode()
        out += numbers(8 * np.arange(count + 1), ">i8") + b"CONNECTIVITY vtktypeint64\n"
        out += numbers(cells, ">i8")
    else:
        rows = np.column_stack([np.full(count, 8), cells])
        out += f"CELLS {count} {rows.size}\n".encode() + numbers(rows, ">i4")
    out += f"CELL_TYPES {count}\n".encode() + numbers(np.full(count, 12), ">i4")
    out += f"POINT_DATA {len(points)}\nSCALARS T double\nLOOKUP_TABLE default\n".encode()
    return out + numbers(points[:, 0], ">f8")
