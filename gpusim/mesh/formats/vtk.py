"""VTK's cells, and legacy VTK files (.vtk): unstructured grids, versions 1 to 5, as text or binary.

Format: "VTK File Formats", docs.vtk.org, simple legacy formats.
"""

from __future__ import annotations

import re

import numpy as np
import numpy.typing as npt

from gpusim.arrays.array_types import Float, Long
from gpusim.errors import InputError
from gpusim.files.input_file import InputFile
from gpusim.mesh.file_content.byte_source import ByteSource
from gpusim.mesh.file_content.cell_blocks import RawBlock, RawMesh
from gpusim.mesh.file_content.numbering import NODES, VTK_KINDS, right_handed_wedges


def vtk_blocks(points: Float, nodes: Long, ends: Long, types: Long, source: str) -> list[RawBlock]:
    """One block for each run of cells of one type.

    Parameters
    ----------
    nodes : node numbers of all cells, one cell after another.
    ends : (M,) place behind the last node of each cell.
    types : (M,) VTK's numbers.
    source : what a message begins with.

    Raises InputError for lists that don't fit each other.
    """
    if len(types) != len(ends):
        raise InputError(f"{source}: got {len(types)} cell types; expected {len(ends)}, as cells")
    starts = np.concatenate([np.zeros(1, np.int64), ends[:-1]])[: len(ends)]
    if (ends < starts).any() or (ends[-1] if len(ends) else 0) != len(nodes):
        raise InputError(f"{source}: the numbers of nodes per cell don't add up to {len(nodes)}")
    if nodes.size and not (nodes.min() >= 0 and nodes.max() < len(points)):
        wrong = nodes[(nodes < 0) | (nodes >= len(points))][0]
        raise InputError(
            f"{source}: a cell names node {wrong}, which isn't there; expected 0 … "
            f"{len(points) - 1}"
        )
    blocks = []
    runs = np.flatnonzero(np.diff(types, prepend=types[:1] - 1)) if len(types) else types
    for first, after in zip(runs, [*runs[1:], len(types)], strict=True):
        kind = VTK_KINDS.get(int(types[first]), f"VTK type {types[first]}")
        width = NODES.get(kind, 0)
        if not width:
            blocks.append(RawBlock(kind, np.zeros((after - first, 0), dtype=np.int64)))
            continue
        if (ends[first:after] - starts[first:after] != width).any():
            raise InputError(f"{source}: a {kind} hasn't got {width} nodes")
        rows = nodes[starts[first] : ends[after - 1]].reshape(-1, width)
        blocks.append(RawBlock(kind, right_handed_wedges(kind, points, rows)))
    return blocks


_TYPES = {
    "double": ">f8", "float": ">f4", "int": ">i4", "unsigned_int": ">u4", "long": ">i8",
    "unsigned_long": ">u8", "vtktypeint64": ">i8", "vtktypeint32": ">i4", "vtkidtype": ">i8",
    "vtktypeuint64": ">u8", "short": ">i2", "unsigned_short": ">u2", "char": ">i1",
    "unsigned_char": ">u1", "signed_char": ">i1",
}  # fmt: skip


def read_vtk(file: InputFile) -> RawMesh:
    """Points and cells of an unstructured grid; point, cell and field data are passed over.

    Raises InputError for other datasets, and a file that is cut off or damaged.
    """
    return _Reader(file).read()


