"""Triangles that lie within one field of a chessboard: they are plain, like a wall.

No pixel on such a triangle reaches over a line of the board, so that none of them has to look for
one; on fine meshes that is most of a board.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from gpusim.optics.corners import CHUNK, ST
from gpusim.optics.gloss import Gloss
from gpusim.optics.view import RegionPaint, View
from gpusim.surface.paint import Checker

__all__ = ["MARGIN", "field_of", "lines_near", "matte_boards", "within_fields"]

Array = npt.NDArray[np.float64]

MARGIN = 1.05
"""Of half of the largest pixel, how far from a line its pixels may be."""

LINE_NEAR = -(1 << 30)
"""In place of the number of a line."""


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
    paint: Checker, reach: float, st: Array, corner: npt.NDArray[np.int64]
) -> tuple[npt.NDArray[np.bool_], npt.NDArray[np.float32]]:
    """Whether pixels on triangles of a board may reach over a line, and the albedo of those that
    can't, (n,) each.

    ``st`` (V, 2): paint coordinates of vertices; ``corner`` (n, 3): those of the triangles;
    ``reach``: half of the largest pixel there.
    """
    at = st - np.array(paint.origin)
    first, last = lines_near(paint, reach, at, at)
    # of each vertex the line before it, or that one is near; beside the board all are alike
    before = np.where(first > last, np.floor(at / paint.size), LINE_NEAR)
    for axis, many in enumerate((paint.columns, paint.rows)):
        if many is not None:
            far = before[:, axis] != LINE_NEAR
            before[far, axis] = np.clip(before[far, axis], -1, many)
    fields = before.T.astype(np.int32)
    near, albedo = np.empty(len(corner), bool), np.empty(len(corner), np.float32)
    shades = np.array([paint.dark, paint.light, paint.ground], np.float32)
    for start in range(0, len(corner), CHUNK):
        part = slice(start, start + CHUNK)
        index = np.zeros(len(corner[part]), np.int32)
        beside, close = np.zeros(len(index), bool), np.zeros(len(index), bool)
        for field, many in zip(fields, (paint.columns, paint.rows), strict=True):
            a, b, c = (field[corner[part, k]] for k in range(3))
            alike = (a == b) & (a == c) & (a != LINE_NEAR)
            close |= ~alike
            index += a
            if many is not None:
                beside |= alike & ((a == -1) | (a == many))
        near[part] = close & ~beside
        index &= 1
        index[beside] = 2
        albedo[part] = shades[index]
    return near, albedo


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
    corner = view.corner if len(rows) == view.count else view.corner[rows]
    close, plain = field_of(paint, region.reach, view.vertices[:, ST], corner)
    near[rows] = close
    albedo[rows] = np.where(close, albedo[rows], plain)
