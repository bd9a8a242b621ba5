"""Paint patterns as tables that a pixel can look up; `gpusim.optics.albedo` evaluates them.

A region's features are filed in a grid of square cells over its paint coordinates; a pixel looks
into the cell of its centre, so every feature is filed in each cell that it can reach from, given
the largest pixel footprint. Positions are stored relative to the cell's corner, which keeps
float32 exact far from the origin. Twin of ``shaders/common/paint.wgsl``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from gpusim.errors import InputError
from gpusim.optics.speckle_table import SpeckleTable, speckle_table
from gpusim.optics.view import RegionPaint
from gpusim.surface.features import Features
from gpusim.surface.speckle import Speckle

__all__ = ["FEATURE", "FINEST", "LOOP_TURNS", "PAINT", "PatternTable"]

Array = npt.NDArray[np.float64]

PAINT = np.dtype(
    [("ground", "<f4"), ("cell", "<f4"), ("i0", "<i4"), ("j0", "<i4"), ("columns", "<i4"),
     ("rows", "<i4"), ("first", "<u4"), ("featured", "<u4"), ("dot", "<f4"), ("cuts", "<u4")]
)  # fmt: skip
"""``featured``: 0 one albedo, 1 features that keep apart, 2 soft and 3 hard speckle,
4 a bitmap."""

FEATURE = np.dtype([("a", "<f4", 4), ("b", "<f4", 4), ("c", "<f4", 4), ("d", "<f4", 4)])

MOST_CELLS = 1 << 22
LOOP_TURNS = 50_000
"""Turns that all loops of one shader invocation may take together.

