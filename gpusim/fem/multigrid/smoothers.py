"""Block-Jacobi and Chebyshev smoothing, host side; ``relaxation`` has the device's."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gpusim.arrays.array_types import Real
from gpusim.fem.sparse.block_rows import block_diagonal
from gpusim.fem.sparse.matrix_product import Product, Vectors


@dataclass(frozen=True)
class Relaxation:
    """d = keep d + gain D^-1 r, x = x + d of one step; factors rounded to float32, as kernels take
    them."""

    keep: float
    gain: float

    def __post_init__(self) -> None:
        for name in ("keep", "gain"):
            object.__setattr__(self, name, float(np.float32(getattr(self, name))))


def chebyshev(low: float, high: float, degree: int) -> tuple[Relaxation, ...]:
    """Steps of the Chebyshev iteration for eigenvalues of D^-1 A in [low, high].

    Saad, Iterative Methods for Sparse Linear Systems (2003), algorithm 12.1.
    """
    centre, half = 0.5 * (high + low), 0.5 * (high - low)
    ratio = centre / half
    rho = 1.0 / ratio
    steps = [Relaxation(0.0, 1.0 / centre)]
    for _ in range(degree - 1):
        following = 1.0 / (2.0 * ratio - rho)
        steps.append(Relaxation(following * rho, 2.0 * following / half))
        rho = following
    return tuple(steps)


class BlockJacobi:
    """r -> D^-1 r with the inverted diagonal blocks ``inverse`` (B,s,s), zero on fixed unknowns."""

    def __init__(self, inverse: Real) -> None:
        self._inverse = Product(block_diagonal(inverse))

    def apply(self, r: Vectors) -> Vectors:
        """(L,n) for (L,n), both of the blocks' dtype."""
        return self._inverse(r)
