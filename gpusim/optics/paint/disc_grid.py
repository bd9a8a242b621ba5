"""Speckle as lists of discs per cell, for the host and the device.

A disc is filed in every cell from which a pixel can meet it. `gpusim.optics.paint.disc_coverage`
and ``shaders/lib/paint/disc_coverage.wgsl`` evaluate the lists.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from weakref import WeakKeyDictionary

import numpy as np

from gpusim.arrays.array_types import Float, Long
from gpusim.arrays.ragged import cells_of_boxes
from gpusim.gpu import Device
from gpusim.gpu.texture_array import Texels
from gpusim.optics.geometry.pixel_footprint import MAX_CUTS, SAFETY, Pieces, pieces_of
from gpusim.surface.speckle import EDGE, Speckle, outer_radius
from gpusim.validation import require

CELL = 0.42
"""Side of a cell over a disc's outer radius, before it is rounded to a power of two."""

MAX_TEXELS = 1 << 24
"""Positions in the table are stored as float32, which counts exactly up to here."""

SOFTEST = 0.4
"""Edge softness over the side of a piece from which 3 x 3 points suffice."""

KEPT = 4
"""Tables kept for further frames, on the host and on each device."""


@dataclass(frozen=True)
class SpeckleGrid:
    """A region's cells in paint coordinates: side ``cell``, lowest cell, and counts.

    ``first`` is the texel of its first cell; ``cuts`` how often a footprint over the smallest disc
    is cut a side. ``smallest``: that disc's radius where others are cut less, else 0.
    ``pieces``: how long those of larger footprints than the table was made for are, if there are
    such, and ``coverage`` what the longest ones get.
    """

    cell: float
    lowest: tuple[int, int]
    shape: tuple[int, int]
    first: int
    cuts: int
    smallest: float
    soft: bool
    pieces: Pieces | None
    coverage: float


@dataclass(frozen=True, eq=False)
class DiscGrid:
    """Cells and discs of all speckled regions.

    A cell's texel is (start, count, smallest, -) of its list; a disc's is (s, t, radius,
    1 / (2 r h)), s and t relative to the cell's corner, with h the half width of its edge (0 where
    it is hard). ``start`` (C + 1,) and ``disc`` (E, 4) are the same before rounding, without the
    offset.
    """

    grids: tuple[SpeckleGrid, ...]
    start: Long
    disc: Float

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
            for grid in self.grids:
                data[grid.first : grid.first + grid.shape[0] * grid.shape[1], 2] = grid.smallest
            data[cells:] = self.disc
            texels = Texels(device, max(len(data), 1), "rgba32float", "speckle.discs")
            if len(data):
                texels.write(data)
            kept[id(self)] = (self, texels)
            while len(kept) > KEPT:
                kept.popitem(last=False)
        kept.move_to_end(id(self))
        return kept[id(self)][1]


_uploaded: WeakKeyDictionary[Device, OrderedDict[int, tuple[DiscGrid, Texels]]] = (
    WeakKeyDictionary()
)
Request = tuple[Speckle, tuple[float, float], tuple[float, float], float, bool]


def speckle_table(regions: Sequence[tuple[Speckle, Float, Float, float, bool]]) -> DiscGrid:
    """Tables for regions (paint, low, high, reach, grazing), kept for equal ones.

    Extents and reach are rounded up, so that the frames of a series share one table.

    Raises
    ------
    InputError
        Discs that are too small against the pixel, or too many.
    """
    requests = []
    for paint, low, high, reach, grazing in regions:
        grain = 2.0 ** np.ceil(np.log2(max(float((high - low).max()), 1e-300) / 32.0))
        start, stop = np.floor(low / grain) * grain, np.ceil(high / grain) * grain
        wide = float(2.0 ** (np.ceil(16.0 * np.log2(max(reach, 1e-300))) / 16.0))
        requests.append(
            (paint, (float(start[0]), float(start[1])), (float(stop[0]), float(stop[1])), wide,
             grazing)
        )  # fmt: skip
    return _table(tuple(requests))


@lru_cache(maxsize=KEPT)
def _table(requests: tuple[Request, ...]) -> DiscGrid:
    grids: list[SpeckleGrid] = []
    starts, discs = [np.zeros(1, np.int64)], [np.zeros((0, 4))]
    cells = entries = 0
    for paint, low, high, reach, grazing in requests:
        corners = np.array(low), np.array(high)
        grid, start, disc = _region(paint, *corners, reach, grazing, cells)
        grids.append(grid)
        starts.append(start[1:] + entries)
        discs.append(disc)
        cells += len(start) - 1
        entries += len(disc)
        got = f"{paint.diameter:g}, which makes {entries} entries in {cells} cells"
        expected = f"at most {MAX_TEXELS}: larger speckles, or a view that is less grazing"
        require(cells + entries <= MAX_TEXELS, "Speckle diameter", got, expected)
    return DiscGrid(tuple(grids), np.concatenate(starts), np.concatenate(discs))


