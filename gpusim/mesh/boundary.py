"""Boundary faces of a mesh, outward oriented, with normals and areas."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from gpusim.arrays.array_types import Bool, Float, Int, Long
from gpusim.arrays.unique import distinct
from gpusim.errors import InputError
from gpusim.field_summary import field_summary
from gpusim.mesh.cell_types import CELL_TYPES
from gpusim.mesh.quadrature import face_rule
from gpusim.mesh.shape_functions import FACE_TYPES, shape_gradients
from gpusim.validation import require, unmasked

if TYPE_CHECKING:
    from gpusim.mesh.mesh import Mesh


@unmasked()
@dataclass(frozen=True, eq=False)
class Faces:
    """Faces of cells, counter-clockwise seen from outside the cell.

    ``nodes`` (F,w) int32: columns 0-3 are corners (a triangle has -1 in column 3); w = 4 in a mesh
    of linear cells, 8 or 9 with quadratic ones, whose midside nodes follow (see `CellType.faces`;
    -1 where a face has none). ``cell`` (F,) int32 global cell number, ``local`` (F,) int32 face
    number inside the cell, ``points`` (N,3) float64 of the mesh.

    Examples
    --------
    >>> faces = gs.mesh.boundary_faces(gs.mesh.box(size=(2, 1, 1), divisions=(2, 1, 1)))
    >>> faces.nodes.shape, float(faces.areas.sum())
    ((10, 4), 10.0)
    """

    nodes: Int
    cell: Int
    local: Int
    points: Float
    __repr__ = field_summary

    def __len__(self) -> int:
        return len(self.nodes)

    def __getitem__(self, which: npt.ArrayLike) -> Faces:
        """The faces numbered (or masked) by ``which``."""
        index = np.atleast_1d(np.asarray(which))
        return Faces(self.nodes[index], self.cell[index], self.local[index], self.points)

    @cached_property
    def is_triangle(self) -> Bool:
        return np.asarray(self.nodes[:, 3] < 0)

    @cached_property
    def is_quadratic(self) -> Bool:
        """(F,) whether the face has midside nodes."""
        if self.nodes.shape[1] == 4:
            return np.zeros(len(self), dtype=bool)
        return np.asarray(self.nodes[:, 4] >= 0)

    def kinds(self) -> Iterator[tuple[str, Long]]:
        """Yield (face type, rows) for each of tri3, tri6, quad4, quad8, quad9 that occurs."""
        centred = self.nodes[:, 8] >= 0 if self.nodes.shape[1] > 8 else np.zeros(len(self), bool)
        for name, chosen in (
            ("tri3", self.is_triangle & ~self.is_quadratic),
            ("tri6", self.is_triangle & self.is_quadratic),
            ("quad4", ~self.is_triangle & ~self.is_quadratic),
            ("quad8", ~self.is_triangle & self.is_quadratic & ~centred),
            ("quad9", centred),
        ):
            rows = np.flatnonzero(chosen)
            if rows.size:
                yield name, rows

    @cached_property
    def corners(self) -> Float:
        """(F,4,3) float64 coordinates; a triangle repeats its third corner."""
        corners = self.nodes[:, :4]
        return self.points[np.where(corners < 0, corners[:, 2:3], corners)]

    @cached_property
    def area_vectors(self) -> Float:
        """(F,3) integral of the unit normal, exact.

        Half the cross product of the diagonals on linear faces (a triangle's repeated corner makes
        them 2-0 and 2-1: the same formula holds), quadrature on quadratic ones.
        """
        p = self.corners
        vectors: Float = 0.5 * np.cross(p[:, 2] - p[:, 0], p[:, 3] - p[:, 1])
        for rows, normals in self._curved():
            vectors[rows] = normals.sum(axis=1)
        return vectors

    @cached_property
    def areas(self) -> Float:
        """(F,) areas: on linear faces the length of the vector area (exact where flat), on
        quadratic ones by quadrature (exact where flat and straight)."""
        areas = np.asarray(np.linalg.norm(self.area_vectors, axis=1))
        for rows, normals in self._curved():
            areas[rows] = np.linalg.norm(normals, axis=2).sum(axis=1)
        return areas

    @cached_property
    def normals(self) -> Float:
        """(F,3) unit outward normals (mean normal of a warped or curved face)."""
        lengths = np.linalg.norm(self.area_vectors, axis=1, keepdims=True)
        return np.asarray(self.area_vectors / lengths)

    @cached_property
    def centroids(self) -> Float:
        """(F,3) mean of the corners."""
        corners = self.nodes[:, :4]
        weight = (corners >= 0).astype(np.float64)
        p = self.points[np.maximum(corners, 0)]
        total = np.einsum("fki,fk->fi", p, weight)
        return np.asarray(total / weight.sum(axis=1)[:, None])

    def _curved(self) -> Iterator[tuple[Long, Float]]:
        """Per quadratic face type: rows (K,), and normals times area (K,Q,3) at its points."""
        for name, rows in self.kinds():
            if name in ("tri3", "quad4"):
                continue
            place, weight = face_rule(name, 6 if name == "tri6" else 9)
            nodes = self.points[self.nodes[rows][:, list(FACE_TYPES[name])]]
            tangent = np.einsum("fki,qkj->fqij", nodes, shape_gradients(name, place))
            normal = np.cross(tangent[..., 0], tangent[..., 1])
            yield rows, normal * weight[:, None]

    def node_numbers(self) -> Int:
        """Sorted numbers of the nodes on these faces."""
        return distinct(self.nodes[self.nodes >= 0]).astype(np.int32)

    def pairs(self) -> Int:
        """(F,2) pairs (cell, local face), the form in which a mesh keeps its face sets."""
        return np.stack([self.cell, self.local], axis=1)


def boundary_faces(mesh: Mesh) -> Faces:
    """The faces that belong to exactly one cell.

    Raises InputError where a face belongs to three or more cells (overlapping cells), or where
    two neighbours have the same corners and different midside nodes (a linear cell beside a
    quadratic one, or nodes that were never merged): they would come apart there. Kept with the
    mesh: asking again is free.

    Examples
    --------
    >>> len(gs.mesh.boundary_faces(gs.mesh.box(size=(2, 1, 1), divisions=(2, 1, 1))).nodes)
    10
    """
    found = mesh.__dict__.get("_boundary")
    if found is None:
        found = _boundary(mesh)
        mesh.__dict__["_boundary"] = found  # as a cached property does, past the frozen class
    assert isinstance(found, Faces)
    return found


def _boundary(mesh: Mesh) -> Faces:
    corners, pairs = all_faces(mesh)
    order, start, count = matched(corners, mesh.node_count)
    crowded = np.flatnonzero(count > 2)
    bad = pairs[order[start[crowded[:5]]], 0]
    got = f"for example faces of cells {', '.join(str(c) for c in bad)}"
    what = f"mesh: {crowded.size} faces belong to more than two cells"
    require(not crowded.size, what, got, "at most two cells per face")
    if _width(mesh) > 4:
        inner = start[count == 2]
        one, two = (set_faces(mesh, pairs[order[inner + side]]) for side in (0, 1))
        differ = np.sort(one.nodes[:, 4:], axis=1) != np.sort(two.nodes[:, 4:], axis=1)
        loose = np.flatnonzero(differ.any(axis=1))
        if loose.size:
            a, b = sorted((one.cell[loose[0]], two.cell[loose[0]]))
            raise InputError(
                f"mesh: {loose.size} pairs of neighbours share the corners of a face, but not its "
                f"midside nodes; got for example cells {a} and {b}; expected the same nodes (no "
                "linear cell beside a quadratic one)"
            )
    return set_faces(mesh, pairs[np.sort(order[start[count == 1]])])


def matched(corners: Int, node_count: int) -> tuple[Long, ...]:
    """Order of the faces in which equal ones are neighbours; where each group starts; its size."""
    ordered = np.sort(corners, axis=1)
    triangle = ordered[:, 3] == NO_NODE
    if node_count < 2**21:
        # the three least node numbers identify a face; 21 bits each, and one for its shape
        key = triangle.astype(np.uint64)
        for column in range(3):
            key <<= np.uint64(21)
            key |= ordered[:, column].astype(np.uint64)
        order = np.argsort(key, kind="stable")
        ranked = key[order]
        same = ranked[1:] == ranked[:-1]
    else:
        order = np.lexsort((triangle, ordered[:, 2], ordered[:, 1], ordered[:, 0]))
        ranked = np.concatenate([ordered[:, :3], triangle[:, None]], axis=1)[order]
        same = (ranked[1:] == ranked[:-1]).all(axis=1)
    start = np.flatnonzero(np.concatenate([[True], ~same]))
    return order, start, np.diff(np.concatenate([start, [len(order)]]))


@unmasked()
def set_faces(mesh: Mesh, pairs: npt.ArrayLike) -> Faces:
    """Faces for (K,2) pairs (global cell number, local face number).

    Examples
    --------
    >>> bar = gs.mesh.box(size=(2, 1, 1), divisions=(2, 1, 1))
    >>> gs.mesh.set_faces(bar, bar.face_sets["x_max"]).normals + 0.0
    array([[1., 0., 0.]])
    """
    wanted = np.asarray(pairs, dtype=np.int64).reshape(-1, 2)
    check_range("set_faces: cell number", wanted[:, 0], mesh.cell_count)
    nodes = np.full((len(wanted), _width(mesh)), -1, dtype=np.int32)
    for kind, first, block in mesh.blocks():
        inside = (wanted[:, 0] >= first) & (wanted[:, 0] < first + len(block))
        sides = CELL_TYPES[kind].faces
        local = wanted[inside, 1]
        check_range(f"set_faces: local face number of {kind}", local, len(sides))
        template = sides[local]
        cells = block[wanted[inside, 0] - first]
        picked = np.take_along_axis(cells, np.maximum(template, 0), axis=1)
        nodes[inside, : template.shape[1]] = np.where(template < 0, -1, picked)
    arrays = nodes, wanted[:, 0].astype(np.int32), wanted[:, 1].astype(np.int32)
    for array in arrays:
        array.setflags(write=False)
    return Faces(*arrays, mesh.points)


def check_range(what: str, numbers: npt.NDArray[np.integer], count: int) -> None:
    """Refuse numbers that don't all lie in 0 … ``count`` - 1."""
    if numbers.size and (numbers.min() < 0 or numbers.max() >= count):
        got = f"{numbers.min()} … {numbers.max()}"
        raise InputError(f"{what} out of range; got {got}; expected 0 … {count - 1}")


