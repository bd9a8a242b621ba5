"""Demosaicing: red, green and blue at every pixel of a Bayer mosaic, by linear filters.

- "bilinear": the mean of the two or four nearest pixels of a colour, as OpenCV has it.
- "malvar": H. Malvar, L. He, R. Cutler, "High-quality linear interpolation for demosaicing of
  Bayer-patterned color images", ICASSP 2004: the same, corrected by the Laplacian of the colour
  that the pixel has.

Both give back what is linear in the position (but for the outermost two pixels: the mosaic is
continued by its mirror image, which keeps the pattern).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from gpusim.arrays.array_types import Float, Single

TILES = {"RGGB": (0, 1, 1, 2), "BGGR": (2, 1, 1, 0), "GRBG": (1, 0, 2, 1), "GBRG": (1, 2, 0, 1)}
"""Channels (0 red, 1 green, 2 blue) of the four pixels of a tile, row by row."""


@dataclass(frozen=True)
class Filters:
    """5 x 5 weights: of green at a red or blue pixel; of red or blue at a green pixel between two
    of them in its ``row`` (transposed: in its column); of blue at red, and the other way round."""

    green: Float
    row: Float
    opposite: Float


def _filter(rows: list[list[float]], divisor: float) -> Float:
    """With its last two rows, which mirror the first two."""
    return np.array([*rows, rows[1], rows[0]]) / divisor


METHODS = {
    "bilinear": Filters(
        green=_filter([[0, 0, 0, 0, 0], [0, 0, 1, 0, 0], [0, 1, 0, 1, 0]], 4.0),
        row=_filter([[0, 0, 0, 0, 0], [0, 0, 0, 0, 0], [0, 1, 0, 1, 0]], 2.0),
        opposite=_filter([[0, 0, 0, 0, 0], [0, 1, 0, 1, 0], [0, 0, 0, 0, 0]], 4.0),
    ),
    "malvar": Filters(
        green=_filter([[0, 0, -1, 0, 0], [0, 0, 2, 0, 0], [-1, 2, 4, 2, -1]], 8.0),
        row=_filter([[0, 0, 0.5, 0, 0], [0, -1, 0, -1, 0], [-1, 4, 5, 4, -1]], 8.0),
        opposite=_filter([[0, 0, -1.5, 0, 0], [0, 2, 0, 2, 0], [-1.5, 0, 6, 0, -1.5]], 8.0),
    ),
}


def demosaiced(mosaic: npt.NDArray[Any], bayer: str, method: str) -> Single:
    """(H, W, 3) red, green, blue of a mosaic (H, W) with the pattern ``bayer``, by one of
    `METHODS`; values may lie outside of the mosaic's range."""
    values, tile, filters = mosaic.astype(np.float32), TILES[bayer], METHODS[method]
    green, row, column, opposite = (
        cv2.filter2D(values, -1, weights, borderType=cv2.BORDER_REFLECT_101)
        for weights in (filters.green, filters.row, filters.row.T, filters.opposite)
    )
    result = np.empty((*values.shape, 3), np.float32)
    for place, own in enumerate(tile):
        at = np.s_[place // 2 :: 2, place % 2 :: 2]
        result[at][..., own] = values[at]
        if own == 1:
            result[at][..., tile[place ^ 1]] = row[at]
            result[at][..., tile[place ^ 2]] = column[at]
        else:
            result[at][..., 1] = green[at]
            result[at][..., 2 - own] = opposite[at]
    return result
