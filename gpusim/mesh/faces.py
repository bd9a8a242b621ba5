"""Boundary faces of a mesh, outward oriented, with normals and areas."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from gpusim.errors import InputError
from gpusim.mesh.cells import CELL_TYPES
from gpusim.mesh.mesh import Mesh

__all__ = ["Faces", "boundary_faces", "set_faces"]

Float = npt.NDArray[np.float64]
Int = npt.NDArray[np.int32]


@dataclass(frozen=True, eq=False)
class Faces:
    """Faces of cells, counter-clockwise seen from outside the cell.

    ``nodes`` (F,4) int32 (triangles padded with -1), ``cell`` (F,) int32 global cell number,
    ``local`` (F,) int32 face number inside the cell, ``points`` (N,3) float64 of the mesh.
    """

    nodes: Int
    cell: Int
    local: Int
    points: Float

    def __len__(self) -> int:
        return len(self.nodes)

    def __getitem__(self, which: npt.ArrayLike) -> Faces:
        """The faces numbered (or masked) by ``which``."""
        index = np.atleast_1d(np.asarray(which))
        return Faces(self.nodes[index], self.cell[index], self.local[index], self.points)

    @cached_property
    def is_triangle(self) -> npt.NDArray[np.bool_]:
        return np.asarray(self.nodes[:, 3] < 0)

    @cached_property
    def corners(self) -> Float:
        """(F,4,3) float64 coordinates; a triangle repeats its third corner."""
        nodes = np.where(self.nodes < 0, self.nodes[:, 2:3], self.nodes)
        return self.points[nodes]

    @cached_property
    def area_vectors(self) -> Float:
        """(F,3): half the cross product of the diagonals (exact vector area).

        A triangle's repeated corner makes the diagonals 2-0 and 2-1: the same formula holds.
        """
        p = self.corners
        vectors: Float = 0.5 * np.cross(p[:, 2] - p[:, 0], p[:, 3] - p[:, 1])
        return vectors

    @cached_property
    def areas(self) -> Float:
        """(F,) length of the vector area (the true area where the face is flat)."""
        return np.asarray(np.linalg.norm(self.area_vectors, axis=1))

    @cached_property
    def normals(self) -> Float:
        """(F,3) unit outward normals (mean normal of a warped face)."""
        return self.area_vectors / self.areas[:, None]

    @cached_property
    def centroids(self) -> Float:
        """(F,3) mean of the corners."""
        weight = (self.nodes >= 0).astype(np.float64)
        p = self.points[np.maximum(self.nodes, 0)]
        total = np.einsum("fki,fk->fi", p, weight)
        return np.asarray(total / weight.sum(axis=1)[:, None])

    def node_numbers(self) -> Int:
        """Sorted numbers of the nodes on these faces."""
        return np.unique(self.nodes[self.nodes >= 0]).astype(np.int32)

    def pairs(self) -> Int:
        """(F,2) pairs (cell, local face), the form in which a mesh keeps its face sets."""
        return np.stack([self.cell, self.local], axis=1)


def boundary_faces(mesh: Mesh) -> Faces:
    """The faces that belong to exactly one cell.

    Raises InputError where a face belongs to three or more cells (overlapping cells).
    """
    nodes, cell, local = _all_faces(mesh)
    if mesh.node_count < 2**21:
        # three least node numbers identify a face; 21 bits each fill one int64
        ordered = np.sort(np.where(nodes < 0, np.int32(2**31 - 1), nodes), axis=1)
        a, b, c = (ordered[:, k].astype(np.int64) for k in range(3))
        key = (a << 42) | (b << 21) | c
        _, first, count = np.unique(key, return_index=True, return_counts=True)
    else:
        ordered = np.sort(np.where(nodes < 0, np.int32(2**31 - 1), nodes), axis=1)
        order = np.lexsort((ordered[:, 2], ordered[:, 1], ordered[:, 0]))
        same = (ordered[order][1:, :3] == ordered[order][:-1, :3]).all(axis=1)
        start = np.flatnonzero(np.concatenate([[True], ~same]))
        first = order[start]
        count = np.diff(np.concatenate([start, [len(order)]]))
    crowded = np.flatnonzero(count > 2)
    if crowded.size:
        bad = first[crowded[:5]]
        raise InputError(
            f"mesh: {crowded.size} faces belong to more than two cells; got for example faces of "
            f"cells {', '.join(str(c) for c in cell[bad])}; expected at most two cells per face"
        )
    keep = np.sort(first[count == 1])
    return Faces(nodes[keep], cell[keep], local[keep], mesh.points)


def set_faces(mesh: Mesh, pairs: npt.ArrayLike) -> Faces:
    """Faces for (K,2) pairs (global cell number, local face number)."""
    wanted = np.asarray(pairs, dtype=np.int64).reshape(-1, 2)
    if wanted.size and (wanted[:, 0].min() < 0 or wanted[:, 0].max() >= mesh.cell_count):
        raise InputError(
            f"set_faces: cell number out of range; got {wanted[:, 0].min()} … "
            f"{wanted[:, 0].max()}; expected 0 … {mesh.cell_count - 1}"
        )
    nodes = np.full((len(wanted), 4), -1, dtype=np.int32)
    for kind, first, block in mesh.blocks():
        inside = (wanted[:, 0] >= first) & (wanted[:, 0] < first + len(block))
        sides = CELL_TYPES[kind].faces
        local = wanted[inside, 1]
        if local.size and (local.min() < 0 or local.max() >= len(sides)):
            raise InputError(
                f"set_faces: local face number out of range; got {local.min()} … {local.max()}; "
                f"expected 0 … {len(sides) - 1} for {kind}"
            )
        template = sides[local]
        cells = block[wanted[inside, 0] - first]
        picked = np.take_along_axis(cells, np.maximum(template, 0), axis=1)
        nodes[inside] = np.where(template < 0, -1, picked)
    return Faces(nodes, wanted[:, 0].astype(np.int32), wanted[:, 1].astype(np.int32), mesh.points)


def _all_faces(mesh: Mesh) -> tuple[Int, Int, Int]:
    nodes: list[Int] = []
    cell: list[Int] = []
    local: list[Int] = []
    for kind, first, block in mesh.blocks():
        template = CELL_TYPES[kind].faces
        picked = block[:, np.maximum(template, 0)]
        nodes.append(np.where(template[None] < 0, np.int32(-1), picked).reshape(-1, 4))
        numbers = np.arange(first, first + len(block), dtype=np.int32)
        cell.append(np.repeat(numbers, len(template)))
        local.append(np.tile(np.arange(len(template), dtype=np.int32), len(block)))
    return np.concatenate(nodes), np.concatenate(cell), np.concatenate(local)
