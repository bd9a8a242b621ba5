"""A preconditioner for the pressures of trilinear bricks on any mesh: a sparse matrix's Chebyshev.

S = B A^-1 B^T + C is about

    T = R^T W R + B D^-1 B^T + C,

where R averages the pressures around each node and W is volume over modulus there: smooth pressures
feel the first part, as they feel the mass in S. Pressures that alternate from cell to cell have no
averages; their forces alternate, too, so that A is as good as its diagonal D for them (see
``checkerboards``, which is cheaper where there is a lattice). T has a row of 27 numbers per cell:
a Chebyshev iteration of some twenty steps costs less than a product with K.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.sparse import csr_matrix, diags

from gpusim.fem.incompressibility.volume_split import VolumeSplit
from gpusim.fem.multigrid.smoothers import chebyshev

__all__ = ["PressureChebyshev"]

Float = npt.NDArray[np.float64]

# steps, and the ratio of eigenvalues over which they are even
_STEPS, _RANGE = 20, 300.0


class PressureChebyshev:
    """r -> Q^-1 r for pressures (M,), with Q about B A^-1 B^T + C; as ``PressureScaling``."""

    def __init__(self, split: VolumeSplit, diagonal: Float) -> None:
        softness = np.divide(1.0, diagonal, out=np.zeros_like(diagonal), where=diagonal > 0.0)
        b = split.divergence
        averages, weight = _averages(split, len(diagonal))
        t = b @ diags(softness.ravel()) @ b.T + averages.T @ diags(weight) @ averages
        t = csr_matrix(t + diags(split.compliance))
        self._inverse = 1.0 / t.diagonal()
        self._t = t
        # Gershgorin's bound: a quarter above the greatest eigenvalue, and never below
        largest = float((np.asarray(abs(t).sum(axis=1)).ravel() * self._inverse).max())
        self._steps = chebyshev(largest / _RANGE, largest, _STEPS)

    def apply(self, r: Float) -> Float:
        """Q^-1 r, (M,)."""
        x = np.zeros_like(r)
        d = np.zeros_like(r)
        left = r
        for number, step in enumerate(self._steps):
            if number:
                left = left - self._t @ d
            d = step.keep * d + step.gain * (self._inverse * left)
            x += d
        return x


def _averages(split: VolumeSplit, nodes: int) -> tuple[csr_matrix, Float]:
    """Averages of pressures around nodes, by volume, (N,M), and volume over modulus there (N,)."""
    count = len(split.volume)
    there = np.where(split.split, split.volume, 0.0)
    cell = np.repeat(np.arange(count), split.nodes.shape[1])
    node = split.nodes.ravel()
    total = np.bincount(node, weights=there[cell], minlength=nodes)
    share = there[cell] / np.where(total > 0.0, total, 1.0)[node]
    weight = np.bincount(node, weights=(there / split.shear)[cell], minlength=nodes)
    return csr_matrix((share, (node, cell)), shape=(nodes, count)), weight / split.nodes.shape[1]
