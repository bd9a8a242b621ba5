"""The share of a pixel that speckle covers.

Soft discs are polynomials of the position wherever they aren't 0 or 1, so that a 3 x 3 Gauss rule
over the footprint (cut into pieces where the edge is narrow against it) is right to 2e-4. Hard
discs add the closed-form areas of their circle segments; what several of them cover twice is taken
off row by row, each row being exact; rows run where they meet the edges squarely. Twin of
``shaders/lib/paint/disc_coverage.wgsl``.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from gpusim.arrays.array_types import Float, Long
from gpusim.optics.geometry import polygon_clipping
from gpusim.optics.geometry.pixel_footprint import MAX_PIECES, MAX_ROW_PIECES, MAX_SIDE_PIECES
from gpusim.optics.paint.disc_grid import DiscGrid, SpeckleGrid
from gpusim.surface.speckle import edge_opacity

ROWS = 8
"""Rows in which a piece's doubly covered area is measured."""

EDGE_ROWS = 32
"""Rows, at most, in which what is covered of a part of a pixel is measured."""

GAUSS = np.sqrt(0.15) * np.array([-1.0, 0.0, 1.0])
WEIGHT = np.array([5.0, 8.0, 5.0]) / 18.0


def speckle_cover(
    table: DiscGrid, number: int, at: Long, local: Float, ex: Float, ey: Float, q: Float
) -> Float:
    """Share (n,) of footprints that discs of region ``number`` cover.

    ``at`` (n, 2) cell, counted from the region's lowest; ``local`` (n, 2) the footprint's centre
    from the cell's corner; ``ex``, ``ey`` (n, 2) its sides; ``q`` isn't needed (as parallelograms
    they are right to second order in it).
    """
    grid = table.grids[number]
    start, stop, inside = _lists(table, grid, at)
    cover = np.zeros(len(at))
    part = _soft if grid.soft else _hard
    cuts = np.full(len(inside), grid.cuts)
    if grid.smallest > 0.0:
        cuts = _cuts_under(table, grid, start, stop, local[inside], ex[inside], ey[inside])
    for n in np.unique(cuts):
        entries = np.flatnonzero(cuts == n)
        footprints = inside[entries]
        for j in range(n):
            for i in range(n):
                x, y = (i + 0.5) / n - 0.5, (j + 0.5) / n - 0.5
                centre = local[footprints] + x * ex[footprints] + y * ey[footprints]
                sides = ex[footprints] / n, ey[footprints] / n
                cover[footprints] += part(table, start[entries], stop[entries], centre, *sides)
        cover[footprints] /= n**2
    return cover


def _cuts_under(
    table: DiscGrid, grid: SpeckleGrid, start: Long, stop: Long, centre: Float, ex: Float, ey: Float
) -> Long:
    """How often footprints (n,) are cut a side, by the smallest disc whose edge crosses each."""
    reach = 0.5 * np.sqrt(np.maximum(((ex + ey) ** 2).sum(axis=1), ((ex - ey) ** 2).sum(axis=1)))
    cuts = np.ones(len(centre), np.int64)
    for k in range(int((stop - start).max(initial=0))):
        shown = np.flatnonzero(start + k < stop)
        disc = table.disc[start[shown] + k]
        gap = np.hypot(*(centre[shown] - disc[:, :2]).T) - disc[:, 2]
        wanted = np.ceil(grid.cuts * grid.smallest / disc[:, 2] - 1e-4).astype(np.int64)
        finer = np.maximum(cuts[shown], wanted)
        cuts[shown] = np.where(np.abs(gap) < reach[shown], finer, cuts[shown])
    return cuts


