"""Loop turns that the shader of edge pixels may take, which the device limits without a word."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from gpusim.arrays.unique import distinct
from gpusim.optics.edge_pixels.fragment_lists import EdgePixels
from gpusim.optics.geometry.triangle_corners import ST
from gpusim.optics.paint.disc_coverage import EDGE_ROWS, row_turns
from gpusim.optics.paint.feature_grid import FeatureGrid
from gpusim.optics.shading.setup import Setup, footprint

__all__ = ["grazing_turns", "speckle_turns"]

Array = npt.NDArray[np.float64]


def speckle_turns(table: FeatureGrid) -> int:
    """Loop turns that a polygon over speckle may take: six triangles, rows, points, discs."""
    usual = [3 * grid.cuts for grid in table.speckle.grids if grid.pieces is None]
    if not usual:
        return 0
    most = max(usual)
    return 6 * max(most**2, EDGE_ROWS) * table.speckle.most_in_a_cell


def grazing_turns(setup: Setup, edges: EdgePixels) -> npt.NDArray[np.int64]:
    """The same (E,) for speckle of which some footprints are large: mean of a pixel's triangles.

    What is seen of a triangle is no larger than the triangle, and than the pixel's footprint.
    """
    view, table = setup.view, setup.table
    if not any(region.grazing for region in view.paints):
        return np.zeros(len(edges.pixel), np.int64)
    turns = np.zeros(view.count + 1, np.int64)
    shown = distinct(edges.triangle[: edges.start[-1]])
    for number, region in enumerate(view.paints):
        rows = shown[view.paint[shown] == number] if region.grazing else shown[:0]
        if len(rows):
            st = view.corners[rows][:, :, ST]
            extent = np.minimum(np.ptp(st, axis=1), 1.2 * _widest_part(setup, rows, st))
            longest = np.hypot(extent[:, 0], extent[:, 1])
            grid = table.speckle.grids[table.grid_of_paint[number]]
            turns[rows] = 6 * row_turns(grid, longest) * (table.speckle.most_in_a_cell + 1)
    if not turns.any():
        return np.zeros(len(edges.pixel), np.int64)
    total = np.concatenate([[0], np.cumsum(turns[edges.triangle])])
    sums = np.diff(total[edges.start])
    result: npt.NDArray[np.int64] = -(-sums // np.maximum(edges.depth, 1))
    return result


def _widest_part(setup: Setup, triangle: npt.NDArray[np.int64], st: Array) -> Array:
    """How far (n, 2) along s and t a pixel may see of triangles whose corners are ``st``.

    One of s and t is bounded by the triangle; that bounds how far a pixel goes along the image,
    and so the other one.
    """
    limit = np.ptp(st, axis=1)
    result = np.zeros((len(triangle), 2))
    for corner in range(3):
        at = setup.view.screen[triangle, corner]
        _, ex, ey, _ = footprint(setup, triangle, at[:, 0], at[:, 1])
        for axis in (0, 1):
            own, other = np.stack([ex, ey])[:, :, [axis, 1 - axis]].transpose(2, 0, 1)
            bounds = [np.abs(own).sum(axis=0)]
            for k in (0, 1):
                ratio = own[k] / np.where(other[k] != 0.0, other[k], 1e-300)
                rest = np.abs(own[1 - k] - ratio * other[1 - k])
                bounds.append(np.abs(ratio) * limit[:, 1 - axis] + rest)
            result[:, axis] = np.maximum(result[:, axis], np.min(bounds, axis=0))
    return result
