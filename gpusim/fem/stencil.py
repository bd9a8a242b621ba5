"""Host products on a lattice whose rows repeat: small dense matrices in place of a sparse one.

Along the fastest axis four nodes at a time, a run, get their forces from the nodes in
the nine rows around them by one dense matrix, the same for every run of nodes with the same rows.
Of a whole slab of runs this is a product of two dense matrices, of which one stays in the cache:
it moves little more than the vectors and runs at the speed of BLAS. An assembled matrix has to be
read from memory every time, 27 blocks of 72 bytes a node.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt
from scipy.sparse import bsr_matrix

from gpusim.fem.block_rows import BlockRows
from gpusim.fem.congruence import unique_rows
from gpusim.fem.lattice import OFFSETS, Lattice
from gpusim.fem.product import pool, processors

__all__ = ["Stencil", "StencilProduct", "stencil_of"]

Float = npt.NDArray[np.float64]
Int = npt.NDArray[np.int32]
Long = npt.NDArray[np.int64]

# nodes in a run: more waste work on zeros, fewer are slow to multiply
_RUN = 4
_CHUNK = 4096
# kinds of runs, and the share of runs that aren't their slab's commonest kind, beyond which an
# assembled matrix is as good
_MOST_KINDS, _MOST_ODD = 256, 0.5
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
    def matrix(self) -> bsr_matrix:
        """The same as a SciPy block matrix."""
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
    place = lattice.place.astype(np.int64)
    for number, node in enumerate(first.tolist()):
        step = place[rows.neighbour[rows.start[node] : rows.start[node + 1]]] - place[node] + 1
        own = slice(int(rows.table_start[number]), int(rows.table_start[number + 1]))
        blocks[number, step @ [1, 3, 9]] = rows.table[own]
    blocks[:, 13] = rows.diagonal
    return Stencil(lattice, rows.row_class, blocks / scale)


class StencilProduct:
    """x (L,3N) -> K x for a stencil; the sums don't depend on the number of threads. Not to be
    called by two threads at once: it keeps its work space."""

    @staticmethod
    def of(stencil: Stencil) -> StencilProduct | None:
        """None where the rows repeat too little, or the lattice is too small or too empty."""
        lattice = stencil.lattice
        if lattice.node_count < max(_LEAST, lattice.node.size // 2):
            return None
        result = StencilProduct(stencil)
        return result if result.worthwhile else None

    def __init__(self, stencil: Stencil) -> None:
        self.stencil = stencil
        lattice = stencil.lattice
        order = _axes(lattice)
        node = lattice.node.transpose(order)
        slow, middle, fast = self._shape = node.shape
        self._runs = -(-fast // _RUN)
        present = node >= 0
        classes = np.full((slow, middle, self._runs * _RUN), len(stencil.blocks))
        classes[:, :, :fast][present] = stencil.row_class[node[present]]
        first, kind = unique_rows(classes.reshape(-1, _RUN))
        kind = kind.reshape(slow, middle * self._runs)
        self._common = np.array([np.bincount(row).argmax() for row in kind])
        odd = kind != self._common[:, None]
        self.worthwhile = len(first) <= _MOST_KINDS and float(odd.mean()) <= _MOST_ODD
        if not self.worthwhile:
            return
        blocks = np.concatenate([stencil.blocks, np.zeros((1, 27, 3, 3))])
        matrices = _run_matrices(blocks, classes.reshape(-1, _RUN)[first], order)
        self._matrices = matrices
        at, number = np.flatnonzero(odd), kind[odd]
        at = at[np.argsort(number, kind="stable")]
        kinds, count = np.unique(number, return_counts=True)
        self._odd = [
            (one, np.unravel_index(rows[start : start + _CHUNK], (slow, middle, self._runs)))
            for one, rows in zip(kinds.tolist(), np.split(at, np.cumsum(count)[:-1]), strict=True)
            for start in range(0, len(rows), _CHUNK)
        ]
        # where nodes are numbered along the lattice a vector is the grid itself
        self._in_order = bool((node.ravel() == np.arange(node.size)).all())
        self._present, self._number = present, node[present]
        self._padded = np.zeros((slow + 2, middle + 2, self._runs * _RUN + 2, 3))
        self._result = np.empty((slow, middle, self._runs, 3 * _RUN))

    @property
    def matrix(self) -> bsr_matrix:
        """The same as a SciPy block matrix."""
        return self.stencil.matrix

    @property
    def unknowns(self) -> int:
        return 3 * self.stencil.lattice.node_count

    def __call__(self, x: Float) -> Float:
        return np.stack([self._one(one) for one in x])

    def _one(self, x: Float) -> Float:
        slow, middle, fast = self._shape
        inner = self._padded[1:-1, 1:-1, 1 : fast + 1]
        if self._in_order:
            inner[:] = x.reshape(*self._shape, 3)
        else:
            inner[self._present] = x.reshape(-1, 3)[self._number]
        cuts = np.linspace(0, slow, min(processors(), slow) + 1).astype(int).tolist()
        list(pool().map(self._slabs, cuts[:-1], cuts[1:]))
        list(pool().map(self._odd_runs, self._odd))
        grid = self._result.reshape(slow, middle, self._runs * _RUN, 3)[:, :, :fast]
        if self._in_order:
            return grid.reshape(-1)
        result = np.empty((len(self._number), 3))
        result[self._number] = grid[self._present]
        return result.reshape(-1)

    def _slabs(self, first: int, stop: int) -> None:
        """Every run of some slabs by the matrix of the slab's commonest kind."""
        slow, middle, _ = self._shape
        s = self._padded.strides
        # what a run sees in a row, in three slabs
        windows = np.lib.stride_tricks.as_strided(
            self._padded,
            (slow, middle + 2, self._runs, 3, 3 * (_RUN + 2)),
            (s[0], s[1], _RUN * s[2], s[0], s[3]),
        )
        count = middle * self._runs
        seen = np.empty(windows.shape[1:])
        rows = seen.reshape(-1, 9 * (_RUN + 2))
        part = np.empty((count, 3 * _RUN))
        for slab in range(first, stop):
            seen[:] = windows[slab]
            into = self._result[slab].reshape(count, -1)
            matrix = self._matrices[self._common[slab]]
            np.matmul(rows[:count], matrix[0], out=into)
            for row in (1, 2):
                begin = row * self._runs
                np.matmul(rows[begin : begin + count], matrix[row], out=part)
                into += part

    def _odd_runs(self, task: tuple[int, tuple[Long, ...]]) -> None:
        """Runs of another kind than their slab's commonest."""
        kind, place = task
        slow, middle, _ = self._shape
        s = self._padded.strides
        windows = np.lib.stride_tricks.as_strided(
            self._padded,
            (slow, middle, self._runs, 3, 3, 3 * (_RUN + 2)),
            (s[0], s[1], _RUN * s[2], s[1], s[0], s[3]),
        )
        seen = windows[place].reshape(len(place[0]), -1)
        self._result[place] = seen @ self._matrices[kind].reshape(seen.shape[1], -1)


