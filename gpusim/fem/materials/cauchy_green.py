"""Strains that a body can have: the right Cauchy-Green tensor C = 2 E + 1 is positive definite."""

from __future__ import annotations

import numpy as np

from gpusim.arrays.array_types import Float
from gpusim.errors import NotConverged
from gpusim.fem.materials.symmetric_tensors import ENGINEERING, cofactors, first_row_product

_LARGEST = 1e6  # a thousand times as long


def tensor_components(strain: Float) -> Float:
    """(6,P) components of the tensors E of Green-Lagrange strains (…,6) with engineering shear.

    Raises NotConverged where C isn't positive definite or not finite: the volume has become
    nothing or less there.
    """
    E: Float = np.ascontiguousarray(strain.reshape(-1, 6).T) / ENGINEERING[:, None]
    if not np.abs(E).max(initial=0.0) <= _LARGEST:  # NaN included
        number = int((~(np.abs(E) <= _LARGEST)).any(axis=0).sum())
        raise NotConverged(
            f"law: the strain is out of all bounds at {number} of {E.shape[1]} points; got a "
            f"component that isn't finite or above {_LARGEST:g}"
        )
    xx, yy, zz = 2.0 * E[:3] + 1.0
    xy, yz, zx = 2.0 * E[3:]
    minor = xx * yy - xy * xy
    volume = zz * minor - xx * yz * yz - yy * zx * zx + 2.0 * xy * yz * zx
    # Sylvester: the leading minors are positive
    good = (xx > 0.0) & (minor > 0.0) & (volume > 0.0)
    if not good.all():
        raise NotConverged(
            f"law: a cell is turned inside out at {int((~good).sum())} of {E.shape[1]} points; "
            f"got a squared ratio of volumes down to {volume.min():.3g}; expected it above 0"
        )
    return E


def growth_and_inverse(E2: Float) -> tuple[Float, Float]:
    """det C - 1 (P,), without cancellation at small strain, and the components (6,P) of C^-1, of
    C = ``E2`` + 1."""
    C = E2.copy()
    C[:3] += 1.0
    minors = cofactors(E2)
    growth = E2[:3].sum(axis=0) + minors[:3].sum(axis=0) + first_row_product(E2, minors)
    return growth, cofactors(C) / (1.0 + growth)
