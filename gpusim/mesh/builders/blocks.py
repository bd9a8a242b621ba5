"""Structured blocks in a plane, joined at their common borders and extruded to hexahedra."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from gpusim.mesh.cell_types import CELL_TYPES

__all__ = ["HEX_OF_ORDER", "extruded", "ruled"]

Float = npt.NDArray[np.float64]
Int = npt.NDArray[np.int32]
Long = npt.NDArray[np.int64]

# element type -> steps of the node grid per element
HEX_OF_ORDER = {"hex8": 1, "hex20": 2, "hex27": 2}


def ruled(first: Float, last: Float, places: Float) -> Float:
    """A block (len(first), len(places), 2) between two lines of points, straight across them.

    ``places`` run from 0 (on ``first``) to 1 (on ``last``).
    """
    weight = places[None, :, None]
    return np.asarray((1.0 - weight) * first[:, None] + weight * last[:, None])


def extruded(blocks: Sequence[Float], heights: Float, kind: str) -> tuple[Float, Int]:
    """Points (N,3) and cells (M,k) of ``kind`` over planar blocks.

    Parameters
    ----------
    blocks
        Each (a, b, 2) points of a grid whose two directions and +z are right-handed. For a
        quadratic ``kind`` every second line is one of midside nodes (odd a and b).
    heights
        (c,) growing z of the node planes, midside planes included.

    Points that agree exactly become one node: neighbouring blocks share the numbers on their
    common border.
    """
    step = HEX_OF_ORDER[kind]
    flat = np.concatenate([block.reshape(-1, 2) for block in blocks])
    # as complex numbers: compared exactly, by x, then by y
    named, name = np.unique(flat[:, 0] + 1j * flat[:, 1], return_inverse=True)
    plane = np.stack([named.real, named.imag], axis=1)

    layer = len(plane)
    cells: list[Long] = []
    start = 0
    template = _template(kind)
    levels = np.arange(0, len(heights) - 1, step)
    for block in blocks:
        a, b = block.shape[:2]
        i, j, k = np.meshgrid(
            np.arange(0, a - 1, step), np.arange(0, b - 1, step), levels, indexing="ij"
        )
        local = (i.ravel()[:, None] + template[:, 0]) * b + j.ravel()[:, None] + template[:, 1]
        cells.append(name[start + local] + layer * (k.ravel()[:, None] + template[:, 2]))
        start += a * b
    z = np.repeat(heights, layer)
    points = np.column_stack([np.tile(plane, (len(heights), 1)), z])
    numbers = np.concatenate(cells)
    used = np.zeros(len(points), dtype=bool)
    used[numbers.ravel()] = True
    return points[used], (np.cumsum(used, dtype=np.int32) - np.int32(1))[numbers]


def _template(kind: str) -> Long:
    """(k,3) steps of each local node from the cell's lowest corner."""
    step = HEX_OF_ORDER[kind]
    ring = [(0, 0), (1, 0), (1, 1), (0, 1)]
    corners = step * np.array([(i, j, k) for k in (0, 1) for i, j in ring], dtype=np.int64)
    if step == 1:
        return corners
    middles = [corners[list(row)].sum(axis=0) // len(row) for row in CELL_TYPES[kind].parents]
    return np.concatenate([corners, np.array(middles)])