def _axes(lattice: Lattice) -> tuple[int, int, int]:
    """The lattice's axes from slow to fast in the numbering of its nodes."""
    node = lattice.node.astype(np.int64)
    step = []
    for axis in range(3):
        a, b = np.moveaxis(node, axis, 0)[:-1], np.moveaxis(node, axis, 0)[1:]
        both = (a >= 0) & (b >= 0)
        step.append(float(np.median(np.abs(b[both] - a[both]))) if both.any() else 0.0)
    order = sorted(range(3), key=lambda axis: -step[axis])
    return order[0], order[1], order[2]


def _run_matrices(blocks: Float, runs: Long, order: tuple[int, int, int]) -> Float:
    """(T, 3, 9 (R + 2), 3 R): for each kind of run (T,R classes) and each of three rows, what the
    nodes in three slabs and R + 2 places give to the forces of the run."""
    count, length = runs.shape
    result = np.zeros((count, 3, 3, length + 2, 3, length, 3))
    for number, offset in enumerate(OFFSETS.tolist()):
        slab, row, place = (offset[axis] + 1 for axis in order)
        for k in range(length):
            block = blocks[runs[:, k], number]
            result[:, row, slab, k + place, :, k, :] += block.transpose(0, 2, 1)
    return result.reshape(count, 3, 9 * (length + 2), 3 * length)
