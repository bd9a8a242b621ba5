"""Rectilinear hex8 meshes: nodes on a lattice make neighbours, repeats and coarsening cheap.

A lattice is found in the mesh itself, whoever made it and in whatever order its nodes and cells
come. It may have holes, notches and several parts; only the node planes must be shared.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from gpusim.arrays.array_types import Bool, Float, Int, Long

T = TypeVar("T", bound=np.generic)

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
# bits of a plane's number where three of them stand in one integer
_BITS = 21
_CHUNK = 4096
# one node in this many is looked at for the planes that there are, here and there by a prime
_SPARSE, _SCATTER = 16, 7_368_787


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

    @cached_property
    def _position(self) -> Long:
        """(N,) flat position of each node in the grid."""
        return np.asarray(np.ravel_multi_index(tuple(self.place.T), self.node.shape))

    def spread(self, values: npt.NDArray[T]) -> npt.NDArray[T]:
        """(X,Y,Z,k): ``values`` (N,k) of the nodes in their places, 0 where there is none."""
        grid = np.take(values, self.node.ravel(), axis=0, mode="wrap")
        if self.node_count < self.node.size:
            grid[self.node.ravel() < 0] = 0
        return grid.reshape(*self.node.shape, -1)

    def gathered(self, grid: npt.NDArray[T]) -> npt.NDArray[T]:
        """(N,…) of the nodes from a grid (X,Y,Z,…)."""
        flat = grid.reshape(self.node.size, *grid.shape[3:])
        return np.asarray(np.take(flat, self._position, axis=0))

    def corner_nodes(self) -> tuple[Long, Int]:
        """(flat positions of the cells (M,), their nodes (M,8) in VTK order)."""
        filled = self.cell >= 0
        nodes = np.empty((int(filled.sum()), len(CORNERS)), dtype=np.int32)
        for corner, into in zip(CORNERS.tolist(), nodes.T, strict=True):
            x, y, z = (
                slice(first, first + count)
                for first, count in zip(corner, self.cell.shape, strict=True)
            )
            into[:] = self.node[x, y, z][filled]
        return np.flatnonzero(filled), nodes

    def grid(self, values: Long) -> Long:
        """(X-1,Y-1,Z-1): ``values`` (M,), in the order of ``corner_nodes``, in their places; -1
        where there is no cell."""
        result = np.full(self.cell.shape, -1, dtype=np.int64)
        result[self.cell >= 0] = values
        return result

    def around(self, per_cell: Long, outside: int = -1, nodes: Long | None = None) -> Long:
        """(N,8): the value in the cell at each corner of a node; ``per_cell`` is (X-1,Y-1,Z-1).

        Column k is the cell of which the node is corner k. ``nodes``: of these only.
        """
        place = self.place if nodes is None else self.place[nodes]
        return _beside(per_cell, place, -CORNERS, outside)

    def linked(self, nodes: Long) -> Bool:
        """(K,27) whether a cell joins each of ``nodes`` (K,) and another one at ``OFFSETS``."""
        present = self.around((self.cell >= 0).astype(np.int64), 0, nodes) == 1
        result = np.zeros((len(nodes), 27), dtype=bool)
        for corner in range(len(CORNERS)):
            result[:, node_offsets(corner)] |= present[:, corner, None]
        result[:, 13] = False
        return result

    def neighbours(self) -> Int:
        """(N,27) node numbers at ``OFFSETS``, -1 where there is none."""
        return _beside(self.node, self.place, OFFSETS, -1)


def _beside(grid: npt.NDArray[T], place: Int, steps: Long, outside: int) -> npt.NDArray[T]:
    """(N,S): what ``grid`` has ``steps`` (S,3) from each ``place`` (N,3), or ``outside``."""
    padded = np.pad(grid, 1, constant_values=outside)
    across = np.array([padded.shape[1] * padded.shape[2], padded.shape[2], 1])
    here = (place.astype(np.int64) + 1) @ across
    return np.asarray(padded.ravel()[here[:, None] + steps @ across])


def node_offsets(corner: int) -> Long:
    """(8,) number in ``OFFSETS`` of each corner of a cell, seen from its own ``corner``."""
    step = CORNERS - CORNERS[corner] + 1
    return np.asarray(step[:, 0] + 3 * step[:, 1] + 9 * step[:, 2])


def find_lattice(points: Float, block: Int) -> Lattice | None:
    """The lattice of hex8 cells (M,8), or None where they aren't axis-parallel bricks on one.

    Every node must be used by a cell.
    """
    # column by column: several times as fast as along the first axis
    low = np.array([points[:, axis].min() for axis in range(3)])
    high = np.array([points[:, axis].max() for axis in range(3)])
    grid = float((high - low).max()) * _SAME
    planes, place = [], np.empty(points.shape, dtype=np.int32)
    for axis in range(3):
        coordinate = np.rint((points[:, axis] - low[axis]) / grid).astype(np.int64)
        value, number = _planes(coordinate)
        if (np.diff(value) <= 2).any():
            return None
        place[:, axis] = number
        plane = np.empty(len(value))
        # the coordinate of the first of its nodes
        plane[number[::-1]] = points[::-1, axis]
        planes.append(plane)
    shape = len(planes[0]), len(planes[1]), len(planes[2])
    if crowded(shape, len(points)):
        return None
    low_corner = _lowest_corners(place, block)
    grids = None if low_corner is None else filled_grids(shape, place, low_corner)
    if grids is None:
        return None
    return Lattice(*grids, place, (planes[0], planes[1], planes[2]))


def crowded(shape: tuple[int, ...], nodes: int) -> bool:
    """Whether a grid is too large for its number of ``nodes``."""
    return int(np.prod(shape, dtype=np.int64)) > nodes / _FULLEST


def filled_grids(shape: tuple[int, ...], place: Int, low_corner: Int) -> tuple[Int, Int] | None:
    """``node`` and ``cell`` of a `Lattice` with ``shape`` planes, from the ``place`` (N,3) of nodes
    and that of cells (M,3); None where there are two at one place: parts that touch, or lie over
    one another, without being joined."""
    node = np.full(shape, -1, dtype=np.int32)
    cell = np.full(tuple(n - 1 for n in shape), -1, dtype=np.int32)
    for grid, places in ((node, place), (cell, low_corner)):
        grid[tuple(places.T)] = np.arange(len(places), dtype=np.int32)
        if int((grid >= 0).sum()) != len(places):
            return None
    return node, cell


def _planes(coordinate: Long) -> tuple[Long, Long]:
    """Distinct values, and the number of each one's own. Those of some nodes are most often all
    that there are."""
    sampled = coordinate[np.arange(0, len(coordinate), _SPARSE) * _SCATTER % len(coordinate)]
    value = np.unique(sampled)
    number = np.minimum(np.searchsorted(value, coordinate), len(value) - 1)
    if not (value[number] == coordinate).all():
        value = np.unique(coordinate)
        number = np.searchsorted(value, coordinate)
    return value, number


def _lowest_corners(place: Int, block: Int) -> Int | None:
    """(M,3) planes of the least corner of each cell; None where one isn't a brick of the lattice.

    The corners of a cell that is in order follow its least one by eight known steps.
    """
    code = place.astype(np.int64) @ np.array([1, 1 << _BITS, 1 << 2 * _BITS])
    usual = CORNERS @ np.array([1, 1 << _BITS, 1 << 2 * _BITS])
    result = np.empty((len(block), 3), dtype=np.int32)
    for start in range(0, len(block), _CHUNK):
        cells = block[start : start + _CHUNK]
        corners = code[cells]
        if (corners - corners[:, :1] == usual).all():
            result[start : start + _CHUNK] = place[cells[:, 0]]
            continue
        lowest = corners.argmin(axis=1)[:, None]
        step: Long = corners - np.take_along_axis(corners, lowest, axis=1)
        x, y, z = step & 1, step >> _BITS & 1, step >> 2 * _BITS & 1
        if (step != x + (y << _BITS) + (z << 2 * _BITS)).any():
            return None
        if (np.bitwise_or.reduce(1 << (x + 2 * y + 4 * z), axis=1) != 255).any():
            return None
        result[start : start + _CHUNK] = place[np.take_along_axis(cells, lowest, axis=1)[:, 0]]
    return result
