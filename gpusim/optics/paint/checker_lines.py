"""The lines of large chessboards, drawn by themselves: only their pixels need the closed form.

A footprint that reaches over a line of a board costs several times one that lies within a field,
and hardly one in twenty does. So the triangles of a board show plain fields, and strips along its
lines, as wide as footprints reach, are drawn a hair in front of them. The picture is the same.
Triangles of fine meshes that lie within one field are plain, like a wall.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from gpusim.arrays.array_types import Bool, Float, Int, Long, Single
from gpusim.arrays.ragged import expand
from gpusim.optics.geometry.pixel_footprint import RegionPaint
from gpusim.optics.geometry.polygon_clipping import MAX_CORNERS, clip, half_planes
from gpusim.optics.geometry.triangle_corners import CHUNK, POSITION, ST, corner_range
from gpusim.optics.geometry.view import FIXED, View
from gpusim.optics.light.microfacet_material import Gloss
from gpusim.surface.paint import Checker

MARGIN = 1.05
"""Of half of the largest pixel, how far from a line its pixels may be."""

CLOSE = -(1 << 62)
"""In place of the number of a field: a line is near."""

BESIDE = CLOSE + 1
"""The first of four numbers of what is beside the board, one for each of its sides."""

MIN_FIELD = 8.0
"""Size of a field over half of the largest pixel on it, from which on it is worth it."""

OVERLAP = 0.012
"""Of half of the largest pixel, how far strips reach out of their triangle, so that no rounding
leaves a gap between two of them. Beyond the surface's border lie edge pixels only."""

FLATTEST = 1e-4
"""Height over length of triangles in paint coordinates that take strips."""

MAX_STRIPS = 1 << 14
IN_FRONT = 2e-6
"""Share of the depth; far more than a depth buffer's rounding, far less than any real distance."""

ROUNDED = 1.0 / 128.0
"""Pixels by which planes may be off where rasterisers round vertices to 1/256 px, as cards do: at
most 1/512 px each way for a strip's vertices and for those of its triangle, root of 2 in all."""


@dataclass(frozen=True, eq=False)
class BoardLines:
    """``member`` (T,): which of a view's triangles show plain fields.

    The strips are triangles (n,): ``parent``, the view's triangle that each lies on, ``screen``
    (n, 3, 2) px and ``inverse_depth`` (n, 3).
    """

    member: Bool
    parent: Long
    screen: Float
    inverse_depth: Float

    def fixed(self) -> Int:
        """Screen positions in fixed point, (n, 3, 2)."""
        return np.rint(self.screen * FIXED).astype(np.int32)

    @staticmethod
    def of(view: View, printed: Bool) -> BoardLines | None:
        """Those of a view; None where there are none, and behind lenses that bend lines.

        ``printed`` (T,): `gpusim.optics.shading.triangle_traits.TriangleTraits.printed`.
        """
        if view.camera.lens is not None:
            return None
        member = np.zeros(view.count, bool)
        boards = []
        for paint, reach, rows in _boards(view, printed):
            rows = rows[_spread(view.corners_of(rows, ST))]
            strips = _strips(view, rows, paint, reach)
            if strips is not None:
                member[rows] = True
                boards.append(strips)
        if not boards:
            return None
        return BoardLines(member, *(np.concatenate(parts) for parts in zip(*boards, strict=True)))


def _boards(view: View, printed: Bool) -> Iterator[tuple[Checker, float, Long]]:
    """The boards of a view with large fields, half of the largest pixel on each, and the numbers of
    their triangles near lines."""
    for number, region in enumerate(view.paints):
        paint = region.paint
        if isinstance(paint, Checker) and paint.size > MIN_FIELD * region.reach:
            yield paint, region.reach, np.flatnonzero(printed & (view.paint == number))


def _spread(st: Float) -> Bool:
    """Whether triangles (n, 3, 2) have an area in paint coordinates, which their sides don't where
    the paint is thrown on from the front."""
    a, b = st[:, 1] - st[:, 0], st[:, 2] - st[:, 0]
    cross = np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])
    longest = np.maximum(*(side[:, 0] ** 2 + side[:, 1] ** 2 for side in (a, b)))
    result: Bool = cross > FLATTEST * longest
    return result


def _strips(
    view: View, rows: Long, paint: Checker, reach: float
) -> tuple[Long, Float, Float] | None:
    """Parents, screen positions and 1 / depth of the strips of one paint on triangles ``rows``;
    None if they are too many."""
    st = view.corners_of(rows, ST) - np.array(paint.origin)
    inset = MARGIN * reach
    lowest, highest = corner_range(st)
    first, last = lines_near(paint, reach, lowest, highest)
    many = np.maximum(last - first + 1.0, 0.0)
    if not many.sum() <= MAX_STRIPS:
        return None
    owners, boxes = [], []
    for axis in range(2):
        owner, step = expand(many[:, axis].astype(np.int64))
        line = (first[owner, axis] + step) * paint.size
        low, high = lowest[owner] - inset, highest[owner] + inset
        low[:, axis], high[:, axis] = line - inset, line + inset
        owners.append(owner)
        boxes.append(np.stack([low, high], axis=1))
    owner, box = np.concatenate(owners), np.concatenate(boxes)
    (x0, y0), (x1, y1) = box[:, 0].T, box[:, 1].T
    square = np.stack([np.stack(c, 1) for c in ((x0, y0), (x1, y0), (x1, y1), (x0, y1))], axis=1)
    polygon = np.concatenate([square, np.repeat(square[:, -1:], MAX_CORNERS - 4, axis=1)], axis=1)
    count = np.full(len(polygon), 4)
    planes = half_planes(st)
    planes[..., 2] += OVERLAP * reach * np.hypot(planes[..., 0], planes[..., 1])
    for k in range(3):
        polygon, count = clip(polygon, count, planes[owner, k])
    which, corner = expand(np.maximum(count - 2, 0))
    places = np.stack([np.zeros_like(corner), corner + 1, corner + 2], axis=1)
    screen, depth = _seen(view, rows, st, owner[which], polygon[which[:, None], places])
    in_front = IN_FRONT + ROUNDED * _steepness(view, rows)
    return rows[owner[which]], screen, (1.0 + in_front[owner[which], None]) / depth


