"""Shading: the mean radiance over each pixel that lies inside one smooth, evenly painted patch.

On the device the rasteriser finds each pixel's nearest triangle and its fragment shader evaluates
the closed form; the twin evaluates the same on the ids of
`gpusim.optics.visibility_buffer`. Albedo is the area integral of the paint over the pixel's
footprint (`gpusim.optics.paint.feature_grid`); light is that of the pixel's centre. Radiance of a
Lambert surface is albedo x irradiance / pi; without lights it is the albedo itself.

There is a program for each kind of paint and light: software rasterisers run both sides of every
branch, and a plain wall must not pay for the pattern on a marker. Large triangles are shaded as
they are drawn (forward). Where triangles cover a few pixels each, rasterisers shade several times
what is seen (blocks of pixels at every border), and set up all that a triangle's pixels share for
those few: then the triangles draw their numbers only, and every pixel reads its own one's record
(deferred).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
import numpy.typing as npt

from gpusim.arrays.array_types import Float, Long, Single
from gpusim.errors import InputError
from gpusim.gpu import Buffer, Raster, Recording, Texture
from gpusim.optics.frame import Band
from gpusim.optics.geometry.view import View
from gpusim.optics.paint.bitmap import BITMAP, mean_over_pixels
from gpusim.optics.paint.checker_lines import BoardLines
from gpusim.optics.paint.feature_grid import FINEST, LOOP_TURNS
from gpusim.optics.paint.footprint_mean import mean_albedo
from gpusim.optics.shading.radiance import radiance_of
from gpusim.optics.shading.scene_buffers import SceneBuffers
from gpusim.optics.shading.setup import Setup
from gpusim.optics.shading.tile_light import LightTiles, TileLightPass
from gpusim.optics.shading.triangle_traits import GRAZING
from gpusim.optics.visibility_buffer import NONE, VisibilityBuffer
from gpusim.surface.color import grey

MAX_PIXELS = 200.0
"""px; triangles that cover fewer are shaded pixel by pixel.

Several programs pass over all of the image once more.
"""

MIN_TRIANGLES = 2000
"""Triangles of a view that is worth it."""

LEVELS = 64
"""More than there are programs; as in the shader."""

PER_TEXEL = 16


def small_triangles(view: View) -> bool:
    """Whether the triangles of a view (some of them, if they are many) cover few pixels each."""
    if view.count < MIN_TRIANGLES:
        return False
    pixels = view.mean_pixels
    if len(view.regions) > 1:
        pixels += view.camera.width * view.camera.height / view.count
    return pixels <= MAX_PIXELS


@dataclass(frozen=True, eq=False)
class Program:
    """Override constants, and the numbers of the triangles to draw with them, nearest first."""

    constants: dict[str, float]
    triangles: npt.NDArray[np.uint32]


def shader_programs(
    setup: Setup,
    tiles: LightTiles | None,
    lines: BoardLines | None,
    sort: bool,
) -> list[Program]:
    """The programs that a view needs, one at least (which clears the targets)."""
    result: list[Program] = []
    order = np.zeros(0, np.int64)
    if sort:
        nearest = setup.view.inverse_depth().max(axis=1, initial=0.0)
        order = np.argsort(-nearest, kind="stable")
    none = np.zeros(setup.view.count, bool)
    tiled = none if tiles is None else tiles.member
    boards = none if lines is None else lines.member
    groups = (BITMAP, 3 + GRAZING, 2 + GRAZING, 3, 2, 1, 0)
    each = (True, False)
    kind = setup.traits.groups.astype(np.uint8) << np.uint8(4)
    for bit, flags in enumerate((tiled, setup.traits.bumpy, setup.traits.shiny, boards)):
        if flags.any():
            kind |= flags.view(np.uint8) << np.uint8(bit)
    many = np.bincount(kind, minlength=256)
    if lines is not None:
        strips = kind[lines.parent]
    kind = kind[order] if sort else kind
    for group, board, glossy, bumpy, lit in product(groups, each, each, each, each):
        wanted = 16 * group + 8 * board + 4 * glossy + 2 * bumpy + lit
        numbers = np.flatnonzero(kind == wanted) if many[wanted] else order[:0]
        triangles: npt.NDArray[np.uint32] = (order[numbers] if sort else numbers).astype(np.uint32)
        if len(triangles) or not (group or board or glossy or bumpy or lit or result):
            constants = setup.programs.constants([group], glossy, bumpy)
            constants["light_tiled"] = float(lit)
            if board and lines is not None:
                # in front of the others, which are then left out where they are
                strip = setup.view.count + np.flatnonzero(strips == wanted)
                result.insert(0, Program({**constants, "board": 2.0}, strip.astype(np.uint32)))
            result.append(Program({**constants, "board": float(board)}, triangles))
    return result


class ShadingPass:
    """Draws a view's radiance band by band.

    ``deferred``: pixels are shaded once it is known which triangle each one sees; otherwise
    triangles are drawn from near to far. ``tiles``: light on large planes. ``marked``: whether
    pixels are marked for `gpusim.optics.shading.relighting`.
    """

    def __init__(
        self,
        buffers: SceneBuffers,
        rows: int,
        deferred: bool = False,
        *,
        tiles: LightTiles | None = None,
        marked: bool = False,
    ) -> None:
        device, setup = buffers.device, buffers.setup
        _check_loops(setup)
        self.buffers, self.rows = buffers, rows
        glossy, _ = setup.programs.looks
        width = setup.view.camera.width
        self._tile_light = None if tiles is None else TileLightPass(buffers, tiles)
        programs = shader_programs(setup, tiles, buffers.lines, sort=not deferred)
        visibility = None
        if deferred:
            visibility = VisibilityBuffer(buffers.vertex_buffers, setup.view, rows)
        self.marks: Texture | None = None
        self.planes = tuple(
            device.target(width, rows, "r32float", f"shade.radiance{k or ''}")
            for k in range(len(setup.bands))
        )
        colors, entry = self.planes, "fragment"
        if marked and visibility is not None and not glossy:
            self.marks = visibility.ids
        elif marked:
            wide = "rg32uint" if len(setup.bands) == 1 else "rgba32uint"
            self.marks = device.target(width, rows, wide if glossy else "r32uint", "shade.marks")
            colors = (*self.planes, self.marks)
            entry = "fragment_marked" if glossy else "fragment_numbered"
        self.colors: tuple[Texture, ...] = colors
        self._pass: DeferredPass | ForwardPass
        if visibility is not None:
            self._pass = DeferredPass(buffers, rows, programs, visibility, colors)
        else:
            self._pass = ForwardPass(buffers, rows, programs, self.colors, entry)

    @property
    def stride(self) -> int:
        """Pixels from one row of a band's buffer to the next."""
        return self.planes[0].stride // 4

    def draw(self, band: Band) -> None:
        """Shade a band."""
        with self.buffers.device.recording("optics.shade") as recording:
            self.record(recording, band.planes, band.row0, band.rows)

    def finish(self) -> None:
        """There is nothing left to do."""

    def record(self, recording: Recording, planes: Sequence[Buffer], row0: int, rows: int) -> None:
        """Shade rows ``row0 …`` into ``planes`` (rows x stride float32 each)."""
        params = {
            "rays": self.buffers.rays(), "width": self.buffers.setup.view.camera.width,
            "rows": rows, "row0": row0, "near": self.buffers.vertex_buffers.near, "level": 0.0,
        }  # fmt: skip
        shared = self.buffers.shared()
        shared["light_tiles"] = self.buffers.device.no_texels("rgba32float")
        if self._tile_light is not None:
            shared["light_tiles"] = self._tile_light.found(recording)
        self._pass.record(recording, self.colors, params, shared)
        for target, plane in zip(self.planes, planes, strict=True):
            recording.copy_texture(target, plane, rows)


