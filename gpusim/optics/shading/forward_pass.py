"""Shading: the mean radiance over each pixel that lies inside one smooth, evenly painted patch.

On the device the rasteriser finds each pixel's nearest triangle and its fragment shader evaluates
the closed form; the twin evaluates the same on the ids of `gpusim.optics.raster.id_buffer`. Albedo
is the area integral of the paint over the pixel's footprint (`gpusim.optics.paint.feature_grid`);
light is that of the pixel's centre. Radiance of a Lambert surface is albedo x irradiance / pi;
without lights it is the albedo itself.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from gpusim.errors import InputError
from gpusim.gpu import Buffer, Raster, Recording, Texture
from gpusim.optics.paint.bitmap import BITMAP, mean_over_pixels
from gpusim.optics.paint.feature_grid import FINEST, LOOP_TURNS
from gpusim.optics.paint.footprint_mean import mean_albedo
from gpusim.optics.raster.visibility_buffer import NONE, VisibilityBuffer
from gpusim.optics.shading.deferred_pass import DeferredPass
from gpusim.optics.shading.programs import Program, shader_programs
from gpusim.optics.shading.scene_buffers import SceneBuffers
from gpusim.optics.shading.setup import Setup, footprint, radiance_of
from gpusim.optics.shading.tile_light import LightTiles, TileLightPass

__all__ = ["ForwardPass", "ShadingPass", "shade_twin"]


class ShadingPass:
    """Draws a view's radiance band by band.

    ``visibility``: the triangle that each pixel sees, where pixels are shaded once that is known
    (`gpusim.optics.shading.deferred_pass`); without one triangles are drawn from near to far.
    ``tiles``: light on large planes. ``marked``: whether pixels are marked for
    `gpusim.optics.shading.relighting`. ``whole_large``: large triangles among small ones are shaded
    as wholes. ``painter``: triangles of one plane are drawn without a depth buffer.
    """

    def __init__(
        self,
        buffers: SceneBuffers,
        rows: int,
        visibility: VisibilityBuffer | None = None,
        *,
        tiles: LightTiles | None = None,
        marked: bool = False,
        whole_large: bool = True,
        painter: bool = False,
    ) -> None:
        device, setup = buffers.device, buffers.setup
        _check_loops(setup)
        self.buffers, self.rows = buffers, rows
        glossy = bool(setup.shiny.any())
        width = setup.view.camera.width
        self._tile_light = None if tiles is None else TileLightPass(buffers, tiles)
        programs = shader_programs(setup, tiles, buffers.lines, sort=visibility is None)
        self.marks: Texture | None = None
        self.color = device.target(width, rows, "r32float", "shade.radiance")
        self.colors: tuple[Texture, ...] = (self.color,)
        if marked and visibility is not None and not glossy:
            self.marks = visibility.ids
        elif marked:
            form = "rg32uint" if glossy else "r32uint"
            self.marks = device.target(width, rows, form, "shade.marks")
            self.colors = (self.color, self.marks)
        self._pass: DeferredPass | ForwardPass
        if visibility is not None:
            self._pass = DeferredPass(buffers, rows, programs, visibility, whole_large)
        else:
            self._pass = ForwardPass(buffers, rows, programs, self.colors, painter)

    @property
    def stride(self) -> int:
        """Pixels from one row of a band's buffer to the next."""
        return self.color.stride // 4

    def record(self, recording: Recording, radiance: Buffer, row0: int, rows: int) -> None:
        """Shade rows ``row0 …`` into ``radiance`` (rows x stride float32)."""
        params = {
            "rays": self.buffers.rays(), "width": self.buffers.setup.view.camera.width,
            "rows": rows, "row0": row0, "near": self.buffers.vertex_buffers.near, "level": 0.0,
        }  # fmt: skip
        shared = self.buffers.shared()
        shared["light_tiles"] = self.buffers.device.no_texels("rgba32float")
        if self._tile_light is not None:
            shared["light_tiles"] = self._tile_light.found(recording)
        self._pass.record(recording, self.colors, params, shared)
        recording.copy_texture(self.color, radiance, rows)


