"""Speckle as lists of discs per cell, and the exact share of a pixel that they cover.

Soft discs are polynomials of the position wherever they aren't 0 or 1, so that a 3 x 3 Gauss rule
over the footprint (cut into pieces where the edge is narrow against it) is right to 2e-4. Hard
discs add the closed-form areas of their circle segments; what several of them cover twice is taken
off row by row, each row being exact. Twin of ``shaders/common/speckle.wgsl``.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from weakref import WeakKeyDictionary

import numpy as np
import numpy.typing as npt
from scipy.sparse import coo_array

from gpusim.errors import InputError
from gpusim.gpu import Device
from gpusim.gpu.texels import Texels
from gpusim.optics import coverage
from gpusim.surface.speckle import EDGE, Speckle, edge_opacity, outer_radius

__all__ = [
    "MOST_CUTS",
    "SpeckleGrid",
    "SpeckleTable",
    "polygon_cover",
    "speckle_cover",
    "speckle_table",
]

Array = npt.NDArray[np.float64]
Long = npt.NDArray[np.int64]

MOST_TEXELS = 1 << 24
"""Positions in the table are stored as float32, which counts exactly up to here."""

MOST_CUTS = 8
"""A footprint is cut into at most this many pieces a side."""

SOFTEST = 0.4
"""Edge softness over the side of a piece from which 3 x 3 points suffice."""

ROWS = 8
"""Rows in which a piece's doubly covered area is measured."""

SAFETY = 4.0 / 3.0
"""How far a clipped pixel's corner may lie from its centroid, in half pixels."""

KEPT = 4
"""Tables kept for further frames, on the host and on each device."""

GAUSS = np.sqrt(0.15) * np.array([-1.0, 0.0, 1.0])
WEIGHT = np.array([5.0, 8.0, 5.0]) / 18.0


@dataclass(frozen=True)
class SpeckleGrid:
    """A region's cells in paint coordinates: side ``cell``, lowest cell, and counts.

    ``first`` is the texel of its first cell; ``cuts`` how often a footprint is cut a side.
    """

    cell: float
    lowest: tuple[int, int]
    shape: tuple[int, int]
    first: int
    cuts: int
    soft: bool


@dataclass(frozen=True, eq=False)
class SpeckleTable:
    """Cells and discs of all speckled regions.

    A cell's texel is (start, count, -, -) of its list; a disc's is (s, t, radius, 1 / (2 r h)), s
    and t relative to the cell's corner, with h the half width of its edge (0 where it is hard).
    ``start`` (C + 1,) and ``disc`` (E, 4) are the same before rounding, without the offset.
    """

    grids: tuple[SpeckleGrid, ...]
    start: Long
    disc: Array

    @property
    def most_in_a_cell(self) -> int:
        """The largest number of discs that a pixel has to look at."""
        return int(np.diff(self.start).max(initial=0))

    def texels(self, device: Device) -> Texels:
        """The table on a device; kept for the next frames that use it."""
        kept = _uploaded.setdefault(device, OrderedDict())
        if id(self) not in kept:
            cells = len(self.start) - 1
            data = np.zeros((cells + len(self.disc), 4), np.float32)
            data[:cells, 0] = self.start[:-1] + cells
            data[:cells, 1] = np.diff(self.start)
            data[cells:] = self.disc
            texels = Texels(device, max(len(data), 1), "rgba32float", "speckle.discs")
            if len(data):
                texels.write(data)
            kept[id(self)] = (self, texels)
            while len(kept) > KEPT:
                kept.popitem(last=False)
        kept.move_to_end(id(self))
        return kept[id(self)][1]


_uploaded: WeakKeyDictionary[Device, OrderedDict[int, tuple[SpeckleTable, Texels]]] = (
    WeakKeyDictionary()
)
Request = tuple[Speckle, tuple[float, float], tuple[float, float], float]


def speckle_table(regions: Sequence[tuple[Speckle, Array, Array, float]]) -> SpeckleTable:
    """Tables for regions (paint, low, high, reach), kept for equal ones.

    Extents and reach are rounded up, so that the frames of a series share one table.

    Raises
    ------
    InputError
        Discs that are too small against the pixel, or too many.
    """
    requests = []
    for paint, low, high, reach in regions:
        grain = 2.0 ** np.ceil(np.log2(max(float((high - low).max()), 1e-300) / 8.0))
        start, stop = np.floor(low / grain) * grain, np.ceil(high / grain) * grain
        wide = float(2.0 ** (np.ceil(4.0 * np.log2(max(reach, 1e-300))) / 4.0))
        requests.append(
            (paint, (float(start[0]), float(start[1])), (float(stop[0]), float(stop[1])), wide)
        )
    return _table(tuple(requests))


