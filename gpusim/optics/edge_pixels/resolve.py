"""Edge pixels: exact polygon areas of every triangle over the pixel, from front to back.

A triangle takes the area of its polygon inside the pixel less what those in front of it hide
(`gpusim.optics.edge_pixels.visible_polygons`): the paint's mean over the pieces that are left, the
light at their common centroid. What no triangle takes shows the background. The device resolves
most pixels; the rest are left to a host pass (`gpusim.optics.edge_pixels.fragment_shading`), in the
float64 form that is also the shader's twin.

Loop turns of the shader are counted before: devices limit them without a word.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt

from gpusim.arrays.array_types import Bool, Float, Long, Single
from gpusim.arrays.ragged import WORKGROUP, dealt
from gpusim.arrays.unique import distinct
from gpusim.optics.edge_pixels.fragment_lists import EdgePixels
from gpusim.optics.edge_pixels.fragment_shading import THIN, resolve_on_host
from gpusim.optics.frame import Band, write_pixels
from gpusim.optics.geometry.triangle_corners import ST
from gpusim.optics.paint.bitmap import BITMAP
from gpusim.optics.paint.disc_coverage import EDGE_ROWS, row_turns
from gpusim.optics.paint.feature_grid import LOOP_TURNS, FeatureGrid
from gpusim.optics.shading.relighting import PieceShares, listed_shares, no_pieces
from gpusim.optics.shading.scene_buffers import SceneBuffers
from gpusim.optics.shading.setup import Setup
from gpusim.optics.shadow.receivers import TILE, group_starts
from gpusim.optics.shadow.scene import Shadows

MAX_DEPTH = 64
"""Triangles over a pixel beyond which the host resolves it; fewer where patterns are dense. As many
as the shader has bits for."""

MAX_PIECES = 1 << 20
"""Of pixels that look at lamps at a time."""

MAX_ERROR = 2e-4
"""Share of the brightest radiance by which a pixel may be wrong: the host resolves others."""


class EdgePixelPass:
    """The edge pixels of one view: `find`, `host_pass`, then `write`.

    The device finds them by themselves, so that the host can resolve what it is left with while the
    device shades all other pixels.
    """

    def __init__(self, buffers: SceneBuffers, edges: EdgePixels) -> None:
        # about what one triangle takes: clipping and samples, then its features' corners
        table, fine = buffers.setup.table, buffers.setup.programs.fine
        turns = 200 + table.most_in_a_cell * (2000 if fine else 50) + speckle_turns(table)
        self._present = buffers.setup.traits.groups_present()
        turns += 3000 if BITMAP in self._present else 0
        each = turns + grazing_turns(buffers.setup, edges)
        groups = buffers.setup.traits.groups[edges.triangle]
        deep = edges.pierced | (edges.depth > np.minimum(MAX_DEPTH, LOOP_TURNS // each))
        self.buffers = buffers
        order = _alike(edges, deep, np.broadcast_to(each, deep.shape), groups)
        self._deep, self.edges = edges.select(deep), edges.select(order)
        planes = len(buffers.setup.bands)
        # of each edge pixel the words of an `EdgePixel`
        self._words = 2 if planes == 1 else 4
        self._values = np.zeros((0, self._words), np.float32)
        self._resolved = np.zeros(0, np.int64), np.zeros((planes, 0), np.float32)

    def find(self) -> None:
        """Find the pixels on the device, and wait for them."""
        edges, setup, device = self.edges, self.buffers.setup, self.buffers.device
        count = len(edges.pixel)
        if not count:
            return
        lists = np.zeros(2 * (count + 1) + len(edges.triangle), np.uint32)
        lists[0 : 2 * count : 2] = edges.pixel
        lists[1 : 2 * count + 2 : 2] = edges.start + 2 * (count + 1)
        lists[2 * (count + 1) :] = edges.triangle
        values = device.empty(4 * self._words * count, "edges.found")
        constants = setup.programs.constants(self._present, *setup.programs.looks)
        shared = {
            "params": {
                "rays": self.buffers.rays(),
                "width": setup.view.camera.width,
                "background": setup.background,
            },
            "lists": device.buffer(lists, "edges.lists"),
            "found": values,
            **self.buffers.shared(),
            **self.buffers.vertex_buffers.outlines(),
        }
        if setup.lighting.shadows is not None:
            self._find_pieces(setup.lighting.shadows, constants, shared)
        else:
            shared |= no_pieces(device)
            with device.recording("optics.edges") as recording:
                name = setup.programs.name("optics/edge_pixels/resolve")
                kernel = device.kernel(name, "main", constants)
                bindings = kernel.bind_used(range=_range(0, count), **shared)
                recording.dispatch(kernel, bindings, threads=(count,))
        self._values = values.read(np.float32, (count, self._words))

    def _find_pieces(
        self, shadows: Shadows, constants: dict[str, float], shared: dict[str, Any]
    ) -> None:
        """`find` where pieces of pixels ask what they see of lamps: a program lists them, and once
        that is found it lights them."""
        start, count, device = self.edges.start, len(self.edges.pixel), self.buffers.device
        first = 0
        while first < count:
            stop = int(np.searchsorted(start, start[first] + MAX_PIECES, side="right")) - 1
            stop = min(max(stop, first + 1), count)
            slots, starts = self._slots(first, stop)
            pieces = PieceShares(self.buffers, shadows, starts)
            values = {
                **shared, **pieces.bindings(), "slot_of": device.buffer(slots, "edges.slots"),
                "range": {**_range(first, stop), **pieces.range()},
            }  # fmt: skip
            run = partial(self._run_pieces, values, stop - first)
            run("main", {**constants, "listing": 1.0})
            failed = True
            while failed:  # where lists were too short
                pieces.find()
                run("light_pieces", constants)
                failed = pieces.failed()
            pieces.release()
            first = stop

    def _run_pieces(
        self, values: dict[str, Any], count: int, entry: str, constants: dict[str, float]
    ) -> None:
        device = self.buffers.device
        name = self.buffers.setup.programs.name("optics/edge_pixels/resolve")
        kernel = device.kernel(name, entry, constants)
        with device.recording("optics.edges") as recording:
            recording.dispatch(kernel, kernel.bind_used(**values), threads=(count,))

    def _slots(self, first: int, stop: int) -> tuple[npt.NDArray[np.uint32], Long]:
        """Where the pieces of some pixels are listed, and where groups of them begin: those of a
        tile look past the same."""
        row, column = np.divmod(self.edges.pixel[first:stop], self.buffers.setup.view.camera.width)
        tile = (row // TILE << 16) + column // TILE
        order = np.argsort(tile, kind="stable")
        depth = self.edges.depth[first:stop][order]
        ends = np.cumsum(depth)
        slots = np.empty(len(order), np.uint32)
        slots[order] = ends - depth
        last = np.flatnonzero(np.diff(tile[order], append=-1) != 0)
        return slots, group_starts(np.diff(ends[last], prepend=0))

    def host_pass(self) -> None:
        """Find what the device has left.

        The host resolves pixels under many triangles, pixels where bodies cut each other, and those
        that the device was in doubt about: what shows of a triangle there isn't convex, and makes
        a difference.
        """
        setup = self.buffers.setup
        shadows = setup.lighting.shadows
        shares = None if shadows is None else partial(listed_shares, shadows)
        value, doubt = self._values[:, :-1].T.copy(), self._values[:, -1] > 0.0
        if doubt.any():
            value[:, doubt] = resolve_on_host(setup, self.edges.select(doubt), shares)
        pixel = np.concatenate([self.edges.pixel, self._deep.pixel])
        deep = resolve_on_host(setup, self._deep, shares).astype(np.float32)
        self._resolved = pixel, np.concatenate([value, deep], axis=1)

    def write(self, bands: Sequence[Band]) -> None:
        """Write the pixels into ``bands``, whose other pixels are shaded or on their way."""
        width = self.buffers.setup.view.camera.width
        write_pixels(self.buffers.device, bands, width, *self._resolved)


def _range(first: int, stop: int) -> dict[str, Any]:
    """Edge pixels that a program finds."""
    return {
        "first": first, "count": stop, "sides": 3, "corners": 4, "hard_rows": EDGE_ROWS,
        "thin": THIN, "sure": MAX_ERROR, "slots": 0, "casting": 0,
    }  # fmt: skip


def _alike(
    edges: EdgePixels,
    deep: Bool,
    each: Long,
    groups: npt.NDArray[np.uint32],
) -> Long:
    """Pixels that aren't ``deep`` (E,); those under as many triangles, that take about as many
    turns for ``each`` (E,) and are of equal paint, side by side.

    Software rasterisers work on several in step: all of them wait for the deepest, and for the one
    that takes most turns for a triangle. Where that would be too many for some of a workgroup they
    become deep, too.
    """
    # behind the last triangle stands that of pixels that have none
    nearest = np.append(groups, 0)[edges.start[:-1]]
    often = np.frexp(each)[1]
    order = np.lexsort((nearest, often, edges.depth))
    order = order[~deep[order]]
    while len(order):
        begin = np.arange(0, len(order), WORKGROUP)
        depth, turns = (np.maximum.reduceat(v[order], begin) for v in (edges.depth, each))
        group = np.arange(len(order)) // WORKGROUP
        # those that the others of their workgroup are held up by most
        heavy = (depth * turns > LOOP_TURNS)[group] & (2 * each[order] > turns[group])
        if not heavy.any():
            break
        deep[order[heavy]] = True
        order = order[~heavy]
    return dealt(order)


def edges_twin(setup: Setup, edges: EdgePixels, radiance: Single) -> Single:
    """A copy of ``radiance`` (bands, H, W) with the edge pixels resolved."""
    result = radiance.copy()
    result.reshape(len(result), -1)[:, edges.pixel] = resolve_on_host(setup, edges)
    return result


def speckle_turns(table: FeatureGrid) -> int:
    """Loop turns that a polygon over speckle may take: six triangles, rows, points, discs."""
    usual = [3 * grid.cuts for grid in table.speckle.grids if grid.pieces is None]
    if not usual:
        return 0
    most = max(usual)
    return 6 * max(most**2, EDGE_ROWS) * table.speckle.most_in_a_cell


def grazing_turns(setup: Setup, edges: EdgePixels) -> Long:
    """The same (E,) for speckle of which some footprints are large: mean of a pixel's triangles.

    What is seen of a triangle is no larger than the triangle, and than the pixel's footprint.
    """
    view, table = setup.view, setup.table
    if not any(region.grazing for region in view.paints):
        return np.zeros(len(edges.pixel), np.int64)
    turns = np.zeros(view.count + 1, np.int64)
    shown = distinct(edges.triangle[: edges.start[-1]])
    for number, region in enumerate(view.paints):
        rows = shown[view.paint[shown] == number] if region.grazing else shown[:0]
        if len(rows):
            st = view.corners[rows][:, :, ST]
            extent = np.minimum(np.ptp(st, axis=1), 1.2 * _widest_part(setup, rows, st))
            longest = np.hypot(extent[:, 0], extent[:, 1])
            grid = table.speckle.grids[table.grid_of_paint[number]]
            turns[rows] = 6 * row_turns(grid, longest) * (table.speckle.most_in_a_cell + 1)
    if not turns.any():
        return np.zeros(len(edges.pixel), np.int64)
    total = np.concatenate([[0], np.cumsum(turns[edges.triangle])])
    sums = np.diff(total[edges.start])
    result: Long = -(-sums // np.maximum(edges.depth, 1))
    return result


def _widest_part(setup: Setup, triangle: Long, st: Float) -> Float:
    """How far (n, 2) along s and t a pixel may see of triangles whose corners are ``st``.

    One of s and t is bounded by the triangle; that bounds how far a pixel goes along the image,
    and so the other one.
    """
    limit = np.ptp(st, axis=1)
    result = np.zeros((len(triangle), 2))
    for corner in range(3):
        at = setup.view.screen[triangle, corner]
        _, _, ex, ey, _ = setup.coefficients.footprint(triangle, at[:, 0], at[:, 1])
        for axis in (0, 1):
            sides, across = np.stack([ex, ey])[:, :, [axis, 1 - axis]].transpose(2, 0, 1)
            bounds = [np.abs(sides).sum(axis=0)]
            for k in (0, 1):
                ratio = sides[k] / np.where(across[k] != 0.0, across[k], 1e-300)
                rest = np.abs(sides[1 - k] - ratio * across[1 - k])
                bounds.append(np.abs(ratio) * limit[:, 1 - axis] + rest)
            result[:, axis] = np.maximum(result[:, axis], np.min(bounds, axis=0))
    return result
