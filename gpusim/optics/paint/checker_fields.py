"""Triangles that lie within one field of a chessboard: they are plain, like a wall.

No pixel on such a triangle reaches over a line of the board, so that none of them has to look for
one; on fine meshes that is most of a board.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from gpusim.optics.geometry.triangle_corners import CHUNK, ST
from gpusim.optics.geometry.view import RegionPaint, View
from gpusim.optics.light.microfacet_material import Gloss
from gpusim.surface.paint import Checker

__all__ = ["MARGIN", "field_of", "lines_near", "matte_boards", "within_fields"]

Array = npt.NDArray[np.float64]

MARGIN = 1.05
"""Of half of the largest pixel, how far from a line its pixels may be."""

CLOSE = -(1 << 62)
"""In place of the number of a field: a line is near."""

BESIDE = CLOSE + 1
"""The first of four numbers of what is beside the board, one for each of its sides."""


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
    # the field of each vertex as one number, as what is looked up costs more than what is compared
    number, shade = np.empty(len(st), np.int64), np.empty(len(st), np.float32)
    shades = np.array([paint.dark, paint.light], np.float32)
    for start in range(0, len(st), CHUNK):
        part = slice(start, start + CHUNK)
        close, beside = np.zeros(len(st[part]), bool), np.zeros(len(st[part]), np.int64)
        number[part] = 0
        index = np.zeros(len(close), np.int64)
        for axis, many in enumerate((paint.columns, paint.rows)):
            at = (st[part, axis] - paint.origin[axis]) / paint.size
            line, before = np.rint(at), np.floor(at)
            if many is not None:
                line, before = np.clip(line, 0, many), np.clip(before, -1, many)
            near = np.abs(at - line) * paint.size <= MARGIN * reach
            if many is not None:
                for k, end in enumerate((-1, many)):
                    beside[(before == end) & ~near] = BESIDE + 2 * axis + k
            close |= near
            whole = before.astype(np.int64)
            index += whole
            number[part] <<= 32
            number[part] += whole
        number[part][close] = CLOSE
        shade[part] = shades[index & 1]
        if beside.any():
            out = beside < 0
            number[part][out], shade[part][out] = beside[out], paint.ground
    near, albedo = np.empty(len(corner), bool), np.empty(len(corner), np.float32)
    for start in range(0, len(corner), CHUNK):
        part = slice(start, start + CHUNK)
        own = [corner[part, k] for k in range(3)]
        a, b, c = (np.take(number, vertices, mode="clip") for vertices in own)
        near[part] = (a != b) | (a != c) | (a == CLOSE)
        np.take(shade, own[0], out=albedo[part], mode="clip")
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
    own = near & (view.paint == number)
    whole = bool(own.all())
    corner = view.corner if whole else view.corner[own]
    close, plain = field_of(paint, region.reach, view.vertices[:, ST], corner)
    rows = slice(None) if whole else np.flatnonzero(own)
    near[rows] = close
    albedo[rows] = np.where(close, albedo[rows], plain)
