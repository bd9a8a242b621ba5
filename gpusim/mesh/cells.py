"""Cell types: node order (VTK = Abaqus), faces, and how many nodes each has. Pure data."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

__all__ = ["CELL_TYPES", "CellType"]


@dataclass(frozen=True)
class CellType:
    """Topology of one cell type.

    ``faces`` is (F,4) int32 of local node numbers, counter-clockwise seen from outside;
    triangles are padded with -1. ``corner_neighbours`` (C,3) gives, for the Jacobian at each of
    the first C nodes, its three neighbours in right-handed order.
    """

    name: str
    nodes: int
    faces: npt.NDArray[np.int32]
    corner_neighbours: npt.NDArray[np.int32]


def _int32(rows: list[list[int]]) -> npt.NDArray[np.int32]:
    table = np.array(rows, dtype=np.int32)
    table.setflags(write=False)
    return table


CELL_TYPES: dict[str, CellType] = {
    "hex8": CellType(
        name="hex8",
        nodes=8,
        faces=_int32(
            [[0, 3, 2, 1], [4, 5, 6, 7], [0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]]
        ),
        corner_neighbours=_int32(
            [
                [1, 3, 4],
                [2, 0, 5],
                [3, 1, 6],
                [0, 2, 7],
                [7, 5, 0],
                [4, 6, 1],
                [5, 7, 2],
                [6, 4, 3],
            ]
        ),
    ),
    "tet4": CellType(
        name="tet4",
        nodes=4,
        faces=_int32([[0, 2, 1, -1], [0, 1, 3, -1], [1, 2, 3, -1], [2, 0, 3, -1]]),
        corner_neighbours=_int32([[1, 2, 3]]),
    ),
}
