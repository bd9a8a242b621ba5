"""Cells turned right-handed where a file format leaves the sense of their corners open."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from gpusim.mesh.cell_types import CELL_TYPES

__all__ = ["right_handed_cells", "right_handed_wedges"]

Float = npt.NDArray[np.float64]
Long = npt.NDArray[np.int64]

# Corners in the order of the mirrored cell; the three ends of the edges at corner 0.
_MIRROR = {
    "tet4": ((0, 2, 1, 3), (1, 2, 3)),
    "hex8": ((0, 3, 2, 1, 4, 7, 6, 5), (1, 3, 4)),
    "wedge6": ((0, 2, 1, 3, 5, 4), (1, 2, 3)),
    "pyramid5": ((0, 3, 2, 1, 4), (1, 3, 4)),
}


def right_handed_wedges(kind: str, points: Float, nodes: Long) -> Long:
    """Every left-handed wedge mirrored; other kinds as they are.

    VTK's manual defines its wedge the other way round than Abaqus and the rest, and programs
    write either.
    """
    if kind not in CELL_TYPES or CELL_TYPES[kind].linear != "wedge6" or not len(nodes):
        return nodes
    return np.where(_left(kind, points, nodes)[:, None], nodes[:, _order(kind)], nodes)


def right_handed_cells(kind: str, points: Float, nodes: Long) -> Long:
    """All cells mirrored if every one of them is left-handed, as MED counts corners; else none."""
    if kind not in CELL_TYPES or not len(nodes) or not _left(kind, points, nodes).all():
        return nodes
    return nodes[:, _order(kind)]


def _left(kind: str, points: Float, nodes: Long) -> npt.NDArray[np.bool_]:
    _, ends = _MIRROR[CELL_TYPES[kind].linear]
    edges = points[nodes[:, ends]] - points[nodes[:, :1]]
    volume = np.einsum("mi,mi->m", np.cross(edges[:, 0], edges[:, 1]), edges[:, 2])
    return np.asarray(volume < 0.0)


def _order(kind: str) -> list[int]:
    """Node numbers of the mirrored cell, midside nodes included."""
    cell = CELL_TYPES[kind]
    mirror, _ = _MIRROR[cell.linear]
    place = {frozenset(group): cell.corners + k for k, group in enumerate(cell.parents)}
    return [
        *mirror,
        *(place[frozenset(mirror[corner] for corner in group)] for group in cell.parents),
    ]