Mesa's software rasteriser leaves every loop, without a word, after 65535 of them.
"""
FINEST = 8
"""A footprint over small squares is cut into at most this many pieces a side."""


@dataclass(frozen=True, eq=False)
class PatternTable:
    """Records as the shader reads them: ``paints``, ``cell_start`` (CSR) and ``features``.

    ``features64`` (F, 16) are the same feature records before rounding to float32. ``speckle`` has
    the discs of speckled paints, ``grid_of_paint`` (paints,) which of its grids is a paint's.
    """

    paints: npt.NDArray[np.void]
    cell_start: npt.NDArray[np.uint32]
    features: npt.NDArray[np.void]
    features64: Array
    speckle: SpeckleTable
    grid_of_paint: npt.NDArray[np.int64]

    @staticmethod
    def build(regions: Sequence[RegionPaint]) -> PatternTable:
        """File the features of every region.

        Raises
        ------
        InputError
            Two features of one region overlap.
        """
        paints = np.zeros(max(len(regions), 1), PAINT)
        starts, rows = [np.zeros(1, np.int64)], [np.zeros((0, 16))]
        slots = total = 0
        for number, region in enumerate(regions):
            record = paints[number]
            record["ground"], record["cell"] = region.paint.ground, 1.0
            if isinstance(region.paint, Speckle):
                continue
            features = region.paint.features(region.low, region.high)
            if features is None or not len(features):
                continue
            low, high = features.bounds()
            _refuse_overlap(features, low, high)
            low, high = low - region.reach, high + region.reach
            cell = _cell_size(features, region)
            lowest = np.floor(np.maximum(low.min(axis=0), region.low - cell) / cell).astype(int)
            highest = np.floor(np.minimum(high.max(axis=0), region.high + cell) / cell).astype(int)
            columns, count_rows = (np.maximum(highest - lowest, -1) + 1).tolist()
            if columns * count_rows == 0:
                continue
            c0 = np.clip(np.floor(low / cell).astype(int) - lowest, 0, [columns, count_rows])
            c1 = np.clip(np.floor(high / cell).astype(int) - lowest + 1, 0, [columns, count_rows])
            wide, tall = (c1 - c0).T
            per = np.maximum(wide, 0) * np.maximum(tall, 0)
            which = np.repeat(np.arange(len(features)), per)
            offset = np.arange(len(which)) - np.repeat(np.cumsum(per) - per, per)
            i = c0[which, 0] + offset % np.maximum(wide[which], 1)
            j = c0[which, 1] + offset // np.maximum(wide[which], 1)
            slot = j * columns + i
            order = np.argsort(slot, kind="stable")
            which, i, j, slot = which[order], i[order], j[order], slot[order]
            origin = np.stack([i + lowest[0], j + lowest[1]], axis=1) * cell
            rows.append(_records(features, which, origin))
            counts = np.bincount(slot, minlength=columns * count_rows)
            starts.append(total + np.cumsum(counts))
            record["cell"], record["featured"] = cell, 1
            record["i0"], record["j0"] = lowest
            record["columns"], record["rows"], record["first"] = columns, count_rows, slots
            slots += columns * count_rows
            total += len(which)
        table = np.concatenate(rows)
        packed = np.zeros(max(len(table), 1), FEATURE)
        for k, name in enumerate("abcd"):
            packed[name][: len(table)] = table[:, 4 * k : 4 * k + 4]
        speckle, grid_of_paint = _file_speckle(regions, paints)
        starting = np.concatenate(starts).astype(np.uint32)
        return PatternTable(paints, starting, packed, table, speckle, grid_of_paint)

    @property
    def most_in_a_cell(self) -> int:
        """The largest number of features that a pixel has to look at."""
        return int(np.diff(self.cell_start.astype(np.int64)).max(initial=0))

    def kinds(self) -> set[int]:
        """The kinds of features on file: 0 checker patch, 1 disc, 2 sector."""
        return {int(kind) for kind in np.unique(self.features64[:, 10])}

    def near_features(
        self, paint: npt.NDArray[np.int32], low: Array, high: Array
    ) -> npt.NDArray[np.bool_]:
        """Whether any cell under boxes ``low`` to ``high`` (n, 2) of the paints (n,) has features.

        Counts come from a summed-area table per paint.
        """
        result = self.paints["featured"][paint] > 1  # speckle and bitmaps are everywhere
        for number in np.flatnonzero(self.paints["featured"] == 1):
            rows = np.flatnonzero(paint == number)
            record = self.paints[number]
            shape = (int(record["rows"]), int(record["columns"]))
            first = int(record["first"])
            filled = np.diff(self.cell_start[first : first + shape[0] * shape[1] + 1].astype(int))
            total = np.zeros((shape[0] + 1, shape[1] + 1), np.int64)
            total[1:, 1:] = filled.reshape(shape).cumsum(axis=0).cumsum(axis=1)
            start = np.array([record["i0"], record["j0"]])
            limit = [shape[1], shape[0]]
            # one cell more on each side: a pixel's centre may lie just outside its triangle
            a = np.clip(np.floor(low[rows] / record["cell"]).astype(int) - start - 1, 0, limit)
            b = np.clip(np.floor(high[rows] / record["cell"]).astype(int) - start + 2, 0, limit)
            count = (
                total[b[:, 1], b[:, 0]] - total[a[:, 1], b[:, 0]]
                - total[b[:, 1], a[:, 0]] + total[a[:, 1], a[:, 0]]
            )  # fmt: skip
            result[rows] = count > 0
        return result


def _file_speckle(
    regions: Sequence[RegionPaint], paints: npt.NDArray[np.void]
) -> tuple[SpeckleTable, npt.NDArray[np.int64]]:
    """The table of the regions with speckle; their records in ``paints`` are filled in."""
    requests: list[tuple[Speckle, Array, Array, float]] = []
    grid_of_paint = np.full(len(paints), -1)
    for number, region in enumerate(regions):
        if isinstance(region.paint, Speckle) and region.reach > 0.0:
            grid_of_paint[number] = len(requests)
            requests.append((region.paint, region.low, region.high, region.reach))
    table = speckle_table(requests)
    for number in np.flatnonzero(grid_of_paint >= 0).tolist():
        grid, record = table.grids[grid_of_paint[number]], paints[number]
        record["cell"], record["featured"] = grid.cell, 2 if grid.soft else 3
        record["i0"], record["j0"] = grid.lowest
        record["columns"], record["rows"] = grid.shape
        record["first"], record["cuts"] = grid.first, grid.cuts
        paint = regions[number].paint
        assert isinstance(paint, Speckle)
        record["dot"] = paint.dot
    return table, grid_of_paint


def _cell_size(features: Features, region: RegionPaint) -> float:
    """Cells of about two features' size, not below the pixel, not more than the grid may hold."""
    extent = region.high - region.low
    size = float(np.median(features.extent)) * 2.0
    size = min(size, float(extent.max()))
    size = max(size, 2.0 * region.reach, float(np.sqrt(extent.prod() / MOST_CELLS)), 1e-300)
    # a power of two: cell corners are then exact in float32
    return float(2.0 ** np.ceil(np.log2(size)))