def grazing_cover(
    table: DiscGrid, number: int, at: Long, local: Float, ex: Float, ey: Float, q: Float
) -> Float:
    """The same for footprints that may be large: in pieces, each with the list of its own cell.

    ``q`` (n, 2) is the relative change of 1 / z per column and row: pieces are equal in the image.
    A footprint that would take too many gets the mean coverage.
    """
    grid = table.grids[number]
    assert grid.pieces is not None
    sides = np.stack([np.linalg.norm(ex, axis=1), np.linalg.norm(ey, axis=1)], axis=1)
    wanted = np.maximum(np.ceil(np.minimum(sides / grid.pieces.usual, 1e6) - 1e-4), 1.0)
    short = np.minimum(wanted.min(axis=1), MAX_SIDE_PIECES)
    long = np.minimum(wanted.max(axis=1), np.floor(MAX_PIECES / short))
    count = np.stack([long, short], axis=1)
    count[wanted[:, 0] < wanted[:, 1]] = count[wanted[:, 0] < wanted[:, 1]][:, ::-1]
    mean = (sides / count).max(axis=1) > grid.pieces.longest
    total = np.where(mean, 0, count.prod(axis=1)).astype(np.int64)
    cover = np.where(mean, grid.coverage, 0.0)
    part = _soft if grid.soft else _hard
    for k in range(int(total.max(initial=0))):
        footprints = np.flatnonzero(k < total)
        n = count[footprints]
        o = (np.stack([k % n[:, 0], k // n[:, 0]], axis=1) + 0.5) / n - 0.5
        w = 1.0 / (1.0 + (q[footprints] * o).sum(axis=1))[:, None]
        move = (o[:, :1] * ex[footprints] + o[:, 1:] * ey[footprints]) * w
        x = w / n[:, :1] * (ex[footprints] - move * q[footprints, :1])
        y = w / n[:, 1:] * (ey[footprints] - move * q[footprints, 1:])
        value, lists = _looked_up(table, grid, at[footprints], local[footprints] + move)
        start, stop, inside, centre = lists
        value[inside] = part(table, start, stop, centre, x[inside], y[inside])
        cover[footprints] += value / total[footprints]
    return cover


def _looked_up(
    table: DiscGrid, grid: SpeckleGrid, at: Long, place: Float
) -> tuple[Float, tuple[Long, Long, Long, Float]]:
    """Mean coverage (n,), for where there are no cells, and the lists of those that there are.

    ``place`` (n, 2) is relative to cells ``at``; the last is relative to its own.
    """
    step = np.floor(place / grid.cell)
    start, stop, inside = _lists(table, grid, at + step.astype(np.int64))
    local = (place - step * grid.cell)[inside]
    return np.full(len(place), grid.coverage), (start, stop, inside, local)


def _lists(table: DiscGrid, grid: SpeckleGrid, at: Long) -> tuple[Long, Long, Long]:
    """Where the lists of cells (n, 2) start and stop, and which cells exist."""
    inside = np.flatnonzero(((at >= 0) & (at < grid.shape)).all(axis=1))
    slot = grid.first + at[inside, 1] * grid.shape[0] + at[inside, 0]
    return table.start[slot], table.start[slot + 1], inside


def _soft(table: DiscGrid, start: Long, stop: Long, centre: Float, ex: Float, ey: Float) -> Float:
    points = (
        centre[:, None, None]
        + GAUSS[None, :, None] * ex[:, None, None]
        + GAUSS[:, None, None] * ey[:, None, None]
    )
    uncovered = _uncovered(table, start, stop, points.reshape(-1, 9, 2))
    result: Float = 1.0 - uncovered.reshape(-1, 3, 3) @ WEIGHT @ WEIGHT
    return result


def _uncovered(table: DiscGrid, start: Long, stop: Long, points: Float) -> Float:
    """What soft discs leave open at points (n, P, 2)."""
    uncovered = np.ones(points.shape[:2])
    for k in range(int((stop - start).max(initial=0))):
        rows = np.flatnonzero(start + k < stop)
        disc = table.disc[start[rows] + k]
        square = ((points[rows] - disc[:, None, :2]) ** 2).sum(axis=-1)
        uncovered[rows] *= 1.0 - edge_opacity((disc[:, 2:3] ** 2 - square) * disc[:, 3:4])
    return uncovered


def _hard(table: DiscGrid, start: Long, stop: Long, centre: Float, ex: Float, ey: Float) -> Float:
    corners = np.stack([-ex - ey, ex - ey, ex + ey, ey - ex], axis=1) * 0.5
    area = polygon_clipping.polygon_area(corners)
    reach = np.sqrt((corners**2).sum(axis=2).max(axis=1))
    along, across = _by_steepness(table, start, stop, centre, ex, ey, reach)
    y = ((np.arange(ROWS) + 0.5) / ROWS - 0.5)[:, None]
    rows = _Rows(centre[:, None] - 0.5 * along[:, None] + y * across[:, None], along[:, None])
    total, whole = np.zeros(len(centre)), np.zeros(len(centre), bool)
    for k in range(int((stop - start).max(initial=0))):
        footprints = np.flatnonzero(start + k < stop)
        disc = table.disc[start[footprints] + k]
        gap = np.hypot(*(centre[footprints] - disc[:, :2]).T) - disc[:, 2]
        whole[footprints] |= gap <= -reach[footprints]
        crossing = np.abs(gap) < reach[footprints]
        footprints, disc = footprints[crossing], disc[crossing]
        seen = corners[footprints] + (centre[footprints] - disc[:, :2])[:, None]
        total[footprints] += polygon_clipping.disc_area(seen, disc[:, 2]) / area[footprints]
        rows.add(footprints, disc)
    twice: Float = (rows.total - rows.union()).mean(axis=1)
    return np.where(whole, 1.0, np.clip(total - twice, 0.0, 1.0))


def _by_steepness(
    table: DiscGrid, start: Long, stop: Long, centre: Float, ex: Float, ey: Float, reach: Float
) -> tuple[Float, Float]:
    """The sides (n, 2) along and across which rows run: they meet the circles' edges squarely.

    What two discs share is a wedge; rows along one of its edges would jump over it. The first 32
    discs of a list decide, as on the device.
    """
    steep = np.zeros(len(centre))
    for k in range(min(int((stop - start).max(initial=0)), 32)):
        footprints = np.flatnonzero(start + k < stop)
        disc = table.disc[start[footprints] + k]
        m = centre[footprints] - disc[:, :2]
        away = np.hypot(m[:, 0], m[:, 1])
        slope = np.abs((m * ex[footprints]).sum(axis=1)) - np.abs((m * ey[footprints]).sum(axis=1))
        crosses = np.abs(away - disc[:, 2]) < reach[footprints]
        steep[footprints] += np.where(crosses, slope / np.maximum(away, 1e-300), 0.0)
    turned = (steep < 0.0)[:, None]
    return np.where(turned, ey, ex), np.where(turned, -ex, ey)


class _Rows:
    """Segments ``first`` + x ``along``, x in 0 … 1, (n, R, 2), and what hard discs cover of them.

    Discs over a segment's start, over its end, and between them are kept as one interval each.
    """

    def __init__(self, first: Float, along: Float) -> None:
        self.first, self.along = first, np.broadcast_to(along, first.shape)
        shape = first.shape[:2]
        self.left, self.right = np.zeros(shape), np.ones(shape)
        self.low, self.high, self.total = np.ones(shape), np.zeros(shape), np.zeros(shape)

    def add(self, lines: Long, disc: Float) -> None:
        """Put a disc each (m, 4) over segments ``lines`` (m,)."""
        m, d = self.first[lines] - disc[:, None, :2], self.along[lines]
        a, b = (d * d).sum(axis=-1), (m * d).sum(axis=-1)
        c = (m * m).sum(axis=-1) - disc[:, 2:3] ** 2
        square = b * b - a * c
        root = np.sqrt(np.maximum(square, 0.0))
        safe = np.where(a > 0.0, a, 1.0)
        low, high = (-b - root) / safe, (-b + root) / safe
        meets = (square > 0.0) & (high > 0.0) & (low < 1.0)
        starts, ends = meets & (low <= 0.0), meets & (high >= 1.0)
        between = meets & ~starts & ~ends
        self.left[lines] = np.where(
            starts, np.maximum(self.left[lines], np.minimum(high, 1.0)), self.left[lines]
        )
        self.right[lines] = np.where(
            ends, np.minimum(self.right[lines], np.maximum(low, 0.0)), self.right[lines]
        )
        self.low[lines] = np.where(between, np.minimum(self.low[lines], low), self.low[lines])
        self.high[lines] = np.where(between, np.maximum(self.high[lines], high), self.high[lines])
        span = np.minimum(high, 1.0) - np.maximum(low, 0.0)
        self.total[lines] += np.where(meets, span, 0.0)

    def union(self) -> Float:
        """Covered share (n, R) of the segments."""
        middle = np.minimum(self.high, self.right) - np.maximum(self.low, self.left)
        gap = np.maximum(self.right - self.left, 0.0)
        result: Float = 1.0 - gap + np.maximum(middle, 0.0)
        return result


def polygon_cover(
    table: DiscGrid, number: int, at: Long, local: Float, polygon: Float, weight: Float
) -> Float:
    """Share (n,) that discs cover of what is seen of polygons (n, V, 2), relative to ``local``.

    ``weight`` (n, V) is 1 / z at their corners. The polygon is cut into triangles, each of them
    into rows from its first corner to the opposite side, evenly spaced in the image.
    """
    grid = table.grids[number]
    corner = polygon + local[:, None]
    if grid.pieces is not None:
        return _mean_over_rows(table, grid, at, corner, weight, _grazing_row)
    cover = np.zeros(len(at))
    _, _, inside = _lists(table, grid, at)
    shapes = at[inside], corner[inside], weight[inside]
    cover[inside] = _mean_over_rows(table, grid, *shapes, _row_cover)
    return cover


def _mean_over_rows(
    table: DiscGrid,
    grid: SpeckleGrid,
    at: Long,
    corner: Float,
    weight: Float,
    row_cover: Callable[[DiscGrid, SpeckleGrid, Long, Float, Float], Float],
) -> Float:
    """The share of polygons with ``corner`` (n, V, 2), by ``row_cover`` of their rows' ends."""
    cover, whole = np.zeros(len(at)), np.zeros(len(at))
    # corners with their weights as a third component: straight in the image
    place = np.concatenate([corner, np.ones((*weight.shape, 1))], axis=2) * weight[..., None]
    for k in range(1, corner.shape[1] - 1):
        a, b = corner[:, k] - corner[:, 0], corner[:, k + 1] - corner[:, 0]
        # the triangle's area in the image, up to a factor that all triangles share
        twice_area = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
        area = twice_area * weight[:, 0] * weight[:, k] * weight[:, k + 1]
        longest = np.sqrt(np.maximum((a * a).sum(axis=1), (b * b).sum(axis=1)))
        rows = _rows_over(grid, longest)
        part = np.zeros(len(at))
        for j in range(int(rows[area != 0.0].max(initial=0))):
            shapes = np.flatnonzero((j < rows) & (area != 0.0))
            y, share = (values[:, None] for values in _row_step(grid, j, rows[shapes]))
            ends = [(1.0 - y) * place[shapes, 0] + y * place[shapes, m] for m in (k, k + 1)]
            covered = row_cover(table, grid, at[shapes], *ends)
            part[shapes] += 2.0 * y[:, 0] * share[:, 0] * covered
        cover += area * part
        whole += area
    result = np.full(len(at), 0.0 if grid.pieces is None else grid.coverage)
    filled = whole != 0.0
    result[filled] = np.clip(cover[filled] / whole[filled], 0.0, 1.0)
    return result


def _count(grid: SpeckleGrid, length: Float) -> Long:
    """Pieces of rows of a length (n,)."""
    assert grid.pieces is not None
    side = grid.pieces.usual * (1.0 if grid.soft else 2.0)
    most = MAX_ROW_PIECES[0 if grid.soft else 1]
    wanted = np.ceil(np.minimum(length / side, 1e6) - 1e-4)
    return np.clip(wanted, 1, most).astype(np.int64)


def _rows_over(grid: SpeckleGrid, length: Float) -> Long:
    """Rows (n,) of triangles up to a length (n,)."""
    if not grid.soft:
        return np.full(len(length), EDGE_ROWS)
    return 3 * (np.full(len(length), grid.cuts) if grid.pieces is None else _count(grid, length))


def row_turns(grid: SpeckleGrid, length: Float) -> Long:
    """Rows times their pieces (n,) of polygons up to a length (n,)."""
    return _count(grid, length) * _rows_over(grid, length)


def _row_step(grid: SpeckleGrid, j: int | Long, rows: Long) -> tuple[Float, Float]:
    """Position in 0 … 1 and weight of row ``j`` of ``rows`` (n,)."""
    if not grid.soft:
        return (j + 0.5) / rows, 1.0 / rows
    n = rows // 3
    return (j // 3 + 0.5 + GAUSS[j % 3]) / n, WEIGHT[j % 3] / n


def _grazing_row(table: DiscGrid, grid: SpeckleGrid, at: Long, first: Float, last: Float) -> Float:
    """Covered share (n,) of rows between homogeneous points (n, 3)."""
    assert grid.pieces is not None
    length = np.linalg.norm(last[:, :2] / last[:, 2:] - first[:, :2] / first[:, 2:], axis=1)
    count = _count(grid, length)
    shrink = np.minimum(1.0, 2.0 * grid.pieces.longest * count / np.maximum(length, 1e-300))
    result = np.zeros(len(at))
    steps = GAUSS if grid.soft else np.array([-0.5, 0.0, 0.5])
    for i in range(int(count.max(initial=0))):
        segments = np.flatnonzero(i < count)
        u = (i + 0.5 + shrink[segments, None] * steps) / count[segments, None]
        points = first[segments, None] + u[..., None] * (last - first)[segments, None]
        points = points[..., :2] / points[..., 2:]
        value, lists = _looked_up(table, grid, at[segments], points[:, 1])
        start, stop, inside, centre = lists
        points = points[inside] + (centre - points[inside, 1])[:, None]
        if grid.soft:
            value[inside] = 1.0 - _uncovered(table, start, stop, points) @ WEIGHT
        else:
            rows = _Rows(points[:, :1], (points[:, 2] - points[:, 0])[:, None])
            value[inside] = _hard_rows(table, start, stop, rows)
        result[segments] += value / count[segments]
    return result


def _row_cover(table: DiscGrid, grid: SpeckleGrid, at: Long, first: Float, last: Float) -> Float:
    """The same of rows within one cell, all of whose discs are asked."""
    start, stop, _ = _lists(table, grid, at)
    first, last = first[:, :2] / first[:, 2:], last[:, :2] / last[:, 2:]
    if grid.soft:
        count = 3 * grid.cuts
        x, share = _row_step(grid, np.arange(count), np.array(count))
        points = first[:, None] + x[:, None] * (last - first)[:, None]
        result: Float = 1.0 - _uncovered(table, start, stop, points) @ share
        return result
    return _hard_rows(table, start, stop, _Rows(first[:, None], (last - first)[:, None]))


def _hard_rows(table: DiscGrid, start: Long, stop: Long, rows: _Rows) -> Float:
    """Share (n,) of single rows that hard discs cover."""
    for k in range(int((stop - start).max(initial=0))):
        crossed = np.flatnonzero(start + k < stop)
        rows.add(crossed, table.disc[start[crossed] + k])
    return rows.union()[:, 0]
