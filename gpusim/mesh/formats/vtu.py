"""VTK's unstructured grids in XML (.vtu): all pieces, one after another, as VTK appends them.

Arrays are text, base64 or raw, inline or appended, compressed or not. Format: "VTK File Formats",
docs.vtk.org, XML file formats.
"""

from __future__ import annotations

import base64
import binascii
import lzma
import re
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, NoReturn
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np
import numpy.typing as npt

from gpusim.arrays.array_types import Bool, Float, Long
from gpusim.errors import InputError
from gpusim.files.input_file import InputFile
from gpusim.mesh.file_content.cell_blocks import RawBlock, RawMesh
from gpusim.mesh.formats.vtk import vtk_blocks
from gpusim.parallel.machine import memory_limit

Array = npt.NDArray[Any]

_TYPES = {
    "Int8": "i1", "UInt8": "u1", "Int16": "i2", "UInt16": "u2", "Int32": "i4", "UInt32": "u4",
    "Int64": "i8", "UInt64": "u8", "Float32": "f4", "Float64": "f8", "vtkIdType": "i8",
}  # fmt: skip
_COMPRESSORS = ("", "vtkZLibDataCompressor", "vtkLZMADataCompressor")


class VtuArrays:
    """A parsed file: ``root``, and the arrays that its elements stand for."""

    def __init__(self, file: InputFile) -> None:
        self.source = str(file.path)
        self.root, self.appended, self.raw = self._parse(file.data)
        attributes = self.root.attrib
        order = attributes.get("byte_order", "LittleEndian")
        if order not in ("LittleEndian", "BigEndian"):
            self.fail(f"byte_order {order!r}; expected LittleEndian or BigEndian")
        self.order = "<" if order == "LittleEndian" else ">"
        header = attributes.get("header_type", "UInt32")
        if header not in ("UInt32", "UInt64"):
            self.fail(f"header_type {header!r}; expected UInt32 or UInt64")
        self.header = np.dtype(self.order + _TYPES[header])
        self.compressor = attributes.get("compressor", "")
        if self.compressor not in _COMPRESSORS:
            self.fail(
                f"compressor {self.compressor!r}; expected none, vtkZLibDataCompressor or "
                "vtkLZMADataCompressor (ParaView: Save Data, Compressor Type)"
            )

    def fail(self, problem: str) -> NoReturn:
        raise InputError(f"{self.source}: {problem[:400]}")

    def _parse(self, data: bytes) -> tuple[ElementTree.Element, bytes, bool]:
        """The tree, what is appended behind it, and whether that is raw."""
        if b"<!DOCTYPE" in data[:4096] or b"<!ENTITY" in data[:4096]:
            self.fail("an XML file with definitions of its own (DOCTYPE); expected VTK's XML")
        mark = re.search(rb"<AppendedData([^>]*)>\s*_", data)
        tree = data if mark is None else data[: mark.end()] + b"</AppendedData></VTKFile>"
        try:
            root = ElementTree.fromstring(tree)
        except (ElementTree.ParseError, ValueError, LookupError) as error:
            self.fail(f"can't be read as vtu: the file is cut off, damaged, or no XML; got {error}")
        if root.tag != "VTKFile":
            self.fail(f"not a VTK file; got <{root.tag}>; expected <VTKFile>")
        if mark is None:
            return root, b"", False
        end = data.rfind(b"</AppendedData")
        if end < mark.end():
            self.fail("no </AppendedData>: the file is cut off")
        encoding = re.search(rb"encoding\s*=\s*[\"'](\w+)", mark[1])
        if encoding is None or encoding[1] not in (b"raw", b"base64"):
            self.fail(f"<AppendedData{mark[1].decode('ascii', 'replace')}>; expected raw or base64")
        return root, data[mark.end() : end], encoding[1] == b"raw"

    def count(self, element: ElementTree.Element, name: str, otherwise: str | None = None) -> int:
        """An attribute that is a count."""
        text = element.get(name, otherwise)
        if text is None or not re.fullmatch(r"\d{1,15}", text.strip()):
            self.fail(f"<{element.tag}>: {name}; got {text!r}; expected a count")
        return int(text)

    def values(self, element: ElementTree.Element, rows: int | None, where: str) -> Array:
        """The numbers of a <DataArray>: (rows,) or (rows, components), any native type.

        ``rows`` None: as many as there are. Raises InputError, naming array and piece.
        """
        what = f"{where}, array {element.get('Name', element.get('type', ''))!r}"
        kind = element.get("type", "")
        if kind not in _TYPES:
            self.fail(f"{what}: type {kind!r}; expected one of {', '.join(_TYPES)}")
        columns = self.count(element, "NumberOfComponents", "1") or 1
        dtype = np.dtype(self.order + _TYPES[kind])
        layout = element.get("format", "ascii").lower()
        try:
            if layout == "ascii":
                words = (element.text or "").split()
                flat = np.array(words, dtype=np.float64 if dtype.kind == "f" else dtype)
            elif layout in ("binary", "appended"):
                data = self._bytes(element, layout, what)
                if len(data) % dtype.itemsize:
                    self.fail(f"{what}: got {len(data)} bytes; expected a multiple of "
                              f"{dtype.itemsize}")  # fmt: skip
                flat = np.frombuffer(data, dtype)
            else:
                self.fail(f"{what}: format {layout!r}; expected ascii, binary or appended")
        except (ValueError, OverflowError, EOFError, binascii.Error, zlib.error,
                lzma.LZMAError) as error:  # fmt: skip
            if isinstance(error, InputError):
                raise
            self.fail(f"{what}: damaged or cut off; got {error}")
        except MemoryError:
            self.fail(f"{what}: larger than the memory")
        if len(flat) % columns or (rows is not None and len(flat) != rows * columns):
            self.fail(f"{what}: got {len(flat)} numbers; expected {rows} x {columns}")
        flat = flat.astype(flat.dtype.newbyteorder("="))
        return flat if columns == 1 else flat.reshape(-1, columns)

    def _bytes(self, element: ElementTree.Element, layout: str, what: str) -> bytes:
        raw = False
        if layout == "binary":
            data = (element.text or "").strip().encode("ascii", "replace")
        else:
            offset = self.count(element, "offset")
            if offset >= len(self.appended):
                self.fail(f"{what}: offset {offset}; got {len(self.appended)} appended bytes")
            data, raw = self.appended[offset:], self.raw
        return self._unpacked(_Encoded(data, raw), what)

    def _unpacked(self, data: _Encoded, what: str) -> bytes:
        width = self.header.itemsize
        if not self.compressor:
            (size,) = np.frombuffer(data.peek(width), self.header)
            return data.after_header(width, int(size))
        blocks = int(np.frombuffer(data.peek(width), self.header)[0])
        if blocks == 0:
            return b""
        if blocks * width > len(data.data):
            self.fail(f"{what}: {blocks} compressed blocks in {len(data.data)} bytes: damaged?")
        sizes = np.frombuffer(data.take((3 + blocks) * width), self.header)
        full, last = int(sizes[1]), int(sizes[2])
        if blocks * full > memory_limit():
            self.fail(f"{what}: claims {blocks * full / 1e9:.3g} GB, more than the memory")
        ends = np.cumsum(sizes[3:].astype(object))
        packed = data.take(int(ends[-1]))
        unpacked = []
        for number, end in enumerate(ends):
            size = last if number == blocks - 1 and last else full
            part = packed[end - int(sizes[3 + number]) : end]
            unpacked.append(self._block(part, size))
            if len(unpacked[-1]) != size:
                self.fail(f"{what}: block {number + 1} of {blocks} isn't of {size} bytes: damaged?")
        return b"".join(unpacked)

    def _block(self, part: bytes, size: int) -> bytes:
        """No more than ``size`` bytes, whatever the block would become."""
        if self.compressor == "vtkZLibDataCompressor":
            return zlib.decompressobj().decompress(part, size) if size else b""
        return lzma.LZMADecompressor().decompress(part, size)


