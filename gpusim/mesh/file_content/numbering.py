"""How other programs number kinds of cells, their nodes and their sides. Mostly data.

Kinds are those of `CELL_TYPES`, and what is below solids: point1, line2, …, quad9. What is neither
is a solid that isn't known.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gpusim.arrays.array_types import Bool, Float, Long
from gpusim.mesh.cell_types import CELL_TYPES
from gpusim.validation import require

Sides = dict[str, tuple[tuple[int, ...], ...]]

FLAT_CORNERS = {
    "point1": 1, "line2": 2, "line3": 2, "tri3": 3, "tri6": 3, "tri7": 3, "quad4": 4, "quad8": 4,
    "quad9": 4,
}  # fmt: skip
"""Corners of the kinds below solids."""
REFUSED_SOLIDS = {"wedge18": 18, "pyramid14": 14}
"""Nodes of solids that files may have, and that are refused."""
NODES = {
    **{kind: int(kind[-1]) for kind in FLAT_CORNERS},
    **{kind: cell.nodes for kind, cell in CELL_TYPES.items()},
    **REFUSED_SOLIDS,
}
"""Nodes of every kind."""

GMSH_KINDS = {
    1: "line2", 2: "tri3", 3: "quad4", 4: "tet4", 5: "hex8", 6: "wedge6", 7: "pyramid5",
    8: "line3", 9: "tri6", 10: "quad9", 11: "tet10", 12: "hex27", 13: "wedge18", 14: "pyramid14",
    15: "point1", 16: "quad8", 17: "hex20", 18: "wedge15", 19: "pyramid13",
}  # fmt: skip
VTK_KINDS = {
    1: "point1", 3: "line2", 5: "tri3", 9: "quad4", 10: "tet4", 12: "hex8", 13: "wedge6",
    14: "pyramid5", 21: "line3", 22: "tri6", 23: "quad8", 24: "tet10", 25: "hex20", 26: "wedge15",
    27: "pyramid13", 28: "quad9", 29: "hex27", 34: "tri7",
}  # fmt: skip
MED_KINDS = {
    "PO1": "point1", "SE2": "line2", "SE3": "line3", "TR3": "tri3", "TR6": "tri6", "TR7": "tri7",
    "QU4": "quad4", "QU8": "quad8", "QU9": "quad9", "TE4": "tet4", "T10": "tet10", "HE8": "hex8",
    "H20": "hex20", "PY5": "pyramid5", "P13": "pyramid13", "PE6": "wedge6", "P15": "wedge15",
}  # fmt: skip

# Corners of the sides, in the order of their numbers: S1, S2, … (P1, P2, … of a load) of Abaqus.
ABAQUS_SIDES: Sides = {
    "hex8": ((0, 1, 2, 3), (4, 7, 6, 5), (0, 4, 5, 1), (1, 5, 6, 2), (2, 6, 7, 3), (3, 7, 4, 0)),
    "tet4": ((0, 1, 2), (0, 3, 1), (1, 3, 2), (2, 3, 0)),
    "wedge6": ((0, 1, 2), (3, 5, 4), (0, 3, 4, 1), (1, 4, 5, 2), (2, 5, 3, 0)),
    "pyramid5": ((0, 1, 2, 3), (0, 4, 1), (1, 4, 2), (2, 4, 3), (3, 4, 0)),
}
EXODUS_SIDES: Sides = {
    "hex8": ((0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (0, 4, 7, 3), (0, 3, 2, 1), (4, 5, 6, 7)),
    "tet4": ((0, 1, 3), (1, 2, 3), (0, 3, 2), (0, 2, 1)),
    "wedge6": ((0, 1, 4, 3), (1, 2, 5, 4), (0, 3, 5, 2), (0, 2, 1), (3, 4, 5)),
    "pyramid5": ((0, 1, 4), (1, 2, 4), (2, 3, 4), (0, 4, 3), (0, 3, 2, 1)),
}

# Exodus and Nastran count upright edges before those on top, and faces of a hex27 after its centre.
_UPRIGHT_FIRST = {
    "tet10": [*range(10)],
    "pyramid13": [*range(13)],
    "hex20": [*range(12), 16, 17, 18, 19, 12, 13, 14, 15],
    "hex27": [*range(12), 16, 17, 18, 19, 12, 13, 14, 15, 23, 24, 25, 26, 21, 22, 20],
    "wedge15": [*range(9), 12, 13, 14, 9, 10, 11],
}
_HEX_EDGES = [
    (0, 1), (0, 3), (0, 4), (1, 2), (1, 5), (2, 3), (2, 6), (3, 7), (4, 5), (4, 7), (5, 6), (6, 7),
]  # fmt: skip
# The corners that each further node lies between, in Gmsh's order ("Node ordering" of its manual).
_GMSH_BETWEEN: dict[str, list[tuple[int, ...]]] = {
    "tet10": [(0, 1), (1, 2), (0, 2), (0, 3), (2, 3), (1, 3)],
    "hex20": [*_HEX_EDGES],
    "hex27": [
        *_HEX_EDGES,
        (0, 1, 2, 3), (0, 1, 4, 5), (0, 3, 4, 7), (1, 2, 5, 6), (2, 3, 6, 7), (4, 5, 6, 7),
        (0, 1, 2, 3, 4, 5, 6, 7),
    ],
    "wedge15": [(0, 1), (0, 2), (0, 3), (1, 2), (1, 4), (2, 5), (3, 4), (3, 5), (4, 5)],
    "pyramid13": [(0, 1), (0, 3), (0, 4), (1, 2), (1, 4), (2, 3), (2, 4), (3, 4)],
}  # fmt: skip
# Corners in the order of the mirrored cell; the three ends of the edges at corner 0.
_MIRROR = {
    "tet4": ((0, 2, 1, 3), (1, 2, 3)),
    "hex8": ((0, 3, 2, 1, 4, 7, 6, 5), (1, 3, 4)),
    "wedge6": ((0, 2, 1, 3, 5, 4), (1, 2, 3)),
    "pyramid5": ((0, 3, 2, 1, 4), (1, 3, 4)),
}


def dimension_of(kind: str) -> int:
    """0 to 3; what isn't known is a solid."""
    corners = FLAT_CORNERS.get(kind)
    return 3 if corners is None else min(corners - 1, 2)


