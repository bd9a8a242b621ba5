"""Sums and halves of float64 numbers whose errors are known.

Ogita, Rump & Oishi, Accurate sum and dot product, SIAM J. Sci. Comput. 26 (2005).
"""

from __future__ import annotations

import numpy as np

from gpusim.arrays.array_types import Float

_SPLITTER = 2.0**27 + 1.0


def two_sum(a: Float, b: Float) -> tuple[Float, Float]:
    """(a + b rounded, what that lacks); both together are a + b exactly (Knuth)."""
    total = a + b
    back = total - a
    return total, (a - (total - back)) + (b - back)


def high_half(a: Float) -> Float:
    """``a`` rounded to 26 bits; ``a`` less that has as many at most, and products of two such
    numbers are exact (Veltkamp). For |a| below 1e300."""
    scaled = _SPLITTER * a
    return np.asarray(scaled - (scaled - a))