@lru_cache(maxsize=KEPT)
def _table(requests: tuple[Request, ...]) -> SpeckleTable:
    grids: list[SpeckleGrid] = []
    starts, discs = [np.zeros(1, np.int64)], [np.zeros((0, 4))]
    cells = entries = 0
    for paint, low, high, reach in requests:
        grid, start, disc = _region(paint, np.array(low), np.array(high), reach, cells)
        grids.append(grid)
        starts.append(start[1:] + entries)
        discs.append(disc)
        cells += len(start) - 1
        entries += len(disc)
        if cells + entries > MOST_TEXELS:
            raise InputError(
                f"Speckle diameter; got {paint.diameter:g}, which makes {entries} entries in "
                f"{cells} cells; expected at most {MOST_TEXELS}: larger speckles, or a view that "
                "is less grazing"
            )
    return SpeckleTable(tuple(grids), np.concatenate(starts), np.concatenate(discs))


def _region(
    paint: Speckle, low: Array, high: Array, reach: float, first: int
) -> tuple[SpeckleGrid, Long, Array]:
    """One region's cells, where each cell's list starts (C + 1,), and the lists (E, 4)."""
    half = EDGE * paint.softness
    # a power of two: cell corners are then exact in float32
    typical = outer_radius(0.5 * paint.diameter, paint.softness) + SAFETY * reach
    cell = float(2.0 ** np.floor(np.log2(CELL * typical)))
    lowest = np.floor(low / cell).astype(int) - 1
    columns, rows = (np.floor(high / cell).astype(int) + 2 - lowest).tolist()
    if columns * rows > MOST_TEXELS:
        raise InputError(
            f"Speckle diameter; got {paint.diameter:g}, which makes {columns} x {rows} cells; "
            f"expected at most {MOST_TEXELS}"
        )
    grid = SpeckleGrid(
        cell, (int(lowest[0]), int(lowest[1])), (columns, rows), first, _cuts(paint, reach),
        paint.softness > 0.0,
    )  # fmt: skip
    origin = lowest * cell
    centre, radius = paint.discs(origin, origin + cell * np.array([columns, rows]))
    outer = np.sqrt(radius * (radius + 2.0 * half))
    margin = SAFETY * reach
    position = (centre - origin) / cell
    start = np.floor(position - ((outer + margin) / cell)[:, None]).astype(np.int64)
    stop = np.floor(position + ((outer + margin) / cell)[:, None]).astype(np.int64)
    slots, owners = [], []
    wide, tall = (stop - start).max(axis=0, initial=-1) + 1
    for dj in range(int(tall)):
        for di in range(int(wide)):
            at = start + np.array([di, dj])
            # distance from the disc's centre to the cell, grown by what a pixel reaches
            gap = np.maximum(np.maximum(at - position, position - at - 1.0) * cell - margin, 0.0)
            meets = gap[:, 0] ** 2 + gap[:, 1] ** 2 < outer**2
            meets &= ((at >= 0) & (at < np.array([columns, rows]))).all(axis=1)
            own = np.flatnonzero(meets)
            slots.append(at[own, 1] * columns + at[own, 0])
            owners.append(own)
    slot, owner = _sorted(slots, owners, columns * rows, len(centre))
    corner = np.stack([slot % columns, slot // columns], axis=1) * cell + origin
    inverse = 0.5 / (radius * half) if half > 0.0 else np.zeros_like(radius)
    disc = np.column_stack([centre[owner] - corner, radius[owner], inverse[owner]])
    counts = np.bincount(slot, minlength=columns * rows)
    return grid, np.concatenate([[0], np.cumsum(counts)]), disc


CELL = 0.75
"""Side of a cell over a disc's outer radius, before it is rounded down to a power of two."""


def _sorted(slots: list[Long], owners: list[Long], cells: int, discs: int) -> tuple[Long, Long]:
    """Pairs of cell and disc by cell, then by disc."""
    if not slots:
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    slot, owner = np.concatenate(slots), np.concatenate(owners)
    ones = np.ones(len(slot), np.int8)
    table = coo_array((ones, (slot, owner)), shape=(cells, max(discs, 1))).tocsr()
    table.sort_indices()
    return np.repeat(np.arange(cells), np.diff(table.indptr)), table.indices.astype(np.int64)


def _cuts(paint: Speckle, reach: float) -> int:
    """Pieces a side that a footprint of half width ``reach`` is cut into."""
    if paint.softness > 0.0:
        wanted = 2.0 * reach * max(SOFTEST / paint.softness, 2.0 / paint.diameter)
        return int(np.clip(np.ceil(wanted - 1e-9), 1, MOST_CUTS))
    # the circle's series holds while a piece's half diagonal is below 2/3 of the radius
    wanted = np.ceil(1.5 * np.sqrt(2.0) * reach / paint.smallest - 1e-9)
    if not wanted <= MOST_CUTS:
        raise InputError(
            f"Speckle diameter; got discs down to {2.0 * paint.smallest:g} with hard edges under "
            f"pixels up to {2.0 * reach:g} wide; expected at least a quarter of a pixel: larger "
            "speckles, soft edges, or a view that is less grazing"
        )
    return int(max(wanted, 1))


def speckle_cover(
    table: SpeckleTable, number: int, at: Long, local: Array, ex: Array, ey: Array
) -> Array:
    """Share (n,) of footprints that discs of region ``number`` cover.

    ``at`` (n, 2) cell, counted from the region's lowest; ``local`` (n, 2) the footprint's centre
    from the cell's corner; ``ex``, ``ey`` (n, 2) its sides.
    """
    grid = table.grids[number]
    start, stop, inside = _lists(table, grid, at)
    cover = np.zeros(len(at))
    n = grid.cuts
    for j in range(n):
        for i in range(n):
            x, y = (i + 0.5) / n - 0.5, (j + 0.5) / n - 0.5
            centre = local[inside] + x * ex[inside] + y * ey[inside]
            part = _soft if grid.soft else _hard
            cover[inside] += part(table, start, stop, centre, ex[inside] / n, ey[inside] / n)
    return cover / n**2


def _lists(
    table: SpeckleTable, grid: SpeckleGrid, at: Long
) -> tuple[Long, Long, npt.NDArray[np.int64]]:
    """Where the lists of cells (n, 2) start and stop, and which cells exist."""
    inside = np.flatnonzero(((at >= 0) & (at < grid.shape)).all(axis=1))
    slot = grid.first + at[inside, 1] * grid.shape[0] + at[inside, 0]
    return table.start[slot], table.start[slot + 1], inside


def _soft(
    table: SpeckleTable, start: Long, stop: Long, centre: Array, ex: Array, ey: Array
) -> Array:
    points = (
        centre[:, None, None]
        + GAUSS[None, :, None] * ex[:, None, None]
        + GAUSS[:, None, None] * ey[:, None, None]
    )
    left = _uncovered(table, start, stop, points.reshape(-1, 9, 2))
    result: Array = 1.0 - left.reshape(-1, 3, 3) @ WEIGHT @ WEIGHT
    return result


def _uncovered(table: SpeckleTable, start: Long, stop: Long, points: Array) -> Array:
    """What soft discs leave open at points (n, P, 2)."""
    left = np.ones(points.shape[:2])
    for k in range(int((stop - start).max(initial=0))):
        rows = np.flatnonzero(start + k < stop)
        disc = table.disc[start[rows] + k]
        square = ((points[rows] - disc[:, None, :2]) ** 2).sum(axis=-1)
        left[rows] *= 1.0 - edge_opacity((disc[:, 2:3] ** 2 - square) * disc[:, 3:4])
    return left


def _hard(
    table: SpeckleTable, start: Long, stop: Long, centre: Array, ex: Array, ey: Array
) -> Array:
    corners = np.stack([-ex - ey, ex - ey, ex + ey, ey - ex], axis=1) * 0.5
    area = coverage.polygon_area(corners)
    y = ((np.arange(ROWS) + 0.5) / ROWS - 0.5)[:, None]
    rows = _Rows(centre[:, None] - 0.5 * ex[:, None] + y * ey[:, None], ex[:, None])
    total = np.zeros(len(centre))
    for k in range(int((stop - start).max(initial=0))):
        own = np.flatnonzero(start + k < stop)
        disc = table.disc[start[own] + k]
        seen = corners[own] + (centre[own] - disc[:, :2])[:, None]
        total[own] += coverage.disc_area(seen, disc[:, 2]) / area[own]
        rows.add(own, disc)
    twice: Array = (rows.total - rows.union()).mean(axis=1)
    return np.clip(total - twice, 0.0, 1.0)


class _Rows:
    """Segments ``first`` + x ``along``, x in 0 … 1, (n, R, 2), and what hard discs cover of them.

    Discs over a segment's start, over its end, and between them are kept as one interval each.
    """

    def __init__(self, first: Array, along: Array) -> None:
        self.first, self.along = first, np.broadcast_to(along, first.shape)
        shape = first.shape[:2]
        self.left, self.right = np.zeros(shape), np.ones(shape)
        self.low, self.high, self.total = np.ones(shape), np.zeros(shape), np.zeros(shape)

    def add(self, own: Long, disc: Array) -> None:
        """Put a disc each (m, 4) over segments ``own`` (m,)."""
        m, d = self.first[own] - disc[:, None, :2], self.along[own]
        a, b = (d * d).sum(axis=-1), (m * d).sum(axis=-1)
        c = (m * m).sum(axis=-1) - disc[:, 2:3] ** 2
        square = b * b - a * c
        root = np.sqrt(np.maximum(square, 0.0))
        safe = np.where(a > 0.0, a, 1.0)
        low, high = (-b - root) / safe, (-b + root) / safe
        meets = (square > 0.0) & (high > 0.0) & (low < 1.0)
        starts, ends = meets & (low <= 0.0), meets & (high >= 1.0)
        between = meets & ~starts & ~ends
        self.left[own] = np.where(
            starts, np.maximum(self.left[own], np.minimum(high, 1.0)), self.left[own]
        )
        self.right[own] = np.where(
            ends, np.minimum(self.right[own], np.maximum(low, 0.0)), self.right[own]
        )
        self.low[own] = np.where(between, np.minimum(self.low[own], low), self.low[own])
        self.high[own] = np.where(between, np.maximum(self.high[own], high), self.high[own])
        span = np.minimum(high, 1.0) - np.maximum(low, 0.0)
        self.total[own] += np.where(meets, span, 0.0)

    def union(self) -> Array:
        """Covered share (n, R) of the segments."""
        middle = np.minimum(self.high, self.right) - np.maximum(self.low, self.left)
        gap = np.maximum(self.right - self.left, 0.0)
        return 1.0 - gap + np.maximum(middle, 0.0)


def polygon_cover(
    table: SpeckleTable, number: int, at: Long, local: Array, polygon: Array, weight: Array
) -> Array:
    """Share (n,) that discs cover of what is seen of polygons (n, V, 2), relative to ``local``.

    ``weight`` (n, V) is 1 / z at their corners. The polygon is cut into triangles, each of them
    into rows from its first corner to the opposite side, evenly spaced in the image.
    """
    grid = table.grids[number]
    start, stop, inside = _lists(table, grid, at)
    cover, whole = np.zeros(len(inside)), np.zeros(len(inside))
    corner, w = polygon[inside] + local[inside, None], weight[inside]
    origin = corner[:, 0]
    for k in range(1, polygon.shape[1] - 1):
        a, b = corner[:, k] - origin, corner[:, k + 1] - origin
        # the triangle's area in the image, up to a factor that all triangles share
        area = (a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]) * w[:, 0] * w[:, k] * w[:, k + 1]
        part = np.zeros(len(inside))
        for y, share in _steps(grid):
            ends = []
            for m in (k, k + 1):
                both = np.stack([(1.0 - y) * w[:, 0], y * w[:, m]], axis=1)
                both /= both.sum(axis=1)[:, None]
                ends.append(origin * both[:, :1] + corner[:, m] * both[:, 1:])
            part += 2.0 * y * share * _row_cover(table, grid, start, stop, ends[0], ends[1])
        cover += area * part
        whole += area
    result = np.zeros(len(at))
    some = whole != 0.0
    result[inside[some]] = np.clip(cover[some] / whole[some], 0.0, 1.0)
    return result


def _steps(grid: SpeckleGrid) -> list[tuple[float, float]]:
    """Positions in 0 … 1 and weights of a triangle's rows, and of a soft row's points."""
    if not grid.soft:
        count = 2 * ROWS
        return [((i + 0.5) / count, 1.0 / count) for i in range(count)]
    n = grid.cuts
    return [
        ((i + 0.5 + float(GAUSS[k])) / n, float(WEIGHT[k]) / n) for i in range(n) for k in range(3)
    ]


def _row_cover(
    table: SpeckleTable, grid: SpeckleGrid, start: Long, stop: Long, first: Array, last: Array
) -> Array:
    """Covered share (n,) of the segments from ``first`` to ``last`` (n, 2)."""
    if grid.soft:
        steps = _steps(grid)
        x = np.array([step[0] for step in steps])
        points = first[:, None] + x[:, None] * (last - first)[:, None]
        share = np.array([step[1] for step in steps])
        result: Array = 1.0 - _uncovered(table, start, stop, points) @ share
        return result
    rows = _Rows(first[:, None], (last - first)[:, None])
    for k in range(int((stop - start).max(initial=0))):
        own = np.flatnonzero(start + k < stop)
        rows.add(own, table.disc[start[own] + k])
    return rows.union()[:, 0]