def local_faces(kind: str, sides: Sides) -> Long:
    """Our local face number for each side of a program, matched by its corners."""
    cell = CELL_TYPES[kind]
    ours = [frozenset(int(node) for node in row if 0 <= node < cell.corners) for row in cell.faces]
    return np.array([ours.index(frozenset(side)) for side in sides[cell.linear]])


def from_gmsh_order(kind: str, nodes: Long) -> Long:
    """(M,k) node numbers of a kind, from Gmsh's order to gpusim's."""
    if not _quadratic_solid(kind):
        return nodes
    return nodes[:, _order(kind, [*range(CELL_TYPES[kind].corners)], _GMSH_BETWEEN[kind])]


def from_upright_first(kind: str, nodes: Long) -> Long:
    """(M,k) node numbers of a kind, from the order of Exodus and Nastran to gpusim's."""
    return nodes[:, _UPRIGHT_FIRST[kind]] if _quadratic_solid(kind) else nodes


def _quadratic_solid(kind: str) -> bool:
    """Whether a kind has nodes whose order differs: a table without it is an error then."""
    return kind in CELL_TYPES and bool(CELL_TYPES[kind].parents)


def middles_in_order(points: Float, nodes: Long) -> Long:
    """(M,27) bricks with the nodes in faces and middle, which programs count in different orders,
    as ours: each where serendipity shapes have it, the nearest of them.

    Raises
    ------
    InputError
        One of these nodes is the nearest to two places.
    """
    cell = CELL_TYPES["hex27"]
    places = []
    for group in cell.parents[12:]:
        edges = [8 + k for k, pair in enumerate(cell.parents[:12]) if {*pair} <= {*group}]
        corners = points[nodes[:, list(group)]].sum(axis=1)
        share = 2.0 / len(group)
        places.append(share * points[nodes[:, edges]].sum(axis=1) - 0.25 * corners)
    given = points[nodes[:, 20:]]
    away = np.linalg.norm(np.stack(places, axis=1)[:, :, None] - given[:, None], axis=3)
    nearest = away.argmin(axis=2)
    wrong = int((np.sort(nearest, axis=1) != np.arange(7)).any(axis=1).sum())
    got = f"{wrong} whose nodes from the 21st on don't lie one in each face and one in the middle"
    require(not wrong, "bricks of 27 nodes", got, "them there, in any order")
    return np.concatenate([nodes[:, :20], np.take_along_axis(nodes[:, 20:], nearest, axis=1)], 1)


def right_handed_wedges(kind: str, points: Float, nodes: Long) -> Long:
    """Every left-handed wedge mirrored; other kinds as they are.

    VTK's manual defines its wedge the other way round than Abaqus and the rest, and programs
    write either.
    """
    if kind not in CELL_TYPES or CELL_TYPES[kind].linear != "wedge6" or not len(nodes):
        return nodes
    return np.where(_left_handed(kind, points, nodes)[:, None], _mirrored(kind, nodes), nodes)


def right_handed_cells(kind: str, points: Float, nodes: Long) -> Long:
    """All cells mirrored if every one of them is left-handed, as MED counts corners; else none."""
    if kind not in CELL_TYPES or not len(nodes) or not _left_handed(kind, points, nodes).all():
        return nodes
    return _mirrored(kind, nodes)


def _left_handed(kind: str, points: Float, nodes: Long) -> Bool:
    _, ends = _MIRROR[CELL_TYPES[kind].linear]
    edges = points[nodes[:, ends]] - points[nodes[:, :1]]
    volume = np.einsum("mi,mi->m", np.cross(edges[:, 0], edges[:, 1]), edges[:, 2])
    return np.asarray(volume < 0.0)


def _mirrored(kind: str, nodes: Long) -> Long:
    mirror, _ = _MIRROR[CELL_TYPES[kind].linear]
    return nodes[:, _order(kind, mirror, CELL_TYPES[kind].parents)]


def _order(kind: str, corners: Sequence[int], between: Sequence[tuple[int, ...]]) -> list[int]:
    """Where our nodes stand in a cell with these ``corners`` and further nodes ``between`` them."""
    cell = CELL_TYPES[kind]
    place = {frozenset(group): cell.corners + k for k, group in enumerate(between)}
    parents = ([corners[node] for node in group] for group in cell.parents)
    return [*corners, *(place[frozenset(group)] for group in parents)]
