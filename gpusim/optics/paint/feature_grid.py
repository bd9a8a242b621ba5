"""Paint patterns as tables that a pixel can look up; `gpusim.optics.paint.footprint_mean` evaluates
them.

A region's features are filed in a grid of square cells over its paint coordinates; a pixel looks
into the cell of its centre, so every feature is filed in each cell that it can reach from, given
the largest pixel footprint. Positions are stored relative to the cell's corner, which keeps
float32 exact far from the origin. Twin of ``shaders/lib/paint/feature_grid.wgsl``.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np
import numpy.typing as npt

from gpusim.arrays.array_types import Bool, Float, Long
from gpusim.arrays.ragged import cells_of_boxes, in_boxes, summed
from gpusim.gpu import Device
from gpusim.gpu.texture_array import Texels
from gpusim.optics.geometry.pixel_footprint import RegionPaint
from gpusim.optics.geometry.triangle_corners import CHUNK, ST, corner_range
from gpusim.optics.geometry.view import View
from gpusim.optics.paint.disc_grid import MAX_TEXELS, DiscGrid, speckle_table
from gpusim.optics.paint.feature_overlap import refuse_overlap
from gpusim.surface.color import Colored
from gpusim.surface.features import Features, Paint
from gpusim.surface.speckle import Speckle
from gpusim.validation import require

PAINT = np.dtype(
    [("ground", "<f4"), ("cell", "<f4"), ("i0", "<i4"), ("j0", "<i4"), ("columns", "<i4"),
     ("rows", "<i4"), ("first", "<u4"), ("featured", "<u4"), ("dot", "<f4"), ("cuts", "<u4"),
     ("piece", "<f4"), ("longest", "<f4"), ("coverage", "<f4")]
)  # fmt: skip
"""``featured``: 0 one albedo, 1 features that keep apart, 2 soft and 3 hard speckle,
4 a bitmap."""

MAX_CELLS = 1 << 22
MAX_BOARD_CELLS = 1 << 12
LOOP_TURNS = 50_000
"""Turns that all loops of one shader invocation may take together.

