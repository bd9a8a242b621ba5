"""Where a pattern leaves most of its region bare: large triangles are cut there.

A pixel of a triangle that a feature lies on pays for the whole pattern. A wall with a few targets
is two triangles; cut near the targets, all of it but them is plain. Edges are told by their two
ends alone, so that neighbours cut them alike.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from gpusim.arrays.summed_area import covered, in_boxes, summed
from gpusim.surface.paint import Paint, Speckle
from gpusim.surface.surface import Surface

__all__ = ["SPARSE_EDGE", "Sparse", "sparse_excess"]

Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]

SPARSE_EDGE = 64.0
"""px; longer edges near a feature are cut."""

REACH = 0.6
"""Of an edge's extent, within which features count as near: no point of a triangle is farther from
the middle of its longest edge."""

CELLS = 128
"""Along each side of the grid in which features are looked up."""

DENSE = 0.25
"""Share of the grid under features from which on nothing is gained."""


@dataclass(frozen=True, eq=False)
class Sparse:
    """Features of one region in a grid: ``total`` (129, 129) counts filled cells up to each one."""

    low: Array
    cell: Array
    total: npt.NDArray[np.int64]

    @staticmethod
    def of(paint: Paint, low: Array, high: Array) -> Sparse | None:
        """The features between paint coordinates; None if there are none, or too many."""
        features = None if isinstance(paint, Speckle) else paint.features(low, high)
        if features is None or not len(features) or not (high > low).all():
            return None
        cell = (high - low) / CELLS
        lower, upper = features.bounds()
        first = np.clip((lower - low) // cell, 0, CELLS).astype(np.int64)
        last = np.clip((upper - low) // cell + 1, 0, CELLS).astype(np.int64)
        filled = covered(first, last, (CELLS, CELLS))
        if filled.mean() > DENSE:
            return None
        return Sparse(low, cell, summed(filled))

    def near(self, a: Array, b: Array) -> Flags:
        """Which edges from ``a`` to ``b`` (n, 2), in paint coordinates, pass a feature closely."""
        reach = REACH * np.abs(b - a).max(axis=1)[:, None]
        low = np.clip((np.minimum(a, b) - reach - self.low) // self.cell, 0, CELLS)
        high = np.clip((np.maximum(a, b) + reach - self.low) // self.cell + 1, 0, CELLS)
        (left, top), (right, bottom) = low.T.astype(np.int64), high.T.astype(np.int64)
        return np.asarray(in_boxes(self.total, left, top, right, bottom) > 0)


def sparse_excess(
    surface: Surface, st: slice
) -> Callable[[Array, npt.NDArray[np.int64], Array], Array] | None:
    """What `gpusim.optics.geometry.clipping.split` asks about edges; None where nothing is to be
    cut.

    The function takes corners (n, 3, k), with paint coordinates in columns ``st``, the triangle of
    the surface (n,) that each piece comes from, and places on the image (n, 3, 2). Its result
    (n, 3) is above 1 where the edge from a corner to the next one must be halved.
    """
    grids = {}
    for number, paint in enumerate(surface.paints.values()):
        if number in surface.extents:
            found = Sparse.of(paint, *surface.extents[number])
            if found is not None:
                grids[number] = found
    if not grids:
        return None
    regions = surface.regions[surface.topology.source]

    def excess(corners: Array, source: npt.NDArray[np.int64], place: Array) -> Array:
        side = place[:, [1, 2, 0]] - place
        result: Array = np.hypot(side[..., 0], side[..., 1]) / SPARSE_EDGE
        rows, k = np.nonzero(result > 1.0)
        region = regions[source[rows]]
        a, b = corners[rows, k, st], corners[rows, (k + 1) % 3, st]
        near = np.zeros(len(rows), bool)
        for number, grid in grids.items():
            own = np.flatnonzero(region == number)
            near[own] = grid.near(a[own], b[own])
        result[rows[~near], k[~near]] = 0.0
        return result

    return excess
