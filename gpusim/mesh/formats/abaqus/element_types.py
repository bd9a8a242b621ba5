"""Element types of Abaqus and CalculiX: nodes and faces. Pure data."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from gpusim.mesh.cell_types import CELL_TYPES

__all__ = ["NODES", "SOLID_TYPES", "face_table"]

# Solid element types that share nodes and node order with ours.
SOLID_TYPES = {
    "C3D8": "hex8", "C3D8I": "hex8", "C3D8R": "hex8", "C3D8H": "hex8",
    "C3D8IH": "hex8", "C3D8RH": "hex8",
    "C3D20": "hex20", "C3D20R": "hex20", "C3D20H": "hex20", "C3D20RH": "hex20",
    "C3D27": "hex27",
    "C3D4": "tet4", "C3D4H": "tet4", "C3D10": "tet10", "C3D10M": "tet10", "C3D10H": "tet10",
    "C3D10T": "tet10", "C3D6": "wedge6", "C3D6H": "wedge6", "C3D15": "wedge15", "C3D15H": "wedge15",
    "C3D5": "pyramid5",
}  # fmt: skip

# Nodes of element types that aren't solids; shells and plane elements may name faces.
_FLAT_TYPES = {
    "S3": 3, "S3R": 3, "STRI3": 3, "STRI65": 6, "S4": 4, "S4R": 4, "S6": 6, "S8": 8, "S8R": 8,
    "CPS3": 3, "CPS4": 4, "CPS6": 6, "CPS8": 8, "CPE3": 3, "CPE4": 4, "CPE6": 6, "CPE8": 8,
    "CPS4R": 4, "CPS8R": 8, "CPE4R": 4, "CPE8R": 8, "CAX3": 3, "CAX4": 4, "CAX6": 6, "CAX8": 8,
    "CAX8R": 8, "M3D3": 3, "M3D4": 4, "M3D6": 6, "M3D8": 8, "SFM3D3": 3, "SFM3D4": 4,
}  # fmt: skip
_LINE_TYPES = {
    "T3D2": 2, "T3D3": 3, "B31": 2, "B31R": 2, "B32": 3, "B32R": 3, "B31H": 2, "B32H": 3, "D": 3,
    "SPRING1": 1, "SPRING2": 2, "SPRINGA": 2, "DASHPOT1": 1, "DASHPOT2": 2, "DASHPOTA": 2,
    "CONN3D2": 2, "GAPUNI": 2, "MASS": 1, "ROTARYI": 1, "DCOUP3D": 1, "R3D3": 3, "R3D4": 4,
}  # fmt: skip

# Corners of the faces S1, S2, … (P1, P2, … of a load), counted as in the Abaqus manual.
_FACES = {
    8: ((0, 1, 2, 3), (4, 7, 6, 5), (0, 4, 5, 1), (1, 5, 6, 2), (2, 6, 7, 3), (3, 7, 4, 0)),
    4: ((0, 1, 2), (0, 3, 1), (1, 3, 2), (2, 3, 0)),
    6: ((0, 1, 2), (3, 5, 4), (0, 3, 4, 1), (1, 4, 5, 2), (2, 5, 3, 0)),
    5: ((0, 1, 2, 3), (0, 4, 1), (1, 4, 2), (2, 4, 3), (3, 4, 0)),
}

NODES = {
    **{name: CELL_TYPES[kind].nodes for name, kind in SOLID_TYPES.items()},
    **_FLAT_TYPES,
    **_LINE_TYPES,
}
"""Number of nodes of every element type that can be read."""


def face_table(kind: str) -> npt.NDArray[np.int64]:
    """(F,) local face number of a cell type for each Abaqus face S1, S2, …"""
    cell = CELL_TYPES[kind]
    ours = [frozenset(int(k) for k in row if 0 <= k < cell.corners) for row in cell.faces]
    return np.array([ours.index(frozenset(one)) for one in _FACES[cell.corners]])
