"""Cell types: node order (VTK's), edges, faces, and parents of midside nodes. Pure data.

Linear types are written out; a quadratic type is its linear one plus a list of midside nodes, so
that corners, edges and faces agree between the two by construction.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gpusim.arrays.array_types import Int
from gpusim.field_summary import field_summary

Parents = tuple[tuple[int, ...], ...]


@dataclass(frozen=True, eq=False)
class CellType:
    """Topology of one cell type.

    Parameters
    ----------
    nodes, corners : number of nodes, and of corners among them; corners come first.
    linear : name of the type with the corners only (its own name if it has no others).
    parents : for each further node the corners whose mean it lies at on a straight cell: two for
        the middle of an edge, four for that of a face, eight for that of the cell.
    edges : (E,2) int32 corners.
    faces : (F,w) int32 local node numbers, counter-clockwise seen from outside. Columns 0-3 are
        corners, a triangle has -1 in column 3; w = 8 with midsides: column 4+i lies between
        corner i and the next one (column 7 of a triangle is -1); w = 9: column 8 is the middle, -1
        of a face without.
    corner_neighbours : (C,3) int32, for the Jacobian at each of the first C corners its three
        neighbours in right-handed order. A pyramid's apex, where four edges meet, has none.

    Examples
    --------
    >>> gs.mesh.CELL_TYPES["hex8"].faces.shape
    (6, 4)
    """

    name: str
    nodes: int
    corners: int
    linear: str
    parents: Parents
    edges: Int
    faces: Int
    corner_neighbours: Int
    __repr__ = field_summary

    @property
    def has_midsides(self) -> bool:
        """Whether there are nodes between its corners."""
        return self.linear != self.name

    @property
    def serendipity(self) -> bool:
        """Whether all further nodes lie on edges, none within faces or the cell."""
        return all(len(group) == 2 for group in self.parents)


def _int32(rows: list[list[int]]) -> Int:
    table = np.array(rows, dtype=np.int32)
    table.setflags(write=False)
    return table


def _linear(
    name: str, edges: list[list[int]], faces: list[list[int]], neighbours: list[list[int]]
) -> CellType:
    corners = 1 + max(max(edge) for edge in edges)
    return CellType(
        name, corners, corners, name, (), _int32(edges), _int32(faces), _int32(neighbours)
    )


def _quadratic(name: str, base: CellType, parents: list[tuple[int, ...]]) -> CellType:
    number = {frozenset(group): base.corners + k for k, group in enumerate(parents)}
    faces = []
    for face in base.faces.tolist():
        ring = [corner for corner in face if corner >= 0]
        middles = [number[frozenset(pair)] for pair in zip(ring, ring[1:] + ring[:1], strict=True)]
        row = face + middles + [-1] * (4 - len(middles))
        faces.append([*row, number.get(frozenset(ring), -1)])
    if all(row[8] < 0 for row in faces):
        faces = [row[:8] for row in faces]
    return CellType(
        name,
        base.corners + len(parents),
        base.corners,
        base.name,
        tuple(parents),
        base.edges,
        _int32(faces),
        base.corner_neighbours,
    )


# Edges are in the order in which the quadratic type numbers their midside nodes.
_HEX8 = _linear(
    "hex8",
    [[0, 1], [1, 2], [2, 3], [3, 0], [4, 5], [5, 6],
     [6, 7], [7, 4], [0, 4], [1, 5], [2, 6], [3, 7]],
    [[0, 3, 2, 1], [4, 5, 6, 7], [0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]],
    [[1, 3, 4], [2, 0, 5], [3, 1, 6], [0, 2, 7], [7, 5, 0], [4, 6, 1], [5, 7, 2], [6, 4, 3]],
)  # fmt: skip
_TET4 = _linear(
    "tet4",
    [[0, 1], [1, 2], [2, 0], [0, 3], [1, 3], [2, 3]],
    [[0, 2, 1, -1], [0, 1, 3, -1], [1, 2, 3, -1], [2, 0, 3, -1]],
    [[1, 2, 3]],
)
_WEDGE6 = _linear(
    "wedge6",
    [[0, 1], [1, 2], [2, 0], [3, 4], [4, 5], [5, 3], [0, 3], [1, 4], [2, 5]],
    [[0, 2, 1, -1], [3, 4, 5, -1], [0, 1, 4, 3], [1, 2, 5, 4], [2, 0, 3, 5]],
    [[1, 2, 3], [2, 0, 4], [0, 1, 5], [5, 4, 0], [3, 5, 1], [4, 3, 2]],
)
_PYRAMID5 = _linear(
    "pyramid5",
    [[0, 1], [1, 2], [2, 3], [3, 0], [0, 4], [1, 4], [2, 4], [3, 4]],
    [[0, 3, 2, 1], [0, 1, 4, -1], [1, 2, 4, -1], [2, 3, 4, -1], [3, 0, 4, -1]],
    [[1, 3, 4], [2, 0, 4], [3, 1, 4], [0, 2, 4]],
)
# VTK_TRIQUADRATIC_HEXAHEDRON: faces -x +x -y +y -z +z, then the centre
_HEX_MIDDLES: list[tuple[int, ...]] = [
    (0, 3, 7, 4), (1, 2, 6, 5), (0, 1, 5, 4), (3, 2, 6, 7), (0, 1, 2, 3), (4, 5, 6, 7),
    (0, 1, 2, 3, 4, 5, 6, 7),
]  # fmt: skip


def _midsides(base: CellType) -> list[tuple[int, ...]]:
    return [(int(a), int(b)) for a, b in base.edges]


CELL_TYPES: dict[str, CellType] = {
    cell.name: cell
    for cell in (
        _HEX8,
        _quadratic("hex20", _HEX8, _midsides(_HEX8)),
        _quadratic("hex27", _HEX8, _midsides(_HEX8) + _HEX_MIDDLES),
        _TET4,
        _quadratic("tet10", _TET4, _midsides(_TET4)),
        _WEDGE6,
        _quadratic("wedge15", _WEDGE6, _midsides(_WEDGE6)),
        _PYRAMID5,
        _quadratic("pyramid13", _PYRAMID5, _midsides(_PYRAMID5)),
    )
}
"""By name. What else belongs to a type stands in tables beside what uses it: shape functions
(`_POWERS` of `gpusim.mesh.shape_functions`), integration rules (`FULL_POINTS` of
`gpusim.mesh.quadrature`; formulations and mass in `gpusim.fem.elements.element`), partners
(`gpusim.mesh.builders.conversion`), orders of other programs
(`gpusim.mesh.file_content.numbering`)."""
