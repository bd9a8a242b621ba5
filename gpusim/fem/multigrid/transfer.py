"""Interpolation between levels, host side."""

from __future__ import annotations

from functools import cached_property

import numpy as np
import numpy.typing as npt
from scipy.sparse import bsr_matrix, csr_matrix

from gpusim.fem.assembly.matrix_product import Product
from gpusim.fem.lattice.plane_interpolation import PlaneWeights

__all__ = ["MatrixTransfer", "NodeTransfer", "Transfer", "in_single"]

Float = npt.NDArray[np.float64]
Bool = npt.NDArray[np.bool_]


class NodeTransfer:
    """Nodal weights (N,K), the same for x, y and z; fixed unknowns (N,3), (K,3) are left out."""

    def __init__(
        self, interpolation: csr_matrix | PlaneWeights, free: Bool, coarse_free: Bool
    ) -> None:
        self.interpolation, self.free, self.coarse_free = interpolation, free, coarse_free

    @cached_property
    def weights(self) -> csr_matrix:
        """(N,K)."""
        own = self.interpolation
        return own.matrix if isinstance(own, PlaneWeights) else own

    @cached_property
    def _back(self) -> csr_matrix:
        return self.weights.T.tocsr()

    @property
    def shape(self) -> tuple[int, int]:
        return self.free.size, self.coarse_free.size

    def interpolate(self, x: Float) -> Float:
        """(L,3K) -> (L,3N)."""
        nodes = np.where(self.coarse_free, x.reshape(len(x), -1, 3), 0.0)
        own = self.interpolation
        there = own.interpolate if isinstance(own, PlaneWeights) else self.weights.__matmul__
        moved = np.stack([np.where(self.free, there(one), 0.0) for one in nodes])
        return moved.reshape(len(x), -1)

    def restrict(self, r: Float) -> Float:
        """The transpose, (L,3N) -> (L,3K)."""
        nodes = np.where(self.free, r.reshape(len(r), -1, 3), 0.0)
        own = self.interpolation
        back = own.restrict if isinstance(own, PlaneWeights) else self._back.__matmul__
        moved = np.stack([np.where(self.coarse_free, back(one), 0.0) for one in nodes])
        return moved.reshape(len(r), -1)

    def blocks(self) -> bsr_matrix:
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

    def interpolate(self, x: Float) -> Float:
        """(L,coarse) -> (L,fine)."""
        return _product(self._prolongation, x)

    def restrict(self, r: Float) -> Float:
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


def _product(product: Product, x: Float) -> Float:
    """A x for (L,n) float64; where A is float32 the range of x doesn't matter, as vectors are
    scaled by powers of two."""
    if product.matrix.dtype == np.float64:
        return product(x)
    _, power = np.frexp(np.abs(x).max(axis=1, keepdims=True))
    single = np.ldexp(x, -power).astype(np.float32)
    return np.ldexp(product(single).astype(np.float64), power)


Transfer = NodeTransfer | MatrixTransfer
