"""Speckle seen at a grazing angle: what a region's tables are made for, and what goes without.

Where a surface turns away from the camera, as at the rim of a tube, footprints grow without bound.
Tables that suited the longest would slow down every pixel. So they are made for footprints up to
about twice the median, and triangles with longer ones cut each pixel into pieces along its
footprint, which look up the cells that they lie in.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from gpusim.surface.speckle import Speckle

__all__ = [
    "MAX_PIECES",
    "MAX_ROW_PIECES",
    "MAX_SIDE_PIECES",
    "Pieces",
    "grazing_reach",
    "may_graze",
    "pieces_of",
]  # fmt: skip

Array = npt.NDArray[np.float64]

MAX_PIECES, MAX_SIDE_PIECES = 144, 12
"""Pieces of a footprint, and on its shorter side; a longer one gets the paint's mean."""

MAX_ROW_PIECES = (4, 8)
"""Pieces of a row of a clipped pixel, of soft and of hard speckle; longer rows are sampled."""

SAFETY = 4.0 / 3.0
"""How far a clipped pixel's corner may lie from its centroid, in half pixels."""

MAX_CUTS = 8
"""Cuts of a pixel a side that the usual tables stand for."""


@dataclass(frozen=True)
class Pieces:
    """Sides of the pieces of a footprint: usual ones and the longest allowed."""

    usual: float
    longest: float


def pieces_of(paint: Speckle) -> Pieces:
    """Pieces for which a disc's area is in closed form, or 3 x 3 points resolve its edge."""
    if paint.softness > 0.0:
        return Pieces(min(2.5 * paint.softness, 0.5 * paint.diameter), 0.5 * paint.diameter)
    # half the diagonal of any parallelogram then stays below 2/3 of the smallest radius, and
    # tables that reach as far as a piece don't cut the usual footprints
    side = 0.58 * paint.smallest
    return Pieces(side, 1.001 * side)


def may_graze(paint: Speckle, widest: float) -> bool:
    """Whether footprints up to a half width may be too large for usual tables."""
    return widest > max(0.75 * pieces_of(paint).longest, 0.375 * paint.diameter)


def grazing_reach(
    paint: Speckle, half: Array, sides: Array, screen: Array, image: tuple[int, int]
) -> float | None:
    """Half width of the footprints that a region's tables should suit; None: the widest one.

    Parameters
    ----------
    half : (n, 3) half width of the footprint at the corners of triangles, in paint coordinates.
    sides : (n, 3, 2, 2) its sides, one per column.
    screen : (n, 3, 2) px, the corners.
    image : width and height, px.
    """
    widest, least = float(half.max()), 0.75 * pieces_of(paint).longest
    if not may_graze(paint, widest):
        return None
    u, v = screen[:, 1] - screen[:, 0], screen[:, 2] - screen[:, 0]
    low, high = screen.min(axis=1), screen.max(axis=1)
    inside = np.clip(np.minimum(high, image) - np.maximum(low, -0.5), 0.0, None)
    share = (inside / np.maximum(high - low, 1e-300)).prod(axis=1)
    seen = np.repeat(np.abs(u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]) * share, 3)
    usual = _median(half.reshape(-1), seen)
    across = _median(0.5 * _lesser_axis(sides).reshape(-1), seen)
    if paint.softness == 0.0 and not across <= MAX_CUTS * paint.smallest / np.sqrt(4.5):
        return None  # pixels too large from any direction: refused where the table is made
    stretched = widest > paint.diameter and widest > 2.0 * across
    if not (widest > 2.0 * usual or stretched):
        return None
    result = float(np.clip(2.0 * usual, 1.01 * least, max(paint.diameter, 1.01 * least)))
    if paint.softness == 0.0:
        # the widest footprint for a number of cuts
        step = 0.95 * paint.smallest / np.sqrt(4.5)
        result = step * float(np.clip(np.round(result / step), 1.0, MAX_CUTS))
    return result if widest > result else None


def _lesser_axis(sides: Array) -> Array:
    """The smaller singular value (…,) of 2 x 2 matrices (…, 2, 2)."""
    square = (sides**2).sum(axis=(-2, -1))
    area = np.abs(sides[..., 0, 0] * sides[..., 1, 1] - sides[..., 0, 1] * sides[..., 1, 0])
    root = np.sqrt(np.maximum(square**2 - 4.0 * area**2, 0.0))
    result: Array = area / np.sqrt(np.maximum(0.5 * (square + root), 1e-300))
    return result


def _median(values: Array, weights: Array) -> float:
    order = np.argsort(values)
    total = np.cumsum(weights[order])
    return float(values[order[int(np.searchsorted(total, 0.5 * total[-1]))]])
