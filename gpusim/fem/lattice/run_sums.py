"""What is left of rows of blocks that add up to zero: rounding, which a slender body feels."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from gpusim.arrays.error_free_sums import two_sum

__all__ = ["RowSums"]

Float = npt.NDArray[np.float64]
Real = npt.NDArray[np.floating]


@dataclass(frozen=True, eq=False)
class RowSums:
    """Sums of the matrices by kind of run (see `gpusim.fem.lattice.lattice_runs`), to twice the
    digits.

    A product by differences to one node in place of each node's own leaves the sum of a row's
    blocks times the difference of the two. That sum is rounding, yet along a slender body all rows
    have the same one, and forces of 1e-16 add up. ``beside``, ``rest`` (T,3,3,3 R) of the three
    rows of nodes, ``own`` (T,3 R,3 R) of all, for each of the R nodes of a run.
    """

    beside: Float
    rest: Float
    own: Float

    @staticmethod
    def of(matrices: Real) -> RowSums:
        """Of float64 matrices (T,3,9 (R + 2),3 R)."""
        kinds, wide = len(matrices), matrices.shape[-1]
        parts = matrices.reshape(kinds, 3, -1, 3, wide).transpose(2, 0, 1, 3, 4)
        beside, rest = _added(parts)
        total, left = _added(np.concatenate([beside, rest], axis=1).transpose(1, 0, 2, 3))
        own = np.zeros((kinds, wide, wide))
        for first in range(0, wide, 3):
            here = slice(first, first + 3)
            own[:, here, here] = (total + left)[:, :, here]
        return RowSums(beside, rest, own)

    def add_step(self, kind: int, row: int, step: Real, into: Real) -> None:
        """A row's nodes lie by ``step`` (…,3) from what they were taken relative to."""
        into += step @ self.beside[kind, row]
        into += step @ self.rest[kind, row]

    def take_own(self, kind: int, x: Real, into: Real) -> None:
        """Each node was to be relative to itself; ``x`` (…,3 R) relative to the first one."""
        into -= x @ self.own[kind]


def _added(terms: Real) -> tuple[Float, Float]:
    """The sum of (K,…) over the first axis and what it lacks, term by term."""
    total, rest = np.zeros(terms.shape[1:]), np.zeros(terms.shape[1:])
    for term in terms:
        total, lost = two_sum(total, term)
        rest += lost
    return total, rest