Mesa's software rasteriser leaves every loop, without a word, after 65535 of them.
"""
FINEST = 8
"""A footprint over small squares is cut into at most this many pieces a side."""


CELL_NUMBERS = 2**31  # of 32 bits


@dataclass(frozen=True, eq=False)
class FeatureGrid:
    """``paints`` as the shader reads them, and the features of each cell.

    ``cell_start`` (C + 1,): where a cell's own begin among ``features`` (F, 16). ``speckle`` has
    the discs of speckled paints, ``grid_of_paint`` (paints,) which of its grids is a paint's.
    ``filed``: per patterned paint its number, the rows of its features, and which of the paint's
    each of them is.
    """

    paints: npt.NDArray[np.void]
    cell_start: npt.NDArray[np.uint32]
    features: Float
    speckle: DiscGrid
    grid_of_paint: Long
    filed: tuple[tuple[int, slice, Long], ...]

    @staticmethod
    def build(regions: Sequence[RegionPaint], extent: float = np.inf) -> FeatureGrid:
        """File the features of every region; ``extent``: px, no box round a triangle is longer.

        Raises
        ------
        InputError
            Two features of one region overlap, or a surface is too large for its pattern.
        """
        paints = np.zeros(max(len(regions), 1), PAINT)
        starts, rows = [np.zeros(1, np.int64)], [np.zeros((0, 16))]
        all_filed = []
        slots = total = 0
        for number, region in enumerate(regions):
            record = paints[number]
            record["ground"], record["cell"] = region.paint.ground, 1.0
            if isinstance(region.paint, Speckle):
                continue
            filed = _file(region, extent)
            if filed is None:
                continue
            rows.append(filed.records)
            all_filed.append((number, slice(total, total + len(filed.which)), filed.which))
            starts.append(total + np.cumsum(filed.counts))
            furthest = max(abs(k) + n for k, n in zip(filed.lowest, filed.shape, strict=True))
            reach, most = furthest * filed.cell, CELL_NUMBERS * filed.cell
            got = f"cells of {filed.cell:g} up to {reach:.3g} from the pattern's origin"
            what = "paint: surface too large for its pattern"
            require(furthest < CELL_NUMBERS, what, got, f"below {most:.3g}")
            record["cell"], record["featured"] = filed.cell, 1
            record["i0"], record["j0"] = filed.lowest
            record["columns"], record["rows"] = filed.shape
            record["first"] = slots
            slots += len(filed.counts)
            total += len(filed.records)
        table = np.concatenate(rows)
        speckle, grid_of_paint = _file_speckle(regions, paints)
        starting = np.concatenate(starts).astype(np.uint32)
        return FeatureGrid(paints, starting, table, speckle, grid_of_paint, tuple(all_filed))

    def with_albedos_of(self, regions: Sequence[RegionPaint]) -> FeatureGrid:
        """The same with the albedos of regions that differ from its own in nothing else."""
        paints, features = self.paints.copy(), self.features.copy()
        for record, region in zip(paints, regions, strict=False):
            record["ground"] = region.paint.ground
            if isinstance(region.paint, Speckle):
                record["dot"] = region.paint.dot
        for number, rows, which in self.filed:
            own = regions[number].paint.features(regions[number].low, regions[number].high)
            assert own is not None
            features[rows, 8:10] = own.albedo[which]
        return replace(self, paints=paints, features=features)

    def fields(self, number: int) -> Float:
        """(3,): albedo of the even and of the odd fields of a board, and of its ground."""
        rows = next(rows for filed, rows, _ in self.filed if filed == number)
        return np.append(self.features[rows.start, 8:10], self.paints["ground"][number])

    def mask(self) -> FeatureGrid:
        """The same pattern with what each feature covers as its albedo, on a ground of 0.

        Its mean is the share of the ground that is hidden.
        """
        paints, features = self.paints.copy(), self.features.copy()
        paints["ground"] = 0.0
        features[:, 8:10] = features[:, 11:12]
        return replace(self, paints=paints, features=features)

    @property
    def most_in_a_cell(self) -> int:
        """The largest number of features that a pixel has to look at."""
        return int(np.diff(self.cell_start.astype(np.int64)).max(initial=0))

    def kinds(self) -> set[int]:
        """The kinds of features on file: 0 checker patch, 1 disc, 2 sector."""
        return {int(kind) for kind in np.unique(self.features[:, 10])}

    def texels(self, device: Device) -> Texels:
        """A texel (first texel, count, -, -) per cell, then four per feature.

        Raises
        ------
        InputError
            More of them than float32 counts exactly.
        """
        cells = len(self.cell_start) - 1
        count = cells + 4 * len(self.features)
        got = f"{cells} cells with {len(self.features)} features"
        most = f"at most {MAX_TEXELS} cells and quarter features: take a coarser pattern"
        require(count <= MAX_TEXELS, "render: paint patterns", got, most)
        data = np.zeros((max(count, 1), 4), np.float32)
        data[:cells, 0] = cells + 4 * self.cell_start[:-1].astype(np.int64)
        data[:cells, 1] = np.diff(self.cell_start.astype(np.int64))
        data[cells:count] = self.features.reshape(-1, 4)
        texels = Texels(device, len(data), "rgba32float", "shade.patterns")
        texels.write(data)
        return texels

    def near_features(self, view: View, taken: Collection[int] = ()) -> Bool:
        """Whether any cell under the triangles (T,) of a view has features.

        Counts come from a summed-area table per paint; of the paints ``taken`` all are.
        """
        paint, featured = view.paint, self.paints["featured"]
        everywhere = featured > 1  # speckle and bitmaps
        everywhere[list(taken)] |= featured[list(taken)] == 1
        result = np.take(everywhere, paint, mode="clip")
        for number in np.flatnonzero((featured == 1) & ~everywhere).tolist():
            rows = np.flatnonzero(paint == number)
            whole = len(rows) == len(paint)
            for first in range(0, len(rows), CHUNK):
                part = slice(first, first + CHUNK) if whole else rows[first : first + CHUNK]
                low, high = corner_range(view.corners_of(part, ST))
                result[part] = self._filled(number, low, high) > 0
        return result

    def _filled(self, number: int, low: Float, high: Float) -> Long:
        """Features on file in the cells under boxes ``low`` to ``high`` (n, 2) of a paint."""
        record = self.paints[number]
        total = self._sums(number)
        ends = []
        for axis, most in ((0, int(record["columns"])), (1, int(record["rows"]))):
            start = int(record[("i0", "j0")[axis]])
            # one cell more on each side: a pixel's centre may lie just outside its triangle
            for bound, more in ((low, -1), (high, 2)):
                cell = np.floor(bound[:, axis] / record["cell"]) + (more - start)
                ends.append(np.clip(cell, 0, most).astype(np.int64))
        left, right, top, bottom = ends
        return in_boxes(total, left, top, right, bottom)

    def _sums(self, number: int) -> Long:
        """The summed-area table of a paint's cells, one row and column more."""
        if number not in self._summed:
            record = self.paints[number]
            shape, first = (int(record["rows"]), int(record["columns"])), int(record["first"])
            filled = np.diff(self.cell_start[first : first + shape[0] * shape[1] + 1].astype(int))
            self._summed[number] = summed(filled.reshape(shape))
        return self._summed[number]

    @cached_property
    def _summed(self) -> dict[int, Long]:
        return {}


@dataclass(frozen=True, eq=False)
class _RegionCells:
    """A region's features in cells of side ``cell``, from the ``lowest`` (column, row) on.

    ``counts`` (columns * rows,) features of each cell, whose ``records`` (F, 16) follow each other;
    ``which`` (F,) of the paint's features each one is.
    """

    cell: float
    lowest: tuple[int, int]
    shape: tuple[int, int]
    counts: Long
    records: Float
    which: Long


