"""Rectilinear hex8 meshes: nodes on a lattice make neighbours, repeats and coarsening cheap.

A lattice is found in the mesh itself, whoever made it and in whatever order its nodes and cells
come. It may have holes, notches and several parts; only the node planes must be shared.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

__all__ = ["CORNERS", "OFFSETS", "Lattice", "find_lattice", "node_offsets"]

Float = npt.NDArray[np.float64]
Int = npt.NDArray[np.int32]
Long = npt.NDArray[np.int64]

# lattice position of the hex8 corners, VTK order
CORNERS = np.array(
    [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]]
)
# the 27 neighbours of a node, itself in the middle (number 13), x fastest
OFFSETS = np.stack(np.meshgrid([-1, 0, 1], [-1, 0, 1], [-1, 0, 1], indexing="ij"), -1).reshape(
    27, 3
)[:, ::-1]

# node coordinates are compared to this fraction of the body's size
_SAME = 1e-10
# a lattice with fewer nodes than this share of its bounding grid isn't worth the grid
_FULLEST = 0.05


@dataclass(frozen=True, eq=False)
class Lattice:
    """``node`` (X,Y,Z) int32 node numbers, -1 where there is none; ``cell`` (X-1,Y-1,Z-1) cell
    numbers likewise; ``place`` (N,3) int32 plane numbers of each node; ``planes`` the coordinates
    of the node planes along x, y and z."""

    node: Int
    cell: Int
    place: Int
    planes: tuple[Float, Float, Float]

    @property
    def node_count(self) -> int:
        return len(self.place)

    def corner_nodes(self) -> tuple[Long, Int]:
        """(flat positions of the cells (M,), their nodes (M,8) in VTK order)."""
        at = np.argwhere(self.cell >= 0)
        corner = at[:, None, :] + CORNERS[None]
        nodes = self.node[corner[..., 0], corner[..., 1], corner[..., 2]]
        place = np.asarray(np.ravel_multi_index(tuple(at.T), self.cell.shape))
        return place.reshape(-1), np.asarray(nodes)

    def grid(self, values: Long) -> Long:
        """(X-1,Y-1,Z-1): ``values`` (M,), in the order of ``corner_nodes``, in their places; -1
        where there is no cell."""
        result = np.full(self.cell.shape, -1, dtype=np.int64)
        result[self.cell >= 0] = values
        return result

    def around(self, per_cell: Long, outside: int = -1) -> Long:
        """(N,8): the value in the cell at each corner of a node; ``per_cell`` is (X-1,Y-1,Z-1).

        Column k is the cell of which the node is corner k.
        """
        padded = np.full(tuple(n + 2 for n in per_cell.shape), outside, dtype=np.int64)
        padded[1:-1, 1:-1, 1:-1] = per_cell
        x, y, z = self.place.T
        return np.stack(
            [padded[x + 1 - a, y + 1 - b, z + 1 - c] for a, b, c in CORNERS.tolist()], axis=1
        )

    def neighbours(self) -> Int:
        """(N,27) node numbers at ``OFFSETS``, -1 where there is none."""
        padded = np.full(tuple(n + 2 for n in self.node.shape), -1, dtype=np.int32)
        padded[1:-1, 1:-1, 1:-1] = self.node
        flat = padded.ravel()
        step = np.array([padded.shape[1] * padded.shape[2], padded.shape[2], 1])
        own = (self.place.astype(np.int64) + 1) @ step
        return np.asarray(flat[own[:, None] + OFFSETS @ step])


def node_offsets(corner: int) -> Long:
    """(8,) number in ``OFFSETS`` of each corner of a cell, seen from its own ``corner``."""
    step = CORNERS - CORNERS[corner] + 1
    return np.asarray(step[:, 0] + 3 * step[:, 1] + 9 * step[:, 2])


def find_lattice(points: Float, block: Int) -> Lattice | None:
    """The lattice of hex8 cells (M,8), or None where they aren't axis-parallel bricks on one.

    Every node must be used by a cell.
    """
    low, high = points.min(axis=0), points.max(axis=0)
    grid = float((high - low).max()) * _SAME
    planes, place = [], np.empty(points.shape, dtype=np.int32)
    for axis in range(3):
        value, first, number = np.unique(
            np.rint((points[:, axis] - low[axis]) / grid).astype(np.int64),
            return_index=True,
            return_inverse=True,
        )
        if (np.diff(value) <= 2).any():
            return None
        planes.append(points[first, axis])
        place[:, axis] = number
    shape = tuple(len(one) for one in planes)
    if int(np.prod(shape, dtype=np.int64)) > len(points) / _FULLEST:
        return None
    low_corner = place[block[:, 0]]
    for k in range(1, 8):
        np.minimum(low_corner, place[block[:, k]], out=low_corner)
    seen = np.zeros(len(block), dtype=np.int64)
    for k in range(8):
        step = place[block[:, k]] - low_corner
        if ((step < 0) | (step > 1)).any():
            return None
        seen |= np.int64(1) << (step[:, 0] + 2 * step[:, 1] + 4 * step[:, 2]).astype(np.int64)
    if (seen != 255).any():
        return None
    node = np.full(shape, -1, dtype=np.int32)
    node[tuple(place.T)] = np.arange(len(points), dtype=np.int32)
    if int((node >= 0).sum()) != len(points):
        return None  # two nodes at one place: parts that touch without being joined
    cell = np.full(tuple(n - 1 for n in shape), -1, dtype=np.int32)
    cell[tuple(low_corner.T)] = np.arange(len(block), dtype=np.int32)
    if int((cell >= 0).sum()) != len(block):
        return None
    return Lattice(node, cell, place, (planes[0], planes[1], planes[2]))
