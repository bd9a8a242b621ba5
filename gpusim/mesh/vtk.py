"""Legacy VTK files (.vtk): unstructured grids, versions 1 to 5, as text or binary."""

from __future__ import annotations

from pathlib import Path
from typing import NoReturn

import numpy as np
import numpy.typing as npt

from gpusim.errors import InputError
from gpusim.mesh.mirror import turned_wedges
from gpusim.mesh.raw import RawBlock, RawMesh

__all__ = ["VTK_KINDS", "read_vtk"]

Float = npt.NDArray[np.float64]
Long = npt.NDArray[np.int64]

# Number of a VTK cell type -> kind and number of nodes.
VTK_KINDS = {
    1: ("point1", 1), 3: ("line2", 2), 5: ("tri3", 3), 9: ("quad4", 4), 10: ("tet4", 4),
    12: ("hex8", 8), 13: ("wedge6", 6), 14: ("pyramid5", 5), 21: ("line3", 3), 22: ("tri6", 6),
    23: ("quad8", 8), 24: ("tet10", 10), 25: ("hex20", 20), 26: ("wedge15", 15),
    27: ("pyramid13", 13), 28: ("quad9", 9), 29: ("hex27", 27), 34: ("tri7", 7),
}  # fmt: skip
_TYPES = {
    "double": ">f8", "float": ">f4", "int": ">i4", "unsigned_int": ">u4", "long": ">i8",
    "unsigned_long": ">u8", "vtktypeint64": ">i8", "vtktypeint32": ">i4", "vtkIdType": ">i8",
}  # fmt: skip


def read_vtk(path: Path) -> RawMesh:
    """Points and cells of an unstructured grid; point and cell data are passed over.

    Raises InputError for other datasets, and a file that is cut off or damaged.
    """
    return _Reader(path).read()