def _file(region: RegionPaint, extent: float) -> _RegionCells | None:
    """File a region's features; None without any."""
    # a pixel is twice the reach, at most
    longest = 2.0 ** np.ceil(np.log2(max(2.0 * region.reach * extent, 1e-300)))
    if not isinstance(region.paint, Colored):  # a user's own: who knows what changes in it
        return _file_features(region, longest)
    # the frames of a series, and of a view that turns, share what is filed
    wide = 2.0 ** (np.ceil(16.0 * np.log2(max(region.reach, 1e-300))) / 16.0)
    low, high = (tuple(corner.tolist()) for corner in (region.low, region.high))
    reach = float(wide) if region.reach > 0.0 else 0.0
    return _file_again(region.paint, low, high, reach, float(longest))


@lru_cache(maxsize=16)
def _file_again(
    paint: Paint, low: tuple[float, float], high: tuple[float, float], reach: float, longest: float
) -> _RegionCells | None:
    return _file_features(RegionPaint(paint, np.array(low), np.array(high), reach), longest)


def _file_features(region: RegionPaint, longest: float) -> _RegionCells | None:
    """``longest``: no triangle is, in paint coordinates."""
    features = region.paint.features(region.low, region.high)
    if features is None or not len(features):
        return None
    low, high = features.bounds()
    refuse_overlap(features, low, high)
    low, high = low - region.reach, high + region.reach
    cell = _cell_size(features, region, longest)
    lowest = np.floor(np.maximum(low.min(axis=0), region.low - cell) / cell).astype(int)
    highest = np.floor(np.minimum(high.max(axis=0), region.high + cell) / cell).astype(int)
    columns, rows = (np.maximum(highest - lowest, -1) + 1).tolist()
    if columns * rows == 0:
        return None
    c0 = np.clip(np.floor(low / cell).astype(int) - lowest, 0, [columns, rows])
    c1 = np.clip(np.floor(high / cell).astype(int) - lowest + 1, 0, [columns, rows])
    which, at = cells_of_boxes(c0, c1)
    slot = at[:, 1] * columns + at[:, 0]
    order = np.argsort(slot, kind="stable")
    which, slot = which[order], slot[order]
    origin = (at[order] + lowest) * cell
    counts = np.bincount(slot, minlength=columns * rows)
    first = (int(lowest[0]), int(lowest[1]))
    records = _records(features, which, origin)
    return _RegionCells(cell, first, (columns, rows), counts, records, which)


def _file_speckle(
    regions: Sequence[RegionPaint], paints: npt.NDArray[np.void]
) -> tuple[DiscGrid, Long]:
    """The table of the regions with speckle; their records in ``paints`` are filled in."""
    requests: list[tuple[Speckle, Float, Float, float, bool]] = []
    grid_of_paint = np.full(len(paints), -1)
    for number, region in enumerate(regions):
        if isinstance(region.paint, Speckle) and region.reach > 0.0:
            grid_of_paint[number] = len(requests)
            low, high = (region.low, region.high) if region.seen is None else region.seen
            requests.append((region.paint, low, high, region.reach, region.grazing))
    table = speckle_table(requests)
    for number in np.flatnonzero(grid_of_paint >= 0).tolist():
        grid, record = table.grids[grid_of_paint[number]], paints[number]
        record["cell"], record["featured"] = grid.cell, 2 if grid.soft else 3
        record["i0"], record["j0"] = grid.lowest
        record["columns"], record["rows"] = grid.shape
        record["first"], record["cuts"] = grid.first, grid.cuts
        if grid.pieces is not None:
            record["piece"], record["longest"] = grid.pieces.usual, grid.pieces.longest
            record["coverage"] = grid.coverage
        paint = regions[number].paint
        assert isinstance(paint, Speckle)
        record["dot"] = paint.dot
    return table, grid_of_paint


def _cell_size(features: Features, region: RegionPaint, longest: float) -> float:
    """Cells of about two features' size, not below the pixel, not more than the grid may hold.

    Under fine meshes those of boards have two fields: across some twenty float32 is off by the ten
    thousandth of a pixel. A triangle's coordinates are in one cell, whatever that is.
    """
    extent = region.high - region.low
    fields = np.where(features.kind == 0, features.size.max(axis=1), np.inf)
    finest = max(longest, float(np.sqrt(extent.prod() / MAX_BOARD_CELLS)))
    own = np.minimum(features.extent, np.maximum(fields, finest)[:, None])
    size = float(np.median(own)) * 2.0
    size = min(size, float(extent.max()))
    size = max(size, 2.0 * region.reach, float(np.sqrt(extent.prod() / MAX_CELLS)), 1e-300)
    # a power of two: cell corners are then exact in float32
    return float(2.0 ** np.ceil(np.log2(size)))


def _records(features: Features, which: Long, origin: Float) -> Float:
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
    assert features.covers is not None
    table[:, 11] = features.covers[which]
    table[:, 12:14] = np.where(patch[:, None], index, 0.0)
    sector = kind == 2
    stop = angle + squares[:, 0]
    sides = np.stack([cos, sin, np.cos(stop), np.sin(stop)], axis=1)
    table[sector, 4:8] = sides[sector]
    return table