class ForwardPass:
    """The programs of a view, each over its triangles from near to far."""

    def __init__(
        self,
        buffers: SceneBuffers,
        rows: int,
        programs: list[Program],
        colors: tuple[Texture, ...],
        painter: bool,
    ) -> None:
        device, setup = buffers.device, buffers.setup
        self.buffers, self.depth = buffers, None
        if not painter:
            width = setup.view.camera.width
            self.depth = device.target(width, rows, "depth32float", "shade.depth")
        entry = "fragment"
        if len(colors) > 1:
            entry = "fragment_marked" if setup.shiny.any() else "fragment_numbered"
        formats = tuple(texture.format for texture in colors)
        self._draws: list[tuple[Raster, Buffer, int]] = []
        # what is in front comes first where depths are compared, else last
        for program in reversed(programs) if painter else programs:
            raster = device.raster(
                "optics/shading/forward_pass", formats, program.constants, ("vertex", entry),
                "none" if painter else "greater",
            )  # fmt: skip
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
        clear: float | None = self.buffers.setup.background
        for raster, order, count in self._draws:
            values = {**shared, **self.buffers.vertex_buffers.bindings(), "order": order}
            recording.draw(
                raster, raster.bind(params=params, **values), colors=colors, depth=self.depth,
                vertices=3 * count, size=size, clear=clear,
            )  # fmt: skip
            clear = None


def _check_loops(setup: Setup) -> None:
    """Refuse patterns whose loops take more turns than devices allow."""
    turns = FINEST * (FINEST + 1) + 1 if setup.constants([1], False, False)["fine"] else 1
    if not setup.table.most_in_a_cell * turns <= LOOP_TURNS:
        raise InputError(
            f"render: paint patterns; got up to {setup.table.most_in_a_cell} features that one "
            f"pixel may touch; expected at most {LOOP_TURNS // turns}: take a coarser pattern, "
            "a view that is less grazing, or backend 'numpy'"
        )


def shade_twin(setup: Setup, ids: npt.NDArray[np.uint32]) -> npt.NDArray[np.float32]:
    """Radiance (H, W) float32 of the interior pixels, from ids (H, W)."""
    radiance = np.full(ids.shape, setup.background, np.float32)
    for row0 in range(0, ids.shape[0], 64):
        band = ids[row0 : row0 + 64]
        y, x = np.nonzero(band)
        triangle = band[y, x].astype(np.int64) - 1
        column, row = x.astype(np.float64), (y + row0).astype(np.float64)
        paint = setup.view.paint[triangle]
        albedo = setup.table.paints["ground"][paint].astype(np.float64)
        featured = setup.table.paints["featured"][paint]
        rows = np.flatnonzero((featured > 0) & (featured < BITMAP))
        if len(rows):
            st, ex, ey, q = footprint(setup, triangle[rows], column[rows], row[rows])
            corners = np.stack([-ex - ey, ex - ey, ex + ey, ey - ex], axis=1) * 0.5
            albedo[rows] = mean_albedo(
                setup.table, paint[rows], setup.of(triangle[rows]).cell, st, corners,
                np.ones(corners.shape[:2]), (ex, ey, q), setup.groups[triangle[rows]] > BITMAP,
            )  # fmt: skip
        for number, image in setup.bitmaps.images.items():
            rows = np.flatnonzero(paint == number)
            st, ex, ey, q = footprint(setup, triangle[rows], column[rows], row[rows])
            albedo[rows] = mean_over_pixels(
                image, image.ground, setup.of(triangle[rows]).cell, st, ex, ey, q
            )
        printed = np.zeros(len(albedo))
        rows = np.flatnonzero((featured == 1) & setup.shiny[triangle])
        if len(rows):
            st, ex, ey, q = footprint(setup, triangle[rows], column[rows], row[rows])
            corners = np.stack([-ex - ey, ex - ey, ex + ey, ey - ex], axis=1) * 0.5
            printed[rows] = mean_albedo(
                setup.table.mask(), paint[rows], setup.of(triangle[rows]).cell, st, corners,
                np.ones(corners.shape[:2]), (ex, ey, q),
            )  # fmt: skip
        radiance[y + row0, x] = radiance_of(setup, triangle, column, row, albedo, printed)
    return radiance
