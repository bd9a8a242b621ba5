"""Shading: the mean radiance over each pixel that lies inside one smooth, evenly painted patch.

On the device the rasteriser finds each pixel's nearest triangle and its fragment shader evaluates
the closed form; the twin evaluates the same on the ids of `gpusim.optics.raster.id_buffer`. Albedo
is the area integral of the paint over the pixel's footprint (`gpusim.optics.paint.feature_grid`);
light is that of the pixel's centre. Radiance of a Lambert surface is albedo x irradiance / pi;
without lights it is the albedo itself.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np
import numpy.typing as npt

from gpusim.errors import InputError
from gpusim.gpu import Buffer, Device, Raster, Recording, Texture, compare, twin_check
from gpusim.optics.edge_pixels.fragment_lists import find_edge_pixels
from gpusim.optics.paint.bitmap import BITMAP, mean_over_pixels
from gpusim.optics.paint.checker_lines import BoardLines
from gpusim.optics.paint.feature_grid import FINEST, LOOP_TURNS
from gpusim.optics.paint.footprint_mean import mean_albedo
from gpusim.optics.probes.paints import probe_setup
from gpusim.optics.raster.compute_raster import NONE, VisibilityBuffer
from gpusim.optics.raster.id_buffer import visibility_twin
from gpusim.optics.shading.deferred_pass import DeferredPass, small_triangles
from gpusim.optics.shading.scene_buffers import SceneBuffers
from gpusim.optics.shading.setup import GRAZING, Setup, footprint, radiance_of
from gpusim.optics.shading.tile_light import SMALLEST, LightTiles, LightTilesPass

__all__ = ["Program", "ShadingPass", "shade_twin"]


@dataclass(frozen=True, eq=False)
class Program:
    """Override constants, and the numbers of the triangles to draw with them, nearest first."""

    constants: dict[str, float]
    triangles: npt.NDArray[np.uint32]


class ShadingPass:
    """Draws a view's radiance band by band.

    A program for each kind of paint, because software rasterisers run both sides of every branch:
    a plain wall must not pay for the pattern on a marker. ``by_pixel``: whether pixels are shaded
    once their triangle is known (`gpusim.optics.shading.deferred_pass`); None decides by the
    triangles' size. ``visibility``: the pixels' triangles, where they are found already.
    ``marked``: whether pixels are marked for `gpusim.optics.shading.relighting`; None where there
    are shadows.
    """

    def __init__(
        self,
        buffers: SceneBuffers,
        rows: int,
        by_pixel: bool | None = None,
        visibility: VisibilityBuffer | None = None,
        marked: bool | None = None,
    ) -> None:
        device, setup = buffers.device, buffers.setup
        view = setup.view
        turns = FINEST * (FINEST + 1) + 1 if setup.constants([1], False, False)["fine"] else 1
        if not setup.table.most_in_a_cell * turns <= LOOP_TURNS:
            raise InputError(
                f"render: paint patterns; got up to {setup.table.most_in_a_cell} features that one "
                f"pixel may touch; expected at most {LOOP_TURNS // turns}: take a coarser pattern, "
                "a view that is less grazing, or backend 'numpy'"
            )
        self.buffers, self.rows = buffers, rows
        by_pixel = small_triangles(view) if by_pixel is None else by_pixel
        if by_pixel:
            visibility = visibility or VisibilityBuffer(device, view, rows)
        marked = setup.lighting.shadows is not None if marked is None else marked
        glossy = bool(setup.shiny.any())
        # no box that is too small holds a triangle that is large enough
        large = 0.5 * view.extent**2 >= SMALLEST
        light = LightTiles.of(setup) if large else None
        self._light = None if light is None else LightTilesPass(buffers, light)
        self._light_found = False
        lines = None if by_pixel else buffers.lines
        programs = _programs(setup, light, lines, sort=not by_pixel)
        self._seen: DeferredPass | None = None
        self._draws: list[tuple[Raster, Buffer, int]] = []
        self.marks: Texture | None = None
        self.color = device.target(view.camera.width, rows, "r32float", "shade.radiance")
        self.colors: tuple[Texture, ...] = (self.color,)
        if marked and visibility is not None and not glossy:
            self.marks = visibility.ids
        elif marked:
            form = "rg32uint" if glossy else "r32uint"
            self.marks = device.target(view.camera.width, rows, form, "shade.marks")
            self.colors = (self.color, self.marks)
        if visibility is not None:
            self._seen = DeferredPass(buffers, rows, programs, visibility)
            return
        self.depth: Texture | None = None
        if not view.flat:
            self.depth = device.target(view.camera.width, rows, "depth32float", "shade.depth")
        marking = "fragment_marked" if glossy else "fragment_numbered"
        entries = ("vertex", "fragment" if self.marks is None else marking)
        formats = tuple(texture.format for texture in self.colors)
        # what is in front comes first where depths are compared, else last
        for program in reversed(programs) if view.flat else programs:
            raster = device.raster(
                "optics/shading/forward_pass", formats, program.constants, entries,
                "none" if view.flat else "greater",
            )  # fmt: skip
            count = len(program.triangles)
            numbers = program.triangles if count else NONE
            self._draws.append((raster, device.buffer(numbers, "shade.order"), count))

    @property
    def stride(self) -> int:
        """Pixels from one row of a band's buffer to the next."""
        return self.color.stride // 4

    def record(self, recording: Recording, radiance: Buffer, row0: int, rows: int) -> None:
        """Shade rows ``row0 …`` into ``radiance`` (rows x stride float32)."""
        setup = self.buffers.setup
        width = setup.view.camera.width
        params = {
            "rays": self.buffers.rays(), "width": width, "rows": rows, "row0": row0,
            "near": self.buffers.vertex_buffers.near, "level": 0.0,
        }  # fmt: skip
        shared = self.buffers.shared()
        shared["light_tiles"] = self.buffers.device.no_texels("rgba32float")
        if self._light is not None:
            if not self._light_found:
                self._light.record(recording)
                self._light_found = True
            shared["light_tiles"] = self._light.texels
        clear: float | None = setup.background
        if self._seen is not None:
            for name in self.buffers.vertex_buffers.outlines():
                del shared[name]
            self._seen.record(recording, self.colors, params, shared)
        for raster, order, count in self._draws:
            values = {**shared, **self.buffers.vertex_buffers.bindings(), "order": order}
            bindings = raster.bind(params=params, **values)
            recording.draw(
                raster,
                bindings,
                colors=self.colors,
                depth=self.depth,
                vertices=3 * count,
                size=(width, rows),
                clear=clear,
            )
            clear = None
        recording.copy_texture(self.color, radiance, rows)


