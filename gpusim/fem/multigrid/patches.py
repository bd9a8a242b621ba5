"""Overlapping patches as a smoother, for nearly incompressible bodies on a lattice.

Near nu = 1/2 the soft motions keep the volume of every element, and a single node can't move
alone without changing some: Jacobi smoothing stalls. Blocks of 3 x 3 x 3 nodes can, so the
smoother adds up the exact solutions on such patches around every second node along each axis
(additive Schwarz; Schoeberl, Numer. Math. 84 (1999) 97, on why patches are needed). Patches with
the same cells and supports share an inverse, so a pass costs little more than a matrix product.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.sparse import bsr_matrix, csr_matrix

from gpusim.arrays.congruence import unique_rows
from gpusim.fem.assembly.element_batches import Group
from gpusim.fem.assembly.matrix_product import shared
from gpusim.fem.lattice.lattice import OFFSETS, Lattice
from gpusim.fem.multigrid.smoothers import Relaxation, chebyshev
from gpusim.parallel.cpu_budget import processors

__all__ = ["Patches", "make_patches"]

Float = npt.NDArray[np.float64]
Long = npt.NDArray[np.int64]
Bool = npt.NDArray[np.bool_]

# more distinct patches than this cost too much memory (52 kB each) and time
_MOST = 2000
_CHUNK = 512
# stronger smoothing than Jacobi's: a step costs little beside what the coarse level can't do
_DEGREE, _RANGE = 3, 30.0


class Patches:
    """r -> sum over patches of R^T A_p^-1 R r.

    ``nodes`` (P,27) node numbers, the number of nodes where a place is empty; ``kind`` (P,) which
    of the ``inverses`` (C,81,81) each patch has.
    """

    def __init__(self, nodes: Long, kind: Long, inverses: Float, count: int) -> None:
        order = np.argsort(kind, kind="stable")
        self._nodes, self._inverses, self._count = nodes[order], inverses, count
        ends = np.cumsum(np.bincount(kind, minlength=len(inverses))).tolist()
        self._ranges = [
            (number, start, min(start + _CHUNK, last))
            for number, (first, last) in enumerate(zip([0, *ends[:-1]], ends, strict=True))
            for start in range(first, last, _CHUNK)
        ]
        place = np.flatnonzero(self._nodes.ravel() < count)
        self._back = csr_matrix(
            (np.ones(len(place)), (self._nodes.ravel()[place], place)),
            shape=(count, self._nodes.size),
        )

    def apply(self, r: Float) -> Float:
        """(L,3N) -> (L,3N)."""
        return np.stack([self._apply(one) for one in r])

    def steps(self, largest: float) -> tuple[Relaxation, ...]:
        """Of Chebyshev's iteration, for the greatest eigenvalue of this times A."""
        return chebyshev(largest / _RANGE, largest, _DEGREE)

    def _apply(self, r: Float) -> Float:
        padded = np.concatenate([r.reshape(-1, 3), np.zeros((1, 3))])
        local = np.empty((len(self._nodes), 81))
        ways = processors()

        def solve(share: int) -> None:
            for number, first, last in self._ranges[share::ways]:
                part = padded[self._nodes[first:last]].reshape(last - first, 81)
                np.matmul(part, self._inverses[number], out=local[first:last])

        shared(solve, range(ways))
        return np.asarray(self._back @ local.reshape(-1, 3), dtype=np.float64).reshape(-1)


def make_patches(matrix: bsr_matrix, group: Group, lattice: Lattice, free: Bool) -> Patches | None:
    """Patches of K (3x3 blocks) on the free unknowns; None where too many are distinct."""
    # a patch reaches one node to either side: with an even number of nodes the last is covered too
    even = [np.arange(0, n, 2) for n in lattice.node.shape]
    grid = np.stack(np.meshgrid(*even, indexing="ij"), axis=-1).reshape(-1, 3)
    number = np.full(tuple(n + 2 for n in lattice.node.shape), lattice.node_count, dtype=np.int64)
    inside = number[1:-1, 1:-1, 1:-1]
    inside[...] = np.where(lattice.node >= 0, lattice.node, lattice.node_count)
    spot = grid[:, None, :] + OFFSETS[None] + 1
    nodes = number[spot[..., 0], spot[..., 1], spot[..., 2]]
    used = (nodes < lattice.node_count).any(axis=1)
    grid, nodes = grid[used], nodes[used]
    representative, kind = unique_rows(_keys(grid, nodes, group, lattice, free))
    if len(representative) > _MOST:
        return None
    held = np.concatenate([free, np.zeros((1, 3), dtype=bool)])
    inverses = np.stack([_inverse(matrix, nodes[k], held) for k in representative])
    return Patches(nodes, kind, inverses, lattice.node_count)


def _keys(grid: Long, nodes: Long, group: Group, lattice: Lattice, free: Bool) -> Long:
    """(P,91): kinds of the 4 x 4 x 4 cells around a patch, and which of its unknowns are free."""
    cells = np.full(tuple(n + 4 for n in lattice.cell.shape), -1, dtype=np.int64)
    cells[2:-2, 2:-2, 2:-2] = lattice.grid(group.kind)
    step = np.stack(np.meshgrid(*[np.arange(4)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    spot = grid[:, None, :] + step[None]
    around = cells[spot[..., 0], spot[..., 1], spot[..., 2]]
    bits = free.astype(np.int64) @ np.array([1, 2, 4])
    held = np.append(bits, np.int64(-1))[nodes]
    return np.concatenate([around, held], axis=1)


def _inverse(matrix: bsr_matrix, nodes: Long, held: Bool) -> Float:
    """(81,81) inverse on the free unknowns of one patch, zero elsewhere."""
    dense = np.zeros((27, 3, 27, 3))
    place = {int(node): k for k, node in enumerate(nodes.tolist()) if node < len(held) - 1}
    for node, k in place.items():
        first, last = matrix.indptr[node], matrix.indptr[node + 1]
        for column, block in zip(
            matrix.indices[first:last].tolist(), matrix.data[first:last], strict=True
        ):
            if column in place:
                dense[k, :, place[column]] = block
    free = np.flatnonzero(held[nodes].ravel())
    result = np.zeros((81, 81))
    small = dense.reshape(81, 81)[np.ix_(free, free)]
    result[np.ix_(free, free)] = np.linalg.inv(0.5 * (small + small.T))
    return 0.5 * (result + result.T)
