"""Edges and faces in clusters: which of them may be contours to a point, or lie on its way up.

Of a cluster of edges is known what their faces' planes have in common. Where the faces on both
sides are known to hide, or not to, none of its edges is a contour.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from gpusim.optics.ambient.bounding_hierarchy import (
    CLOSED,
    NONE,
    OPEN,
    BoundingSpheres,
    NormalCones,
    facing,
    in_order,
    levels,
)
from gpusim.optics.ambient.edge_adjacency import EdgeAdjacency

__all__ = ["LOW", "SilhouetteBVH"]

ROUNDING = 2e-6
"""Of the scene's size: heights over planes are told apart by no less."""

LOW = 0.01
"""Sine of the height over the horizon below which no row has samples."""


@dataclass(frozen=True, eq=False)
class SilhouetteBVH:
    """``facets`` in the order of their clusters, which are the largest first and single ones last.

    ``balls`` and ``slopes``: those of the edges' clusters, and of the planes on both sides;
    ``spheres``: those of the faces'. ``rounding``: of heights over planes.
    """

    facets: EdgeAdjacency
    balls: list[BoundingSpheres]
    slopes: list[tuple[NormalCones, NormalCones]]
    spheres: list[BoundingSpheres]
    rounding: float

    @staticmethod
    def of(facets: EdgeAdjacency) -> SilhouetteBVH:
        """Those of ``facets``, however ordered."""
        planes, kind = _beside(facets)
        edge = in_order(
            facets.ends.mean(axis=1), kind[:, 0], kind[:, 1],
            *(facing(planes[:, k, :3]) for k in (0, 1)),
        )  # fmt: skip
        facets = facets.ordered(edge, in_order(facets.balls[:, :3]))
        planes, kind = _beside(facets)
        middle = facets.ends.mean(axis=1)
        gap = planes[:, :, 3] - np.einsum("eka,ea->ek", planes[:, :, :3], middle)
        foot = middle[:, None] + gap[:, :, None] * planes[:, :, :3]
        reach = np.concatenate([facets.ends, foot], axis=1)
        slopes = [
            (
                NormalCones.of(planes[:, 0, :3], foot[:, 0], kind[:, 0], size),
                NormalCones.of(planes[:, 1, :3], foot[:, 1], kind[:, 1], size),
            )
            for size in levels(len(reach))
        ]
        return SilhouetteBVH(
            facets, [BoundingSpheres.of(reach, size) for size in levels(len(reach))], slopes,
            [BoundingSpheres.around(facets.balls, size) for size in levels(len(facets.balls))],
            ROUNDING * float(np.abs(facets.ends).max(initial=0.0)),
        )  # fmt: skip


def _beside(facets: EdgeAdjacency) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.int64]]:
    """Planes (E, 2, 4) on both sides of edges, zeros where there is no face, and their kinds."""
    planes = np.concatenate([facets.planes, np.zeros((1, 4))])[facets.beside]
    kind = np.where(np.append(facets.both_sides, False)[facets.beside], OPEN, CLOSED)
    return planes, np.where(facets.beside < 0, NONE, kind)
