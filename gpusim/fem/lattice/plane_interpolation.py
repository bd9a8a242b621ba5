"""Interpolation between the planes of two lattices, one of which keeps some planes of the other."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt
from scipy.sparse import csr_matrix

from gpusim.fem.lattice.lattice import CORNERS, Lattice

__all__ = ["PlaneWeights", "plane_shares"]

Float = npt.NDArray[np.float64]
Long = npt.NDArray[np.int64]


def plane_shares(planes: Float, keep: Long) -> tuple[Long, Float]:
    """For each plane: number of the kept plane at or below it, and the share of the next one."""
    below = np.searchsorted(keep, np.arange(len(planes)), side="right") - 1
    below = np.minimum(below, len(keep) - 2)
    low, high = planes[keep[below]], planes[keep[below + 1]]
    return below, (planes - low) / (high - low)


@dataclass(frozen=True, eq=False)
class PlaneWeights:
    """Trilinear weights on ``fine`` of the nodes of ``coarse``, which has its planes ``keep``."""

    fine: Lattice
    coarse: Lattice
    keep: list[Long]

    @cached_property
    def kept(self) -> npt.NDArray[np.int32]:
        """(K,) numbers of the coarse nodes on the fine lattice."""
        node = self.fine.node[np.ix_(*self.keep)]
        return np.asarray(node[tuple(self.coarse.place.T)])

    @cached_property
    def axes(self) -> tuple[csr_matrix, csr_matrix, csr_matrix]:
        """(fine planes, coarse planes) weights along x, y and z."""
        x, y, z = (self._axis(axis) for axis in range(3))
        return x, y, z

    def _axis(self, axis: int) -> csr_matrix:
        planes, keep = self.fine.planes[axis], self.keep[axis]
        below, share = plane_shares(planes, keep)
        row = np.arange(len(planes))
        matrix = csr_matrix(
            (
                np.concatenate([1.0 - share, share]),
                (np.tile(row, 2), np.concatenate([below, below + 1])),
            ),
            shape=(len(planes), len(keep)),
        )
        matrix.eliminate_zeros()
        return matrix

    def interpolate(self, x: Float) -> Float:
        """(K,3) on the coarse nodes -> (N,3), axis after axis."""
        grid = self.coarse.spread(x)
        for axis in range(3):
            grid = _along(self.axes[axis], grid, axis)
        return self.fine.gathered(grid)

    def restrict(self, r: Float) -> Float:
        """The transpose, (N,3) -> (K,3)."""
        grid = self.fine.spread(r)
        for axis in range(3):
            grid = _along(csr_matrix(self.axes[axis].T), grid, axis)
        return self.coarse.gathered(grid)

    @cached_property
    def matrix(self) -> csr_matrix:
        """(fine nodes, coarse nodes)."""
        lattice, number = self.fine, self.coarse.node
        count = lattice.node_count
        below = np.empty((count, 3), dtype=np.int64)
        share = np.empty((count, 3))
        for axis in range(3):
            low, part = plane_shares(lattice.planes[axis], self.keep[axis])
            below[:, axis] = low[lattice.place[:, axis]]
            share[:, axis] = part[lattice.place[:, axis]]
        rows, columns, values = [], [], []
        for corner in CORNERS:
            value = np.where(corner == 1, share, 1.0 - share).prod(axis=1)
            used = np.flatnonzero(value > 0.0)
            at = below[used] + corner
            rows.append(used)
            columns.append(number[at[:, 0], at[:, 1], at[:, 2]])
            values.append(value[used])
        return csr_matrix(
            (np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))),
            shape=(count, self.coarse.node_count),
        )


def _along(weights: csr_matrix, grid: Float, axis: int) -> Float:
    """The values along one axis combined by ``weights``."""
    first = np.moveaxis(grid, axis, 0)
    result = weights @ first.reshape(len(first), -1)
    return np.moveaxis(result.reshape(-1, *first.shape[1:]), 0, axis)
