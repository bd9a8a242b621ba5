"""The nearest of many points."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    from scipy.spatial import cKDTree

__all__ = ["point_tree"]


def point_tree(points: npt.NDArray[np.float64]) -> cKDTree:
    """A k-d tree of ``points`` (N, D)."""
    # a fifth of what all of the measuring takes to import, and markers don't need it
    from scipy.spatial import cKDTree

    return cKDTree(points)
