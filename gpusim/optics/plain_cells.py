"""The insides of large chessboard fields, which are even: drawn without the pattern's arithmetic.

A pixel of a board costs four times that of a plain wall, though hardly one in twenty reaches over a
border. So the part of every field that no footprint reaches out of is drawn first, a hair in front
of the board, with the field's own albedo; the rasteriser then leaves these pixels out of the
patterned triangles. The picture is the same but for the rounding of an exact mean.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from gpusim.optics.corners import POSITION, ST
from gpusim.optics.polygon import MOST, clip, half_planes, moments
from gpusim.optics.ragged import expand
from gpusim.optics.setup import Setup
from gpusim.optics.view import FIXED
from gpusim.surface.paint import Checker

__all__ = ["PlainCells"]

Array = npt.NDArray[np.float64]
LEAST = 8.0
"""Size of a field over half of the largest pixel on it, from which on it is worth it."""

MARGIN = 1.05
"""Of half of the largest pixel, kept from a field's border."""

SMALLEST = 64.0
"""px; smaller insides are left to the pattern."""

MOST_CELLS = 1 << 14
IN_FRONT = 2e-6
"""Share of the depth; far more than a depth buffer's rounding, far less than any real distance."""


@dataclass(frozen=True, eq=False)
class PlainCells:
    """Triangles (n,) within fields: ``parent``, the view's triangle that each is a part of,
    ``albedo``, ``screen`` (n, 3, 2) px and ``inverse_depth`` (n, 3)."""

    parent: npt.NDArray[np.int64]
    albedo: Array
    screen: Array
    inverse_depth: Array

    def fixed(self) -> npt.NDArray[np.int32]:
        """Screen positions in fixed point, (n, 3, 2)."""
        return np.rint(self.screen * FIXED).astype(np.int32)

    @staticmethod
    def of(setup: Setup) -> PlainCells | None:
        """Those of a view; None where there are none, and behind lenses that bend lines."""
        view = setup.view
        if view.camera.lens is not None:
            return None
        even = (setup.groups == 1) & ~setup.shiny & ~setup.bumpy
        found = []
        for number, region in enumerate(view.paints):
            paint = region.paint
            if isinstance(paint, Checker) and paint.size > LEAST * region.reach:
                rows = np.flatnonzero(even & (view.paint == number))
                found += _cells(setup, rows, paint, MARGIN * region.reach)
        return found[0] if len(found) == 1 else _joined(found) if found else None


def _joined(parts: list[PlainCells]) -> PlainCells:
    names = ("parent", "albedo", "screen", "inverse_depth")
    return PlainCells(*(np.concatenate([getattr(p, name) for p in parts]) for name in names))


def _cells(
    setup: Setup, rows: npt.NDArray[np.int64], paint: Checker, inset: float
) -> list[PlainCells]:
    """The insides of one paint's fields on the triangles ``rows``: one set or none."""
    view, origin = setup.view, np.array(paint.origin)
    st = view.corners[rows][:, :, ST] - origin
    low, high = (np.floor(edge / paint.size).astype(np.int64) for edge in (st.min(1), st.max(1)))
    wide, tall = (high - low + 1).T
    if not 0 < int((wide * tall).sum()) <= MOST_CELLS:
        return []
    owner, offset = expand(wide * tall)
    cell = low[owner] + np.stack([offset % wide[owner], offset // wide[owner]], axis=1)
    corner = cell * paint.size
    x0, y0 = (corner + inset).T
    x1, y1 = (corner + (paint.size - inset)).T
    square = np.stack([np.stack(c, 1) for c in ((x0, y0), (x1, y0), (x1, y1), (x0, y1))], axis=1)
    polygon = np.concatenate([square, np.repeat(square[:, -1:], MOST - 4, axis=1)], axis=1)
    count = np.full(len(polygon), 4)
    planes = half_planes(st)[owner]
    for k in range(3):
        polygon, count = clip(polygon, count, planes[:, k])
    whole = np.flatnonzero(count >= 3)
    owner, cell, polygon, count = owner[whole], cell[whole], polygon[whole], count[whole]
    screen, depth = _seen(setup, rows[owner], st[owner], polygon)
    large = np.flatnonzero(np.abs(moments(screen)[0]) >= SMALLEST)  # false for NaN
    if not len(large):
        return []
    which, first = expand(count[large] - 2)
    own = large[which]
    places = np.stack([np.zeros_like(first), first + 1, first + 2], axis=1)
    return [
        PlainCells(
            rows[owner[own]],
            _albedo(paint, cell[own]),
            screen[own[:, None], places],
            (1.0 + IN_FRONT) / depth[own[:, None], places],
        )
    ]


def _albedo(paint: Checker, cell: npt.NDArray[np.int64]) -> Array:
    """Of fields (n, 2), those beyond the pattern's end included."""
    albedo = np.where(cell.sum(axis=1) % 2 == 0, paint.dark, paint.light)
    for axis, limit in enumerate((paint.columns, paint.rows)):
        if limit is not None:
            albedo = np.where((cell[:, axis] >= 0) & (cell[:, axis] < limit), albedo, paint.ground)
    return albedo


def _seen(
    setup: Setup, triangle: npt.NDArray[np.int64], st: Array, polygon: Array
) -> tuple[Array, Array]:
    """Screen positions (n, V, 2) and depths (n, V) of places in paint coordinates (n, V, 2).

    ``st`` (n, 3, 2): those of the triangles' corners.
    """
    sides = st[:, 1:] - st[:, :1]
    cross = sides[:, 0, 0] * sides[:, 1, 1] - sides[:, 0, 1] * sides[:, 1, 0]
    away = polygon - st[:, :1]
    with np.errstate(divide="ignore", invalid="ignore"):
        u = (away[..., 0] * sides[:, 1:, 1] - away[..., 1] * sides[:, 1:, 0]) / cross[:, None]
        v = (away[..., 1] * sides[:, :1, 0] - away[..., 0] * sides[:, :1, 1]) / cross[:, None]
    corners = setup.view.corners[triangle][:, :, POSITION]
    at = corners[:, :1] + u[..., None] * (corners[:, 1:2] - corners[:, :1])
    at = at + v[..., None] * (corners[:, 2:] - corners[:, :1])
    rays = at @ setup.view.camera.K.T
    depth: Array = at[..., 2]
    return rays[..., :2] / rays[..., 2:], depth
