"""The rotation of many deformation gradients, by components: (3,3,M)."""

from __future__ import annotations

import numpy as np

from gpusim.arrays.array_types import Float
from gpusim.fem.elements.isoparametric_map import determinant, inverse, times

_IDENTITY = np.eye(3)[..., None]
_MOST = 60
_EQUAL = 1e-9


def polar_rotation(slope: Float) -> Float:
    """R - 1 (3,3,M) with 1 + ``slope`` = R U, U positive definite, of slopes whose determinant
    1 + ... is positive.

    Newton's method for the orthogonal factor, R <- (R + R^-T) / 2 (Higham 1986), in D = R - 1:
    D <- (D - R^-T D^T) / 2, so that small rotations keep their digits. It converges quadratically
    and ends with the step that changes no entry by more than 1e-9 of the slope's largest.
    """
    change = slope
    small = _EQUAL * np.minimum(np.abs(slope).max(axis=(0, 1)), 1.0)
    for _ in range(_MOST):
        rotation = change + _IDENTITY
        back = inverse(rotation, determinant(rotation)).swapaxes(0, 1)
        step = 0.5 * (change + times(back, change.swapaxes(0, 1)))
        change = change - step
        if (np.abs(step).max(axis=(0, 1)) <= small).all():
            break
    return change