def _programs(
    setup: Setup,
    light: LightTiles | None,
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
    tiled = none if light is None else light.member
    boards = none if lines is None else lines.member
    groups = (BITMAP, 3 + GRAZING, 2 + GRAZING, 3, 2, 1, 0)
    each = (True, False)
    kind = setup.groups.astype(np.uint8) << np.uint8(4)
    for bit, flags in enumerate((tiled, setup.bumpy, setup.shiny, boards)):
        if flags.any():
            kind |= flags.view(np.uint8) << np.uint8(bit)
    many = np.bincount(kind, minlength=256)
    if lines is not None:
        strips = kind[lines.parent]
    kind = kind[order] if sort else kind
    for group, board, glossy, bumpy, lit in product(groups, each, each, each, each):
        wanted = 16 * group + 8 * board + 4 * glossy + 2 * bumpy + lit
        numbers = np.flatnonzero(kind == wanted) if many[wanted] else order[:0]
        own: npt.NDArray[np.uint32] = (order[numbers] if sort else numbers).astype(np.uint32)
        if len(own) or not (group or board or glossy or bumpy or lit or result):
            constants = {**setup.constants([group], glossy, bumpy), "light_tiled": float(lit)}
            if board and lines is not None:
                # in front of the others, which are then left out where they are
                strip = setup.view.count + np.flatnonzero(strips == wanted)
                result.insert(0, Program({**constants, "board": 2.0}, strip.astype(np.uint32)))
            result.append(Program({**constants, "board": float(board)}, own))
    return result


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


@twin_check("optics/shading/forward_pass")
def _check(device: Device) -> None:
    setup = probe_setup()
    camera = setup.view.camera
    want = shade_twin(setup, visibility_twin(setup.view))
    # where edges cross a pixel, hardware and twin may see different triangles at its centre
    inside = np.ones(want.size, bool)
    inside[find_edge_pixels(setup.view).pixel] = False
    buffers = SceneBuffers(device, setup)
    for by_pixel in (False, True):
        shading = ShadingPass(buffers, camera.height, by_pixel)
        out = device.empty(4 * shading.stride * camera.height, "shade.out")
        with device.recording("optics.shade") as recording:
            shading.record(recording, out, 0, camera.height)
        got = out.read(np.float32, (camera.height, shading.stride))[:, : camera.width]
        compare(
            "optics/shading/forward_pass",
            got.reshape(-1)[inside],
            want.reshape(-1)[inside],
            "pixel",
        )
