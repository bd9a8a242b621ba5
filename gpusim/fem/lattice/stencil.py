"""Host products on a lattice whose rows repeat: small dense matrices in place of a sparse one.

See ``lattice_runs`` for how. An assembled matrix has to be read from memory every time, 27 blocks
of 72 bytes a node.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy.sparse import bsr_matrix

from gpusim.arrays.array_types import Bool, Float, Int, Real
from gpusim.fem.lattice.lattice import Lattice
from gpusim.fem.lattice.lattice_runs import RowSums, RunLayout, RunPattern, numbering_axes
from gpusim.fem.sparse.block_rows import BlockRows, invert_repeated
from gpusim.fem.sparse.matrix_product import Product, Vectors

# fewer nodes aren't worth the trouble
_LEAST = 4000


@dataclass(frozen=True, eq=False)
class Stencil:
    """Block rows by place: ``blocks`` (C,27,3,3) at ``OFFSETS`` of each distinct row, zero where
    there is no neighbour, and ``row_class`` (N,) int32."""

    lattice: Lattice
    row_class: Int
    blocks: Float

    @property
    def diagonal(self) -> Float:
        """(C,3,3) diagonal blocks."""
        return self.blocks[:, 13]

    @cached_property
    def product(self) -> StencilProduct | None:
        """See ``StencilProduct.of``."""
        return StencilProduct.of(self)

    @property
    def operator(self) -> Product | StencilProduct:
        """``product``, or that of the assembled matrix."""
        return Product(self.matrix) if self.product is None else self.product

    @property
    def matrix(self) -> bsr_matrix:
        """The same as a SciPy block matrix, which is many times as large and isn't kept."""
        neighbours = self.lattice.neighbours()
        here = neighbours >= 0
        start = np.concatenate([[0], np.cumsum(here.sum(axis=1))])
        at = (27 * self.row_class.astype(np.int64)[:, None] + np.arange(27))[here]
        size = 3 * self.lattice.node_count
        data = self.blocks.reshape(-1, 3, 3)[at]
        return bsr_matrix((data, neighbours[here], start), shape=(size, size))


def stencil_of(rows: BlockRows, lattice: Lattice, scale: float) -> Stencil:
    """The rows of K / scale by their place on the lattice."""
    _, first = np.unique(rows.row_class, return_index=True)
    blocks = np.zeros((rows.class_count, 27, 3, 3))
    # the table is in the order of the neighbours, class by class
    blocks[lattice.linked(first)] = rows.table
    blocks[:, 13] = rows.diagonal
    return Stencil(lattice, rows.row_class, blocks / scale)


class StencilProduct:
    """x (L,3N) -> K x for a stencil, in the dtype of x, float32 or float64; the sums
    don't depend on the number of threads. Not to be called by two threads at once: it keeps its
    work space."""

    @staticmethod
    def of(stencil: Stencil) -> StencilProduct | None:
        """None where the rows repeat too little, or the lattice is too small or too empty."""
        lattice = stencil.lattice
        if lattice.node_count < max(_LEAST, lattice.node.size // 2):
            return None
        layout = RunLayout(lattice, numbering_axes(lattice))
        pattern = RunPattern(layout, stencil.row_class, len(stencil.blocks))
        return StencilProduct(stencil, pattern) if pattern.worthwhile else None

    def __init__(self, stencil: Stencil, pattern: RunPattern) -> None:
        self.stencil, self.layout = stencil, pattern.layout
        self._pattern = pattern
        self._kept: dict[np.dtype[Any], tuple[Real, Real, Real]] = {}

    @property
    def matrix(self) -> bsr_matrix:
        """The same as a SciPy block matrix."""
        return self.stencil.matrix

    def block_inverse(self, free: Bool) -> Float:
        """Inverted diagonal blocks (N,3,3), zero where not ``free`` (N,3)."""
        return invert_repeated(self.stencil.diagonal, self.stencil.row_class, free)

    @property
    def unknowns(self) -> int:
        return 3 * self.stencil.lattice.node_count

    def __call__(self, x: Vectors, in_differences: bool = False) -> Vectors:
        result = np.empty_like(x)
        matrices, stored, image = self._in(x.dtype)
        for one, into in zip(x, result, strict=True):
            self.layout.put(one, stored)
            self._pattern.apply(
                matrices, stored, image, relative=self._sums if in_differences else None
            )
            self.layout.get(image, into)
        return result

    def _in(self, dtype: np.dtype[Any]) -> tuple[Real, Real, Real]:
        """The matrices, and room for a vector and its product."""
        if dtype not in self._kept:
            matrices = self._pattern.matrices(self.stencil.blocks, dtype)
            self._kept[dtype] = matrices, self.layout.zeros(dtype), self.layout.zeros(dtype)
        return self._kept[dtype]

    @property
    def in_differences(self) -> Callable[[Float], Float] | None:
        """(L,N,3) -> K x as accurate as from differences u_j - u_i, for rows that add up to zero;
        None where places are empty."""
        if not bool(self.layout.present.all()):
            return None
        return lambda x: self(x.reshape(len(x), -1), True).reshape(x.shape)

    @cached_property
    def _sums(self) -> RowSums:
        return RowSums.of(self._in(np.dtype(np.float64))[0])
