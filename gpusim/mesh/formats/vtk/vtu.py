"""VTK's unstructured grids in XML (.vtu): all pieces, one after another, as VTK appends them."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any
from xml.etree.ElementTree import Element

import numpy as np
import numpy.typing as npt

from gpusim.files.input_file import InputFile
from gpusim.mesh.formats.cell_blocks import RawBlock, RawMesh
from gpusim.mesh.formats.vtk.cell_types import vtk_blocks
from gpusim.mesh.formats.vtk.vtu_arrays import VtuArrays

__all__ = ["VtuFile"]

Float = npt.NDArray[np.float64]
Long = npt.NDArray[np.int64]

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

    def _ghosts(self, piece: _Piece) -> npt.NDArray[np.bool_]:
        """(M,) cells that another piece has too, or that are hidden."""
        for array in piece.element.iterfind("CellData/DataArray"):
            if array.get("Name") == "vtkGhostType":
                flags = self._whole(piece, array, piece.cells)
                return np.asarray(flags & _GHOST_CELLS != 0)
            if array.get("Name") == "vtkGhostLevels":
                return self._whole(piece, array, piece.cells) > 0
        return np.zeros(piece.cells, dtype=bool)
