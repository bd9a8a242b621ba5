"""VTK's cell types, and its lists of cells as blocks of one kind."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from gpusim.errors import InputError
from gpusim.mesh.formats.cell_blocks import RawBlock
from gpusim.mesh.formats.handedness import right_handed_wedges

__all__ = ["VTK_KINDS", "vtk_blocks"]

Float = npt.NDArray[np.float64]
Long = npt.NDArray[np.int64]

# Number of a VTK cell type -> kind and number of nodes.
VTK_KINDS = {
    1: ("point1", 1), 3: ("line2", 2), 5: ("tri3", 3), 9: ("quad4", 4), 10: ("tet4", 4),
    12: ("hex8", 8), 13: ("wedge6", 6), 14: ("pyramid5", 5), 21: ("line3", 3), 22: ("tri6", 6),
    23: ("quad8", 8), 24: ("tet10", 10), 25: ("hex20", 20), 26: ("wedge15", 15),
    27: ("pyramid13", 13), 28: ("quad9", 9), 29: ("hex27", 27), 34: ("tri7", 7),
}  # fmt: skip


def vtk_blocks(points: Float, nodes: Long, ends: Long, types: Long, source: str) -> list[RawBlock]:
    """One block for each run of cells of one type.

    Parameters
    ----------
    nodes : node numbers of all cells, one cell after another.
    ends : (M,) place behind the last node of each cell.
    types : (M,) VTK's numbers.
    source : what a message begins with.

    Raises InputError for lists that don't fit each other.
    """
    if len(types) != len(ends):
        raise InputError(f"{source}: got {len(types)} cell types; expected {len(ends)}, as cells")
    starts = np.concatenate([np.zeros(1, np.int64), ends[:-1]])[: len(ends)]
    if (ends < starts).any() or (ends[-1] if len(ends) else 0) != len(nodes):
        raise InputError(f"{source}: the numbers of nodes per cell don't add up to {len(nodes)}")
    if nodes.size and not (nodes.min() >= 0 and nodes.max() < len(points)):
        wrong = nodes[(nodes < 0) | (nodes >= len(points))][0]
        raise InputError(
            f"{source}: a cell names node {wrong}, which isn't there; expected 0 … "
            f"{len(points) - 1}"
        )
    blocks = []
    runs = np.flatnonzero(np.diff(types, prepend=types[:1] - 1)) if len(types) else types
    for first, after in zip(runs, [*runs[1:], len(types)], strict=True):
        kind, width = VTK_KINDS.get(int(types[first]), (f"VTK type {types[first]}", 0))
        if not width:
            blocks.append(RawBlock(kind, np.zeros((after - first, 0), dtype=np.int64)))
            continue
        if (ends[first:after] - starts[first:after] != width).any():
            raise InputError(f"{source}: a {kind} hasn't got {width} nodes")
        rows = nodes[starts[first] : ends[after - 1]].reshape(-1, width)
        blocks.append(RawBlock(kind, right_handed_wedges(kind, points, rows)))
    return blocks