class ForwardPass:
    """The programs of a view, each over its triangles from near to far."""

    def __init__(
        self,
        buffers: SceneBuffers,
        rows: int,
        programs: list[Program],
        colors: tuple[Texture, ...],
        entry: str,
    ) -> None:
        device, setup = buffers.device, buffers.setup
        self.buffers = buffers
        self._depth = device.target(setup.view.camera.width, rows, "depth32float", "shade.depth")
        formats = tuple(texture.format for texture in colors)
        self._draws: list[tuple[Raster, Buffer, int]] = []
        name, entries = setup.programs.name("optics/shading/forward_pass"), ("vertex", entry)
        rasters = device.rasters(
            [(name, formats, v.constants, entries, "greater") for v in programs]
        )
        for raster, program in zip(rasters, programs, strict=True):
            count = len(program.triangles)
            numbers = program.triangles if count else NONE
            self._draws.append((raster, device.buffer(numbers, "shade.order"), count))

    def record(
        self,
        recording: Recording,
        colors: tuple[Texture, ...],
        params: dict[str, Any],
        shared: dict[str, Any],
    ) -> None:
        """Shade a band into ``colors``, whose first one is cleared to the background."""
        size = (int(params["width"]), int(params["rows"]))
        clear: Sequence[float] | None = [band.background for band in self.buffers.setup.bands]
        for raster, order, count in self._draws:
            values = {**shared, **self.buffers.vertex_buffers.bindings(), "order": order}
            recording.draw(
                raster, raster.bind_used(params=params, **values), colors=colors, depth=self._depth,
                vertices=3 * count, size=size, clear=clear,
            )  # fmt: skip
            clear = None