def _steepness(view: View, rows: Long) -> Float:
    """By what share of itself 1 / depth changes per pixel on triangles ``rows``, (R,)."""
    (ax, ay), (bx, by) = (edge.T for edge in np.diff(view.screen_of(rows), axis=1).swapaxes(0, 1))
    inverse = view.inverse_depth(rows)
    da, db = np.diff(inverse, axis=1).T
    twice = np.abs(ax * by - ay * bx)
    change = np.hypot(da * by - db * ay, db * ax - da * bx) / inverse.min(axis=1)
    return np.asarray(np.minimum(change, twice) / np.maximum(twice, 1e-300))


def _seen(view: View, rows: Long, st: Float, owner: Long, places: Float) -> tuple[Float, Float]:
    """Screen positions (n, 3, 2) and depths (n, 3) of ``places`` (n, 3, 2) in paint coordinates.

    ``st`` (R, 3, 2): those of the corners of triangles ``rows``; ``owner`` (n,): which of them.
    """
    corners = view.corners_of(rows, POSITION)
    (a, b), (c, d) = ((st[:, k] - st[:, 0]).T for k in (1, 2))
    twice = a * d - b * c

    def of_owners(values: Float) -> Float:
        return np.asarray(np.take(values, owner)[:, None])

    s, t = (places[..., axis] - of_owners(st[:, 0, axis]) for axis in range(2))
    at = []
    for axis in range(3):
        first, second, third = corners[:, :, axis].T
        u, v = second - first, third - first
        # how the position changes with the paint coordinates
        per_s, per_t = (d * u - b * v) / twice, (a * v - c * u) / twice
        at.append(of_owners(first) + s * of_owners(per_s) + t * of_owners(per_t))
    x, y, depth = at
    K = view.camera.K
    image = (K[0, 0] * x + K[0, 1] * y) / depth + K[0, 2], K[1, 1] * y / depth + K[1, 2]
    return np.stack(image, axis=-1), depth


def lines_near(paint: Checker, reach: float, low: Float, high: Float) -> tuple[Float, Float]:
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
    paint: Checker,
    albedos: Float,
    reach: float,
    st: Float,
    corner: Long,
) -> tuple[Bool, Single]:
    """Whether pixels on triangles of a board may reach over a line, and the albedo of those that
    can't, (n,) each.

    ``albedos`` (3,): of even and of odd fields and beyond them; ``st`` (V, 2): paint coordinates of
    vertices; ``corner`` (n, 3): those of the triangles;
    ``reach``: half of the largest pixel there.
    """
    # the field of each vertex as one number, as what is looked up costs more than what is compared
    number, shade = np.empty(len(st), np.int64), np.empty(len(st), np.float32)
    shades = albedos[:2].astype(np.float32)
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
            number[part][out], shade[part][out] = beside[out], albedos[2]
    near, albedo = np.empty(len(corner), bool), np.empty(len(corner), np.float32)
    for start in range(0, len(corner), CHUNK):
        part = slice(start, start + CHUNK)
        corners = [corner[part, k] for k in range(3)]
        a, b, c = (np.take(number, vertices, mode="clip") for vertices in corners)
        near[part] = (a != b) | (a != c) | (a == CLOSE)
        np.take(shade, corners[0], out=albedo[part], mode="clip")
    return near, albedo


def matte_boards(paints: Sequence[RegionPaint], gloss: Gloss | None) -> list[int]:
    """Numbers of the chessboards that don't shine: fields are matte prints on others' ground."""
    return [
        number
        for number, region in enumerate(paints)
        if isinstance(region.paint, Checker) and not (gloss and gloss.glossy[number])
    ]


def within_fields(
    view: View,
    number: int,
    albedos: Float,
    near: Bool,
    albedo: Single,
) -> None:
    """Correct ``near`` and ``albedo`` (T,) on the triangles of the board of paint ``number``, whose
    ``albedos`` (3,) are as for `field_of`."""
    region = view.paints[number]
    paint = region.paint
    assert isinstance(paint, Checker)
    of_board = near & (view.paint == number)
    whole = bool(of_board.all())
    corner = view.corner if whole else view.corner[of_board]
    close, plain = field_of(paint, albedos, region.reach, view.vertices[:, ST], corner)
    rows = slice(None) if whole else np.flatnonzero(of_board)
    near[rows] = close
    albedo[rows] = np.where(close, albedo[rows], plain)