def _refuse_overlap(features: Features, low: Array, high: Array) -> None:
    order = np.argsort(low[:, 0], kind="stable")
    if features.layer is not None:
        order = order[features.layer[order] == 0]
    low, high = low[order], high[order]
    shrink = 1e-9 * (high - low)
    low, high = low + shrink, high - shrink
    until = np.searchsorted(low[:, 0], high[:, 0])
    for i in np.flatnonzero(until > np.arange(len(low)) + 1):
        span = slice(i + 1, until[i])
        hit = (low[span, 1] < high[i, 1]) & (high[span, 1] > low[i, 1])
        for j in np.flatnonzero(hit) + i + 1:
            if _apart(features, int(order[i]), int(order[j])):
                continue
            raise InputError(
                f"paint features {order[i]} and {order[j]} overlap; got boxes around "
                f"{features.position[order[i]].tolist()} and {features.position[order[j]].tolist()}"
                "; expected features that keep apart"
            )


def _apart(features: Features, i: int, j: int) -> bool:
    """Whether two features whose boxes overlap don't (patches by separating axes).

    Sectors count as discs.
    """
    if features.kind[i] != 0:
        i, j = j, i
    slack = 1e-9 * float(max(features.size[i].max(), features.size[j].max()))
    if features.kind[i] != 0:
        gap = np.hypot(*(features.position[i] - features.position[j]))
        return bool(gap >= features.size[i, 0] + features.size[j, 0] - slack)
    if features.kind[j] != 0:
        relative = _turn(features.position[j] - features.position[i], -features.angle[i])
        outside = relative - np.clip(relative, 0.0, features.size[i] * features.squares[i])
        return bool(np.hypot(*outside) >= features.size[j, 0] - slack)
    corners = []
    for k in (i, j):
        extent = features.size[k] * features.squares[k]
        box = extent * np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
        corners.append(features.position[k] + _turn(box, features.angle[k]))
    for angle in (features.angle[i], features.angle[j]):
        a, b = (_turn(points, -angle) for points in corners)
        if (a.max(axis=0) <= b.min(axis=0) + slack).any():
            return True
        if (b.max(axis=0) <= a.min(axis=0) + slack).any():
            return True
    return False


def _turn(points: Array, angle: float) -> Array:
    """Points (…, 2) turned about the origin by ``angle``."""
    cos, sin = np.cos(angle), np.sin(angle)
    x, y = points[..., 0], points[..., 1]
    return np.stack([cos * x - sin * y, sin * x + cos * y], axis=-1)


def _records(features: Features, which: npt.NDArray[np.int64], origin: Array) -> Array:
    """(n, 16) records of features relative to the corners (n, 2) of the cells they are filed in."""
    kind = features.kind[which]
    table = np.zeros((len(which), 16))
    position = features.position[which] - origin
    angle, size, squares = features.angle[which], features.size[which], features.squares[which]
    cos, sin = np.cos(angle), np.sin(angle)
    # the lattice corner of the patch nearest to the cell's own corner, and its index
    u = -(cos * position[:, 0] + sin * position[:, 1])
    v = -(-sin * position[:, 0] + cos * position[:, 1])
    index = np.clip(np.rint(np.stack([u, v], axis=1) / size), 0.0, squares)
    shift = index * size
    nearest = position + np.stack(
        [cos * shift[:, 0] - sin * shift[:, 1], sin * shift[:, 0] + cos * shift[:, 1]], axis=1
    )
    patch = kind == 0
    table[:, 0:2] = np.where(patch[:, None], nearest, position)
    table[:, 2] = np.where(patch, cos, size[:, 0])
    table[:, 3] = np.where(patch, sin, 0.0)
    table[:, 4:6] = size
    table[:, 6:8] = squares
    table[:, 8:10] = features.albedo[which]
    table[:, 10] = kind
    table[:, 12:14] = np.where(patch[:, None], index, 0.0)
    sector = kind == 2
    stop = angle + squares[:, 0]
    sides = np.stack([cos, sin, np.cos(stop), np.sin(stop)], axis=1)
    table[sector, 4:8] = sides[sector]
    return table