def _width(mesh: Mesh) -> int:
    """Columns of `Faces.nodes`: as many as the mesh's richest face has nodes."""
    return max(int(CELL_TYPES[kind].faces.shape[1]) for kind, _, rows in mesh.blocks() if len(rows))


NO_NODE = np.int32(2**31 - 1)
"""Where a triangle has no fourth corner: greater than every node number."""


def all_faces(mesh: Mesh) -> tuple[Int, Int]:
    """Corners (A,4) and pairs (A,2), cell and local face, of every face of every cell."""
    corners: list[Int] = []
    pairs: list[Int] = []
    for kind, first, block in mesh.blocks():
        template = CELL_TYPES[kind].faces[:, :4]
        picked = np.take(block, np.maximum(template, 0).ravel(), axis=1).reshape(-1, 4)
        missing = np.flatnonzero(template[:, 3] < 0)
        picked.reshape(len(block), len(template), 4)[:, missing, 3] = NO_NODE
        corners.append(picked)
        sides = np.empty((len(block), len(template), 2), dtype=np.int32)
        sides[..., 0] = np.arange(first, first + len(block))[:, None]
        sides[..., 1] = np.arange(len(template))
        pairs.append(sides.reshape(-1, 2))
    return np.concatenate(corners), np.concatenate(pairs)
