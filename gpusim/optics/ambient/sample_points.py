"""Points that look at the hemisphere over them, and what counts as lying on a face there."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

__all__ = ["AGAINST", "TILT", "SamplePoints", "tangent"]

Array = npt.NDArray[np.float64]

TILT = 0.1
"""Tangent of the angle by which the rows of `gpusim.optics.ambient.hemisphere_mask` pass the
normal."""

AGAINST = -0.5
"""Cosine between the normals of face and point below which they may lie against each other."""


@dataclass(frozen=True, eq=False)
class SamplePoints:
    """Points to look from.

    ``at`` (N, 3) and the unit ``normal`` (N, 3); ``tolerance`` (N,): distance from a face's plane
    within which it hides nothing; ``thickness`` (N,): that a way up leaves a body nearer than this
    doesn't tell that the point lies inside.
    """

    at: Array
    normal: Array
    tolerance: Array
    thickness: Array

    def part(self, rows: slice | npt.NDArray[np.int64]) -> SamplePoints:
        """Some of them."""
        return SamplePoints(
            self.at[rows], self.normal[rows], self.tolerance[rows], self.thickness[rows]
        )


def tangent(normal: Array) -> Array:
    """(N, 3) unit vectors square to unit normals, steady but where these point along -z."""
    x, y, z = normal.T
    below = z < -0.9999
    s = 1.0 / (1.0 + np.where(below, 0.0, z))
    result = np.stack([1.0 - x * x * s, -x * y * s, -x], axis=1)
    result[below] = np.stack([np.ones_like(x), 0.0 * x, -x / np.where(below, z, -1.0)], axis=1)[
        below
    ]
    length: Array = np.linalg.norm(result, axis=1)[:, None]
    return result / length