def _region(
    paint: Speckle, low: Float, high: Float, reach: float, grazing: bool, first: int
) -> tuple[SpeckleGrid, Long, Float]:
    """One region's cells, where each cell's list starts (C + 1,), and the lists (E, 4)."""
    half = EDGE * paint.softness
    # a power of two: cell corners are then exact in float32
    typical = outer_radius(0.5 * paint.diameter, paint.softness) + SAFETY * reach
    cell = float(2.0 ** np.round(np.log2(CELL * typical)))
    # fewer, larger cells where the table would outgrow its share
    while _texels(paint, high - low, typical, cell) > MAX_TEXELS / 2 and cell < typical:
        cell *= 2.0
    lowest = np.floor(low / cell).astype(int) - 1
    columns, rows = (np.floor(high / cell).astype(int) + 2 - lowest).tolist()
    got = f"{paint.diameter:g}, which makes {columns} x {rows} cells"
    require(columns * rows <= MAX_TEXELS, "Speckle diameter", got, f"at most {MAX_TEXELS}")
    cuts = _cuts(paint, reach)
    varied = half == 0.0 and cuts > 1 and paint.smallest < paint.largest
    grid = SpeckleGrid(
        cell, (int(lowest[0]), int(lowest[1])), (columns, rows), first, cuts,
        paint.smallest if varied else 0.0, half > 0.0, pieces_of(paint) if grazing else None,
        paint.coverage,
    )  # fmt: skip
    origin = lowest * cell
    centre, radius = paint.discs(origin, origin + cell * np.array([columns, rows]))
    outer = np.sqrt(radius * (radius + 2.0 * half))
    margin = SAFETY * reach
    position = (centre - origin) / cell
    reached = ((outer + margin) / cell)[:, None]
    start = np.maximum(np.floor(position - reached), 0).astype(np.int64)
    stop = np.minimum(np.floor(position + reached) + 1, [columns, rows]).astype(np.int64)
    owner, at = cells_of_boxes(start, stop)
    # distance from the disc's centre to the cell, grown by what a pixel reaches
    place = position[owner]
    gap = np.maximum(np.maximum(at - place, place - at - 1.0) * cell - margin, 0.0)
    meets = gap[:, 0] ** 2 + gap[:, 1] ** 2 < outer[owner] ** 2
    # by cell, then by disc
    pair = (at[meets, 1] * columns + at[meets, 0]) * max(len(centre), 1) + owner[meets]
    slot, owner = np.divmod(np.sort(pair), max(len(centre), 1))
    corner = np.stack([slot % columns, slot // columns], axis=1) * cell + origin
    inverse = 0.5 / (radius * half) if half > 0.0 else np.zeros_like(radius)
    disc = np.column_stack([centre[owner] - corner, radius[owner], inverse[owner]])
    counts = np.bincount(slot, minlength=columns * rows)
    return grid, np.concatenate([[0], np.cumsum(counts)]), disc


def _texels(paint: Speckle, extent: Float, outer: float, cell: float) -> float:
    """About how many texels a region takes: its cells, and each disc in those that it meets."""
    meets = (np.pi * outer**2 + 4.0 * outer * cell + cell**2) / cell**2
    area = float(np.prod(extent + 2.0 * outer))
    return area / cell**2 + meets * paint.intensity * area


def _cuts(paint: Speckle, reach: float) -> int:
    """Pieces a side that a footprint of half width ``reach`` is cut into."""
    if paint.softness > 0.0:
        wanted = 2.0 * reach * max(SOFTEST / paint.softness, 2.0 / paint.diameter)
        return int(np.clip(np.ceil(wanted - 1e-9), 1, MAX_CUTS))
    # the circle's series holds while a piece's half diagonal is below 2/3 of the radius
    wanted = np.ceil(1.5 * np.sqrt(2.0) * reach / paint.smallest - 1e-9)
    small, wide = 2.0 * paint.smallest, 2.0 * reach
    got = f"discs down to {small:g} with hard edges under pixels up to {wide:g} wide"
    less = "larger speckles, soft edges, or a view that is less grazing"
    expected = f"at least a quarter of a pixel: {less}"
    require(wanted <= MAX_CUTS, "Speckle diameter", got, expected)
    return int(max(wanted, 1))