class _Reader(ByteSource):
    def __init__(self, file: InputFile) -> None:
        super().__init__(file)
        self.what = "header"
        self.binary = False

    @property
    def place(self) -> str:
        return f"{self.what}, byte {self.at}"

    def read(self) -> RawMesh:
        self._header()
        points: Float | None = None
        lists: tuple[Long, Long] | None = None  # node numbers, and where those of a cell end
        types: Long | None = None
        while words := self.text_line().split():
            self.what = words[0].upper()
            if self.what == "DATASET":
                if words[1:] != ["UNSTRUCTURED_GRID"]:
                    self.fail(f"got {' '.join(words[1:])[:40]}; expected UNSTRUCTURED_GRID")
            elif self.what == "POINTS":
                flat = self._numbers(3 * self._count(words, 1), self._layout(words, 2))
                points = flat.astype(np.float64).reshape(-1, 3)
            elif self.what == "CELLS":
                lists = self._cells(self._count(words, 1), self._count(words, 2))
            elif self.what == "CELL_TYPES":
                types = self._numbers(self._count(words, 1), ">i4").astype(np.int64)
            elif self.what in ("POINT_DATA", "CELL_DATA"):
                break  # what follows is no geometry
            elif self.what == "METADATA":
                while self.line():
                    pass
            elif self.what == "FIELD":
                self._skip_fields(self._count(words, 2))
            else:
                self.what = "dataset"
                self.fail(
                    f"got {' '.join(words)[:40]!r}; expected a section: more numbers than "
                    "announced, or damaged?"
                )
        self.what = "dataset"
        if points is None or lists is None or types is None:
            self.fail("no POINTS, CELLS or CELL_TYPES; expected an unstructured grid: cut off?")
        return RawMesh(points, tuple(vtk_blocks(points, *lists, types, f"{self.source}: CELLS")))

    def _header(self) -> None:
        version = re.match(rb"# vtk DataFile Version (\d+)\.\d+", self.data)
        if version is None:
            self.fail(f"got {self.data[:22]!r}; expected '# vtk DataFile Version …'")
        if int(version[1]) > 5:
            self.fail(f"version {version[0][-3:].decode()}; expected 1.0 to 5.1")
        for _ in range(2):  # the second line is a title of any letters
            end = self.data.find(b"\n", self.at)
            self.at = len(self.data) if end < 0 else end + 1
        mode = self.line().upper()
        if mode not in ("ASCII", "BINARY"):
            self.fail(f"got {mode[:40]!r}; expected ASCII or BINARY")
        self.binary = mode == "BINARY"

    def _count(self, words: list[str], place: int) -> int:
        if len(words) <= place or not re.fullmatch(r"\d{1,15}", words[place]):
            self.fail(f"got {' '.join(words)[:60]!r}; expected a count")
        return int(words[place])

    def _layout(self, words: list[str], place: int) -> str:
        name = words[place] if len(words) > place else ""
        if name.lower() not in _TYPES:
            self.fail(f"got numbers of type {name[:40]!r}; expected one of {', '.join(_TYPES)}")
        return _TYPES[name.lower()]

    def _numbers(self, count: int, layout: str) -> npt.NDArray[np.number]:
        """``count`` numbers from here on."""
        if self.binary:
            return self.take(layout, count)
        words = self.data[self.at :].split(None, count)
        rest = words.pop() if len(words) > count else b""
        self.at = len(self.data) - len(rest)
        if len(words) != count:
            self.fail(f"got {len(words)} numbers; expected {count}: cut off, or damaged?")
        try:
            return np.array(words, dtype=np.float64 if "f" in layout else np.int64)
        except (ValueError, OverflowError) as error:
            self.fail(f"{error}; expected numbers")

    def _cells(self, count: int, size: int) -> tuple[Long, Long]:
        """Node numbers of all cells, and where those of each end."""
        if self.data[self.at : self.at + 7] == b"OFFSETS":  # version 5
            offsets = self._numbers(count, self._layout(self.line().split(), 1)).astype(np.int64)
            words = self.text_line().split()
            if words[:1] != ["CONNECTIVITY"]:
                self.fail(f"got {' '.join(words)[:40]!r}; expected CONNECTIVITY")
            nodes = self._numbers(size, self._layout(words, 1)).astype(np.int64)
            if count and offsets[0] != 0:
                self.fail(f"OFFSETS begin with {offsets[0]}; expected 0")
            return nodes, offsets[1:]
        if count > size:
            self.fail(f"got {count} cells in {size} numbers; expected more numbers than cells")
        flat = self._numbers(size, ">i4").astype(np.int64)
        heads = np.empty(count, dtype=np.int64)  # where each cell's number of nodes is
        place = 0
        for cell in range(count):
            if not 0 <= place < size:
                self.fail(f"its numbers end at cell {cell}; expected {count} cells")
            heads[cell] = place
            place += 1 + int(flat[place])
        sizes = flat[heads]
        if (sizes < 1).any() or sizes.sum() + count != size:
            self.fail(f"the numbers of nodes per cell don't add up to {size}")
        keep = np.ones(size, dtype=bool)
        keep[heads] = False
        return flat[keep], np.cumsum(sizes)

    def _skip_fields(self, count: int) -> None:
        """Arrays that belong to no point or cell: times, cycles, titles."""
        for _ in range(count):
            words = self.text_line().split()
            if words[:1] == ["METADATA"]:
                self.fail("metadata within field data; expected arrays")
            size = self._count(words, 1) * self._count(words, 2)
            if words[3:4] == ["string"]:
                self._skip_strings(size)
            else:
                self._numbers(size, self._layout(words, 3))

    def _skip_strings(self, count: int) -> None:
        for _ in range(count):
            if self.at_end:
                self.fail(f"ends before its {count} strings do: the file is cut off")
            if not self.binary:
                self.line()
                continue
            width = 8 >> (self.data[self.at] >> 6)  # of the length, by its first two bits
            length = int.from_bytes(self.data[self.at : self.at + width], "big")
            self.at += width + (length & (1 << (8 * width - 2)) - 1)
