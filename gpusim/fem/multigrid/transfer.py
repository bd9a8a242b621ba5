"""Interpolation between levels, host side: by planes of lattices, by nodes, by aggregates."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy.sparse import bsr_matrix, csr_matrix

from gpusim.arrays.array_types import Bool, Float, Int, Long, Real
from gpusim.fem.lattice.lattice import CORNERS, Lattice
from gpusim.fem.sparse.matrix_product import Product


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
    def kept(self) -> Int:
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

    def interpolate(self, x: Real) -> Real:
        """(K,3) on the coarse nodes -> (N,3), axis after axis, in the dtype of x."""
        grid = self.coarse.spread(x)
        for axis, (weights, _) in enumerate(self._along_axes[x.dtype]):
            grid = _along(weights, grid, axis)
        return self.fine.gathered(grid)

    def restrict(self, r: Real) -> Real:
        """The transpose, (N,3) -> (K,3)."""
        grid = self.fine.spread(r)
        for axis, (_, transposed) in enumerate(self._along_axes[r.dtype]):
            grid = _along(transposed, grid, axis)
        return self.coarse.gathered(grid)

    @cached_property
    def _along_axes(self) -> dict[np.dtype[Any], list[tuple[csr_matrix, csr_matrix]]]:
        """The weights along x, y and z, and their transposes, in float32 and float64."""
        return {
            np.dtype(kind): [
                (axis.astype(kind), csr_matrix(axis.T.astype(kind))) for axis in self.axes
            ]
            for kind in (np.float32, np.float64)
        }

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


def _along(weights: csr_matrix, grid: Real, axis: int) -> Real:
    """The values along one axis combined by ``weights``."""
    first = np.moveaxis(grid, axis, 0)
    result = weights @ first.reshape(len(first), -1)
    return np.moveaxis(result.reshape(-1, *first.shape[1:]), 0, axis)


class NodeTransfer:
    """Nodal weights (N,K), the same for x, y and z, of the nodes ``kept`` (K,); fixed unknowns
    (N,3) are left out."""

    def __init__(self, interpolation: csr_matrix | PlaneWeights, free: Bool, kept: Int) -> None:
        self.interpolation, self.free, self.coarse_free = interpolation, free, free[kept]

    @cached_property
    def weights(self) -> csr_matrix:
        """(N,K)."""
        weights = self.interpolation
        return weights.matrix if isinstance(weights, PlaneWeights) else weights

    @cached_property
    def _back(self) -> csr_matrix:
        return self.weights.T.tocsr()

    @property
    def shape(self) -> tuple[int, int]:
        return self.free.size, self.coarse_free.size

    def interpolate(self, x: Real) -> Real:
        """(L,3K) -> (L,3N)."""
        nodes = np.where(self.coarse_free, x.reshape(len(x), -1, 3), 0.0)
        weights = self.interpolation
        interpolate = (
            weights.interpolate if isinstance(weights, PlaneWeights) else self.weights.__matmul__
        )
        moved = np.stack([np.where(self.free, interpolate(one), 0.0) for one in nodes])
        return moved.reshape(len(x), -1)

    def restrict(self, r: Real) -> Real:
        """The transpose, (L,3N) -> (L,3K)."""
        nodes = np.where(self.free, r.reshape(len(r), -1, 3), 0.0)
        weights = self.interpolation
        restrict = weights.restrict if isinstance(weights, PlaneWeights) else self._back.__matmul__
        moved = np.stack([np.where(self.coarse_free, restrict(one), 0.0) for one in nodes])
        return moved.reshape(len(r), -1)

    @cached_property
    def matrix(self) -> bsr_matrix:
        """(3N,3K) in blocks of 3x3."""
        weights = self.weights
        row = np.repeat(np.arange(weights.shape[0]), np.diff(weights.indptr))
        both = self.free[row] & self.coarse_free[weights.indices]
        data = (weights.data[:, None] * both)[:, :, None] * np.eye(3)
        return bsr_matrix((data, weights.indices, weights.indptr), shape=self.shape)


def in_single(prolongation: bsr_matrix) -> bsr_matrix:
    """The same in float32."""
    data = prolongation.data.astype(np.float32)
    return bsr_matrix((data, prolongation.indices, prolongation.indptr), shape=prolongation.shape)


class MatrixTransfer:
    """A prolongator with blocks of its own, multiplied by in its own dtype.

    In float32 a relative rounding e changes the preconditioner by some e sqrt(cond K) in the norm
    of the energy. It stays symmetric but for the rounding of sums.
    """

    def __init__(self, prolongation: bsr_matrix) -> None:
        self._prolongation = Product(prolongation)
        self._restriction = Product(prolongation.T)

    @property
    def shape(self) -> tuple[int, int]:
        return self._prolongation.unknowns, self._restriction.unknowns

    def interpolate(self, x: Real) -> Real:
        """(L,coarse) -> (L,fine)."""
        return _product(self._prolongation, x)

    def restrict(self, r: Real) -> Real:
        """The transpose."""
        return _product(self._restriction, r)

    @property
    def matrix(self) -> bsr_matrix:
        """(fine, coarse), in its own dtype."""
        return self._prolongation.matrix

    @property
    def transposed(self) -> bsr_matrix:
        """(coarse, fine)."""
        return self._restriction.matrix


def _product(product: Product, x: Real) -> Real:
    """A x for (L,n) float64; where A is float32 the range of x doesn't matter, as vectors are
    scaled by powers of two."""
    if product.matrix.dtype == np.float64:
        return product(x)
    _, power = np.frexp(np.abs(x).max(axis=1, keepdims=True))
    single = np.ldexp(x, -power).astype(np.float32)
    return np.asarray(np.ldexp(product(single).astype(np.float64), power))


Transfer = NodeTransfer | MatrixTransfer
