"""Triangles that lie within one field of a chessboard: they are plain, like a wall.

No pixel on such a triangle reaches over a line of the board, so that none of them has to look for
one; on fine meshes that is most of a board.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from gpusim.optics.corners import CHUNK, ST, corner_range
from gpusim.optics.gloss import Gloss
from gpusim.optics.view import RegionPaint, View
from gpusim.surface.paint import Checker

__all__ = ["MARGIN", "field_of", "lines_near", "matte_boards", "within_fields"]

Array = npt.NDArray[np.float64]

MARGIN = 1.05
"""Of half of the largest pixel, how far from a line its pixels may be."""


def lines_near(paint: Checker, reach: float, low: Array, high: Array) -> tuple[Array, Array]:
    """First and last line of a board across either axis, (n, 2) each, that pixels on pieces may
    reach over; none where the last one is before the first.

    ``low`` and ``high`` (n, 2): extent of each piece, from the board's origin; ``reach``: half of
    the largest pixel there.
    """
    inset = MARGIN * reach
    squares = np.array([np.inf if n is None else n for n in (paint.columns, paint.rows)])
    first, last = np.ceil((low - inset) / paint.size), np.floor((high + inset) / paint.size)
    first = np.where(np.isinf(squares), first, np.maximum(first, 0.0))
    return first, np.minimum(last, squares)


def field_of(
    paint: Checker, reach: float, low: Array, high: Array
) -> tuple[npt.NDArray[np.bool_], Array]:
    """Whether pixels on pieces of a board may reach over a line, and the albedo of those that
    can't, (n,) each.

    ``low`` and ``high`` (n, 2): extent of each piece in paint coordinates; ``reach``: half of the
    largest pixel there.
    """
    inset = MARGIN * reach
    low, high = low - np.array(paint.origin), high - np.array(paint.origin)
    first, last = lines_near(paint, reach, low, high)
    near = (last >= first).any(axis=1)
    beside = np.zeros(len(low), bool)
    field = np.zeros(len(low))
    for axis, many in enumerate((paint.columns, paint.rows)):
        a, b = low[:, axis], high[:, axis]
        if many is not None:
            beside |= (b < -inset) | (a > many * paint.size + inset)
        field += np.floor(0.5 * (a + b) / paint.size)
    albedo = np.where(field % 2.0 == 0.0, paint.dark, paint.light)
    return near & ~beside, np.where(beside, paint.ground, albedo)


def matte_boards(paints: Sequence[RegionPaint], gloss: Gloss | None) -> list[int]:
    """Numbers of the chessboards that don't shine: fields are matte prints on others' ground."""
    return [
        number
        for number, region in enumerate(paints)
        if isinstance(region.paint, Checker) and not (gloss and gloss.glossy[number])
    ]


def within_fields(
    view: View, number: int, near: npt.NDArray[np.bool_], albedo: npt.NDArray[np.float32]
) -> None:
    """Correct ``near`` and ``albedo`` (T,) on the triangles of the board of paint ``number``."""
    region = view.paints[number]
    paint = region.paint
    assert isinstance(paint, Checker)
    rows = np.flatnonzero(near & (view.paint == number))
    whole = len(rows) == view.count
    for first in range(0, len(rows), CHUNK):
        part = slice(first, first + CHUNK) if whole else rows[first : first + CHUNK]
        low, high = corner_range(view.corners[part, :, ST])
        close, plain = field_of(paint, region.reach, low, high)
        near[part] = close
        albedo[part] = np.where(close, albedo[part], plain)
