"""Gmsh's element types and node orders. Pure data, for its files and for its Python interface."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from gpusim.mesh.cell_types import CELL_TYPES

__all__ = ["GMSH_NODES", "GMSH_TYPES", "from_gmsh_order"]

Long = npt.NDArray[np.int64]

# Number of a type in Gmsh -> gpusim's name; types of third order and above are refused by number.
GMSH_TYPES = {
    1: "line2", 2: "tri3", 3: "quad4", 4: "tet4", 5: "hex8", 6: "wedge6", 7: "pyramid5",
    8: "line3", 9: "tri6", 10: "quad9", 11: "tet10", 12: "hex27", 13: "wedge18", 14: "pyramid14",
    15: "point1", 16: "quad8", 17: "hex20", 18: "wedge15", 19: "pyramid13",
}  # fmt: skip
GMSH_NODES = {
    "line2": 2, "tri3": 3, "quad4": 4, "tet4": 4, "hex8": 8, "wedge6": 6, "pyramid5": 5,
    "line3": 3, "tri6": 6, "quad9": 9, "tet10": 10, "hex27": 27, "wedge18": 18, "pyramid14": 14,
    "point1": 1, "quad8": 8, "hex20": 20, "wedge15": 15, "pyramid13": 13,
}  # fmt: skip

_HEX_EDGES = [
    (0, 1), (0, 3), (0, 4), (1, 2), (1, 5), (2, 3), (2, 6), (3, 7), (4, 5), (4, 7), (5, 6), (6, 7),
]  # fmt: skip
# The corners that each further node lies between, in Gmsh's order ("Node ordering" of its manual).
_BETWEEN: dict[str, list[tuple[int, ...]]] = {
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


def from_gmsh_order(kind: str, nodes: Long) -> Long:
    """(M,k) node numbers of a kind, from Gmsh's order to gpusim's."""
    if kind not in _BETWEEN:
        return nodes
    cell = CELL_TYPES[kind]
    place = {frozenset(group): cell.corners + k for k, group in enumerate(_BETWEEN[kind])}
    order = [*range(cell.corners), *(place[frozenset(group)] for group in cell.parents)]
    return nodes[:, order]