class _Reader:
    def __init__(self, path: Path) -> None:
        self.source = str(path)
        self.data = path.read_bytes()
        self.at = 0
        self.what = "header"
        self.binary = False

    def fail(self, problem: str) -> NoReturn:
        raise InputError(f"{self.source}: {self.what}: {problem}")

    def read(self) -> RawMesh:
        if not self.data.startswith(b"# vtk DataFile Version"):
            self.fail(f"got {self.data[:22]!r}; expected '# vtk DataFile Version …'")
        self._line()
        self._line()
        mode = self._line().upper()
        if mode not in ("ASCII", "BINARY"):
            self.fail(f"got {mode[:40]!r}; expected ASCII or BINARY")
        self.binary = mode == "BINARY"
        points: Float | None = None
        lists: tuple[Long, Long] | None = None  # offsets and node numbers
        types: Long | None = None
        while self.at < len(self.data):
            words = self._line().split()
            if not words:
                continue
            self.what = words[0].upper()
            if self.what == "DATASET":
                if words[1:] != ["UNSTRUCTURED_GRID"]:
                    self.fail(f"got {' '.join(words[1:])}; expected UNSTRUCTURED_GRID")
            elif self.what == "POINTS":
                count = self._count(words, 1)
                layout = self._layout(words[2] if len(words) > 2 else "")
                points = self._take(3 * count, layout).astype(np.float64).reshape(-1, 3)
            elif self.what == "CELLS":
                lists = self._cells(self._count(words, 1), self._count(words, 2))
            elif self.what == "CELL_TYPES":
                types = self._take(self._count(words, 1), ">i4").astype(np.int64)
            elif self.what in ("POINT_DATA", "CELL_DATA"):
                break  # what follows is no geometry
            elif self.what == "METADATA":
                while self.at < len(self.data) and self._line():
                    pass
            elif self.what == "FIELD" or lists is None:
                self.fail("got this where points or cells are expected: the file is damaged")
            else:
                self.fail("more numbers than announced, or an unknown section")
        self.what = "dataset"
        if points is None or lists is None or types is None:
            self.fail("no POINTS, CELLS or CELL_TYPES; expected an unstructured grid: cut off?")
        return RawMesh(points, tuple(self._blocks(*lists, types, points)))

    def _line(self) -> str:
        end = self.data.find(b"\n", self.at)
        end = len(self.data) if end < 0 else end
        line = self.data[self.at : end]
        self.at = end + 1
        try:
            return line.decode("utf-8").strip()
        except UnicodeDecodeError:
            self.fail("bytes that are no text where a line of text is expected: damaged?")

    def _count(self, words: list[str], place: int) -> int:
        if len(words) <= place or not words[place].isdigit():
            self.fail(f"got {' '.join(words)[:60]!r}; expected a count")
        return int(words[place])

    def _layout(self, name: str) -> str:
        if name not in _TYPES:
            self.fail(f"got numbers of type {name!r}; expected one of {', '.join(_TYPES)}")
        return _TYPES[name]

    def _take(self, count: int, layout: str) -> npt.NDArray[np.number]:
        """``count`` numbers from here on."""
        if self.binary:
            kind = np.dtype(layout)
            if self.at + count * kind.itemsize > len(self.data):
                self.fail(f"ends before its {count} numbers do: the file is cut off")
            rows = np.frombuffer(self.data, kind, count, self.at)
            self.at += count * kind.itemsize
            return rows
        words: list[bytes] = []
        while len(words) < count and self.at < len(self.data):
            # whole lines: a first guess at their length, then one by one
            ahead = self.data.find(b"\n", self.at + 2 * (count - len(words)))
            end = len(self.data) if ahead < 0 else ahead
            part = self.data[self.at : end].split()
            if len(words) + len(part) > count:
                end = self.data.find(b"\n", self.at)
                end = len(self.data) if end < 0 else end
                part = self.data[self.at : end].split()
            words += part
            self.at = end + 1
        if len(words) != count:
            self.fail(f"got {len(words)} numbers; expected {count}: cut off, or damaged?")
        try:
            return np.array(words, dtype=np.float64 if "f" in layout else np.int64)
        except (ValueError, OverflowError) as error:
            self.fail(f"{error}; expected numbers")

    def _cells(self, count: int, size: int) -> tuple[Long, Long]:
        """Offsets (count+1,) into the node numbers, and these."""
        start = self.at
        words = self._line().split()
        if words and words[0] == "OFFSETS":  # version 5: ``count`` is that of the offsets
            offsets = self._take(count, self._layout(words[1])).astype(np.int64)
            words = [""]
            while words in ([], [""]) and self.at < len(self.data):
                words = self._line().split()
            if words[0] != "CONNECTIVITY" or len(words) < 2:
                self.fail(f"got {' '.join(words)[:40]!r}; expected CONNECTIVITY")
            nodes = self._take(size, self._layout(words[1])).astype(np.int64)
        else:
            self.at = start
            flat = self._take(size, ">i4").astype(np.int64)
            places = np.empty(count + 1, dtype=np.int64)
            place = 0
            for cell in range(count):
                places[cell] = place
                if place >= size:
                    self.fail(f"its numbers end at cell {cell}; expected {count} cells")
                place += 1 + int(flat[place])
            places[count] = place
            keep = np.ones(size, dtype=bool)
            keep[places[:-1]] = False
            nodes, offsets = flat[keep], places - np.arange(count + 1)
        if len(offsets) == 0 or offsets[-1] != len(nodes) or (np.diff(offsets) < 1).any():
            self.fail("the numbers of nodes per cell don't add up")
        return offsets, nodes

    def _blocks(self, offsets: Long, nodes: Long, types: Long, points: Float) -> list[RawBlock]:
        """One block for each run of cells of one type."""
        self.what = "CELLS"
        if nodes.size and not (nodes.min() >= 0 and nodes.max() < len(points)):
            self.fail(f"a cell names a node that isn't there; expected 0 … {len(points) - 1}")
        self.what = "CELL_TYPES"
        if len(types) != len(offsets) - 1:
            self.fail(f"got {len(types)} types; expected {len(offsets) - 1}, as there are cells")
        starts = np.flatnonzero(np.concatenate([[True], types[1:] != types[:-1]]))
        blocks = []
        for start, end in zip(starts, [*starts[1:], len(types)], strict=True):
            kind, width = VTK_KINDS.get(int(types[start]), (f"VTK type {types[start]}", 0))
            if not width:
                blocks.append(RawBlock(kind, np.zeros((end - start, 0), dtype=np.int64)))
                continue
            if (np.diff(offsets[start : end + 1]) != width).any():
                self.fail(f"a {kind} hasn't got {width} nodes")
            rows = nodes[offsets[start] : offsets[end]].reshape(-1, width)
            blocks.append(RawBlock(kind, turned_wedges(kind, points, rows)))
        return blocks