class DeferredPass:
    """The programs of a view, each over the pixels that see triangles of its kind.

    Each draws the whole band at a depth of its own, so that it runs where the triangle seen is of
    its kind.
    """

    def __init__(
        self,
        buffers: SceneBuffers,
        rows: int,
        programs: list[Program],
        visibility: VisibilityBuffer,
        colors: tuple[Texture, ...],
    ) -> None:
        device, view = buffers.device, buffers.setup.view
        self.buffers, self.visibility = buffers, visibility
        plain = len(colors) == len(buffers.setup.bands)
        name, band = buffers.setup.programs.name("optics/shading/forward_pass"), "vertex_band"
        formats = tuple(texture.format for texture in colors)
        entries = (band, "fragment_seen" if plain else "fragment_seen_marked")
        self._raster_of_levels, *self._rasters = device.rasters([
            (name, (), programs[0].constants, (band, "fragment_levels"), "greater"),
            *((name, formats, one.constants, entries, "equal") for one in programs),
        ])  # fmt: skip
        count = -(-view.count // PER_TEXEL)
        levels = np.zeros(PER_TEXEL * max(count, 1), np.uint8)
        for k, program in enumerate(programs):
            levels[program.triangles] = k + 1
        self._levels = device.texels(max(count, 1), "rgba32uint", "shade.levels")
        self._levels.write(levels.view(np.uint32).reshape(-1, 4))
        self._depth = device.target(view.camera.width, rows, "depth32float", "shade.level_depth")

    def record(
        self,
        recording: Recording,
        colors: tuple[Texture, ...],
        params: dict[str, Any],
        shared: dict[str, Any],
    ) -> None:
        """Shade a band into ``colors``, whose first one is cleared to the background."""
        ids = self.visibility.ids
        size = (int(params["width"]), int(params["rows"]))
        self.visibility.record(recording, int(params["row0"]), size[1])
        raster = self._raster_of_levels
        bindings = raster.bind(params=params, ids=ids, levels=self._levels)
        recording.draw(raster, bindings, colors=(), depth=self._depth, vertices=3, size=size)
        clear: Sequence[float] | None = [band.background for band in self.buffers.setup.bands]
        for k, raster in enumerate(self._rasters):
            level = {**params, "level": (k + 1) / LEVELS}
            recording.draw(
                raster, raster.bind_used(params=level, ids=ids, **shared), colors=colors,
                depth=self._depth, vertices=3, size=size, clear=clear, keep_depth=True,
            )  # fmt: skip
            clear = None


def _check_loops(setup: Setup) -> None:
    """Refuse patterns whose loops take more turns than devices allow."""
    turns = FINEST * (FINEST + 1) + 1 if setup.programs.fine else 1
    if not setup.table.most_in_a_cell * turns <= LOOP_TURNS:
        raise InputError(
            f"render: paint patterns; got up to {setup.table.most_in_a_cell} features that one "
            f"pixel may touch; expected at most {LOOP_TURNS // turns}: take a coarser pattern, "
            "a view that is less grazing, or backend 'numpy'"
        )


def shade_twin(setup: Setup, ids: npt.NDArray[np.uint32]) -> Single:
    """Radiance (bands, H, W) float32 of the interior pixels, from ids (H, W)."""
    radiance = np.empty((len(setup.bands), *ids.shape), np.float32)
    for plane, band in zip(radiance, setup.bands, strict=True):
        plane[:] = band.background
    for row0 in range(0, ids.shape[0], 64):
        rows_of_ids = ids[row0 : row0 + 64]
        y, x = np.nonzero(rows_of_ids)
        triangle = rows_of_ids[y, x].astype(np.int64) - 1
        column, row = x.astype(np.float64), (y + row0).astype(np.float64)
        paint = setup.view.paint[triangle]
        albedo = np.stack([one.table.paints["ground"][paint] for one in setup.bands]).astype(float)
        featured = setup.table.paints["featured"][paint]
        rows = np.flatnonzero((featured > 0) & (featured < BITMAP))
        if len(rows):
            footprints = _footprints(setup, triangle[rows], column[rows], row[rows])
            grazing = setup.traits.groups[triangle[rows]] > BITMAP
            for band_albedo, band in zip(albedo, setup.bands, strict=True):
                band_albedo[rows] = mean_albedo(band.table, paint[rows], *footprints, grazing)
        for number in setup.bitmaps.images:
            rows = np.flatnonzero(paint == number)
            on_image = setup.coefficients.footprint(triangle[rows], column[rows], row[rows])
            for band_albedo, band in zip(albedo, setup.bands, strict=True):
                image = band.bitmaps.images[number]
                band_albedo[rows] = mean_over_pixels(image, grey(image.ground), *on_image)
        printed = np.zeros(len(paint))
        rows = np.flatnonzero((featured == 1) & setup.traits.shiny[triangle])
        if len(rows):
            footprints = _footprints(setup, triangle[rows], column[rows], row[rows])
            printed[rows] = mean_albedo(setup.table.mask(), paint[rows], *footprints)
        radiance[:, y + row0, x] = radiance_of(setup, triangle, column, row, albedo, printed)
    return radiance


def _footprints(
    setup: Setup, triangle: Long, x: Float, y: Float
) -> tuple[Long, Float, Float, Float, tuple[Float, Float, Float]]:
    """Cells, places, corners, weights and sides of the footprints of pixels (n,)."""
    cell, st, ex, ey, q = setup.coefficients.footprint(triangle, x, y)
    corners = np.stack([-ex - ey, ex - ey, ex + ey, ey - ex], axis=1) * 0.5
    return cell, st, corners, np.ones(corners.shape[:2]), (ex, ey, q)