class _Encoded:
    """Bytes that are base64 in pieces, or raw."""

    def __init__(self, data: bytes, raw: bool) -> None:
        self.data, self.raw, self.at = data, raw, 0

    def peek(self, size: int) -> bytes:
        """The next ``size`` bytes. Raises ValueError where there are fewer."""
        width = size if self.raw else -(-size // 3) * 4
        if size < 0 or self.at + width > len(self.data):
            raise ValueError(f"it ends before its {size} bytes do")
        part = self.data[self.at : self.at + width]
        part = part if self.raw else base64.b64decode(part, validate=True)[:size]
        if len(part) != size:
            raise ValueError(f"it ends before its {size} bytes do")
        return part

    def take(self, size: int) -> bytes:
        """The next ``size`` bytes, encoded by themselves."""
        part = self.peek(size)
        self.at += size if self.raw else -(-size // 3) * 4
        return part

    def after_header(self, width: int, size: int) -> bytes:
        """``size`` bytes behind a header, which is encoded with them or by itself."""
        head = self.data[self.at : self.at + -(-width // 3) * 4]
        if self.raw or head.endswith(b"=" * (-width % 3)):
            self.take(width)
            return self.take(size)
        return self.take(width + size)[width:]


# what a cell's or a point's ``vtkGhostType`` says: there twice, or not to be seen
_GHOST_CELLS = 1 | 32
_PARTS = {
    "UnstructuredGrid": ("FieldData", "Piece"),
    "Piece": ("Points", "Cells", "PointData", "CellData", "FieldData"),
}


@dataclass(frozen=True, eq=False)
class _Piece:
    where: str
    element: Element
    points: int
    cells: int


class VtuFile:
    """A .vtu file; its arrays are unpacked when they are asked for.

    Raises InputError, naming the file: not XML, another kind of dataset, another version.
    """

    def __init__(self, file: InputFile) -> None:
        self.arrays = arrays = VtuArrays(file)
        root = arrays.root
        kind, version = root.get("type", ""), root.get("version", "0.1")
        if kind != "UnstructuredGrid":
            arrays.fail(
                f"a VTK file of type {kind!r}; expected UnstructuredGrid: one grid in one file "
                "(of parallel and multi-block files, save the merged blocks as .vtu)"
            )
        if not re.fullmatch(r"[0-2]\.\d+", version):
            arrays.fail(f"VTK file version {version!r}; expected 0.1 to 2.x")
        grids = root.findall("UnstructuredGrid")
        pieces = [piece for grid in grids for piece in grid.findall("Piece")]
        if len(grids) != 1 or not pieces:
            arrays.fail("no <Piece> in an <UnstructuredGrid>; expected one or more")
        for parent in (grids[0], *pieces):
            for part in parent:
                if part.tag not in _PARTS[parent.tag]:
                    expected = ", ".join(_PARTS[parent.tag])
                    arrays.fail(f"got <{part.tag}> in <{parent.tag}>; expected {expected}")
        self.pieces = [
            _Piece(
                f"piece {number}" if len(pieces) > 1 else "the grid",
                piece,
                arrays.count(piece, "NumberOfPoints"),
                arrays.count(piece, "NumberOfCells"),
            )
            for number, piece in enumerate(pieces, start=1)
        ]

    def mesh(self) -> RawMesh:
        """The points and cells of all pieces; cells that are ghosts are left out."""
        points: list[Float] = []
        blocks: list[RawBlock] = []
        first = 0
        for piece in self.pieces:
            own = self._points(piece)
            points.append(own)
            blocks += [
                RawBlock(block.kind, block.nodes + first) for block in self._cells(piece, own)
            ]
            first += len(own)
        return RawMesh(np.concatenate(points), tuple(blocks))

    def point_data(self) -> dict[str, tuple[str, int]]:
        """Arrays of numbers that every piece has: name -> its type and components."""
        found: dict[str, tuple[str, int]] | None = None
        for piece in self.pieces:
            here = {
                array.get("Name", ""): (
                    array.get("type", ""),
                    self.arrays.count(array, "NumberOfComponents", "1"),
                )
                for array in piece.element.iterfind("PointData/DataArray")
                if array.get("type") != "String"
            }
            found = here if found is None else {k: v for k, v in found.items() if k in here}
        return found or {}

    def point_values(self, name: str) -> npt.NDArray[Any]:
        """The values of a point array at the points of all pieces, (N,) or (N, components)."""
        parts = []
        for piece in self.pieces:
            for array in piece.element.iterfind("PointData/DataArray"):
                if array.get("Name", "") == name:
                    parts.append(self.arrays.values(array, piece.points, piece.where))
                    break
        if len({part.shape[1:] for part in parts}) > 1:
            self.arrays.fail(f"array {name!r} has other numbers of components in other pieces")
        return np.concatenate(parts)

    def _points(self, piece: _Piece) -> Float:
        arrays = piece.element.findall("Points/DataArray")
        if len(arrays) != 1:
            self.arrays.fail(f"{piece.where}: {len(arrays)} arrays of points; expected one")
        points = self.arrays.values(arrays[0], piece.points, piece.where).astype(np.float64)
        if points.ndim != 2 or points.shape[1] != 3:
            self.arrays.fail(f"{piece.where}: points of shape {points.shape}; expected (N, 3)")
        return points

    def _cells(self, piece: _Piece, points: Float) -> Iterator[RawBlock]:
        lists = {
            array.get("Name", ""): array for array in piece.element.iterfind("Cells/DataArray")
        }
        missing = [name for name in ("connectivity", "offsets", "types") if name not in lists]
        if missing and piece.cells:
            self.arrays.fail(f"{piece.where}: no array {', '.join(missing)} of cells")
        if not piece.cells:
            return
        ends = self._whole(piece, lists["offsets"], piece.cells)
        types = self._whole(piece, lists["types"], piece.cells)
        nodes = self._whole(piece, lists["connectivity"], None)
        source = f"{self.arrays.source}: {piece.where}"
        kept = ~self._ghosts(piece)
        if not kept.all() and len(ends) and ends[-1] == len(nodes):
            sizes = np.diff(ends, prepend=0)
            if (sizes >= 0).all():
                nodes = nodes[np.repeat(kept, sizes)]
                ends, types = np.cumsum(sizes[kept]), types[kept]
        yield from vtk_blocks(points, nodes, ends, types, source)

    def _whole(self, piece: _Piece, array: Element, rows: int | None) -> Long:
        values = self.arrays.values(array, rows, piece.where)
        if values.dtype.kind not in "iu" or values.ndim != 1:
            self.arrays.fail(
                f"{piece.where}, array {array.get('Name')!r}: got {values.dtype} of shape "
                f"{values.shape}; expected whole numbers"
            )
        return values.astype(np.int64)

    def _ghosts(self, piece: _Piece) -> Bool:
        """(M,) cells that another piece has too, or that are hidden."""
        for array in piece.element.iterfind("CellData/DataArray"):
            if array.get("Name") == "vtkGhostType":
                flags = self._whole(piece, array, piece.cells)
                return np.asarray(flags & _GHOST_CELLS != 0)
            if array.get("Name") == "vtkGhostLevels":
                return self._whole(piece, array, piece.cells) > 0
        return np.zeros(piece.cells, dtype=bool)
