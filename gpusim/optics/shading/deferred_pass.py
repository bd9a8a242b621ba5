"""Shading pixel by pixel: first which triangle each one sees, then its light.

Where triangles cover a few pixels each, rasterisers shade several times what is seen (blocks of
pixels at every border), and set up all that a triangle's pixels share for those few. Here the
triangles draw their numbers only, and every pixel reads its own one's record. Each program draws
the whole band at a depth of its own, so that it runs where the triangle seen is of its kind.

Large triangles among small ones, such as walls behind fine bodies, are shaded by themselves, where
their numbers are; programs then pass over the tiles with small ones alone.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from gpusim.arrays.ragged import covered
from gpusim.gpu import Buffer, Recording, Texture
from gpusim.gpu.texture_array import Texels
from gpusim.optics.geometry.view import View
from gpusim.optics.raster.visibility_buffer import NONE, VisibilityBuffer
from gpusim.optics.shading.programs import Program
from gpusim.optics.shading.scene_buffers import SceneBuffers

__all__ = [
    "LARGE_BOX",
    "MAX_PIXELS",
    "MIN_TRIANGLES",
    "DeferredPass",
    "small_triangles",
    "tiles_under",
]

MAX_PIXELS = 200.0
"""px; triangles that cover fewer are shaded pixel by pixel.

Several programs pass over all of the image once more.
"""

MIN_TRIANGLES = 2000
"""Triangles of a view that is worth it."""

LEVELS = 64
"""More than there are programs; as in the shader."""

PER_TEXEL = 16

LARGE_BOX = 64.0
"""px; triangles in a larger box are shaded by themselves, unless they are more than
`MIN_TRIANGLES`."""

TILE = 32
"""px, side of the tiles that programs pass over; as in the shader."""


def small_triangles(view: View) -> bool:
    """Whether the triangles of a view (some of them, if they are many) cover few pixels each."""
    if view.count < MIN_TRIANGLES:
        return False
    pixels = view.mean_pixels
    if len(view.regions) > 1:
        pixels += view.camera.width * view.camera.height / view.count
    return pixels <= MAX_PIXELS


class DeferredPass:
    """The programs of a view, each over the pixels that see triangles of its kind."""

    def __init__(
        self,
        buffers: SceneBuffers,
        rows: int,
        programs: list[Program],
        visibility: VisibilityBuffer,
        whole_large: bool,
    ) -> None:
        """``whole_large``: large triangles are shaded by themselves."""
        device, view = buffers.device, buffers.setup.view
        self.buffers, self.visibility = buffers, visibility
        wide = _large(view) if whole_large else np.zeros(view.count, bool)
        self._wide: list[tuple[dict[str, float], Buffer, int]] = []
        self._tiles: Buffer | None = None
        if wide.any():
            large, programs = _apart(programs, wide), _apart(programs, ~wide)
            for program in large:
                order = device.buffer(program.triangles, "shade.wide")
                self._wide.append((program.constants, order, len(program.triangles)))
            row, column = np.nonzero(tiles_under(view, np.flatnonzero(~wide), TILE))
            self._count = len(row)
            tiles = (row << 16 | column).astype(np.uint32)
            self._tiles = device.buffer(tiles if self._count else NONE, "shade.tiles")
        self.programs = programs
        self._levels: Texels | None = None
        if len(programs) > 1 or visibility.depth is None or self._tiles is not None:
            count = -(-view.count // PER_TEXEL)
            levels = np.zeros(PER_TEXEL * count, np.uint8)
            for k, program in enumerate(programs):
                levels[program.triangles] = k + 1
            self._levels = device.texels(count, "rgba32uint", "shade.levels")
            self._levels.write(levels.view(np.uint32).reshape(-1, 4))
            self.level_depth = device.target(
                view.camera.width, rows, "depth32float", "shade.level_depth"
            )

    def _level(self, k: int) -> float:
        """The depth of program k; one alone may draw before the triangles that were drawn."""
        return (k + 1) / LEVELS if self._levels else 0.0

    def record(
        self,
        recording: Recording,
        colors: tuple[Texture, ...],
        params: dict[str, Any],
        shared: dict[str, Any],
    ) -> None:
        """Shade a band into ``colors``, whose first one is cleared to ``shared``'s background."""
        device = self.buffers.device
        size = (int(params["width"]), int(params["rows"]))
        self.visibility.record(recording, int(params["row0"]), size[1])
        self.visibility.number(recording, int(params["row0"]), size[1])
        ids, depth = self.visibility.ids, self.visibility.depth
        formats = tuple(texture.format for texture in colors)
        marking = "" if len(colors) == 1 else "_marked"
        clear: float | None = self.buffers.setup.background
        for constants, order, count in self._wide:
            raster = device.raster(
                "optics/shading/forward_pass",
                formats,
                constants,
                entries=("vertex", "fragment_own" + marking),
                depth="none",
            )
            values = {
                **shared,
                **self.buffers.vertex_buffers.bindings(),
                "order": order,
                "ids": ids,
            }
            recording.draw(
                raster, raster.bind(params=params, **values), colors=colors, depth=None,
                vertices=3 * count, size=size, clear=clear,
            )  # fmt: skip
            clear = None
        where: dict[str, Any] = {}
        over, vertices = "vertex_band", 3
        if self._tiles is not None:
            where, over, vertices = {"order": self._tiles}, "vertex_tiles", 6 * self._count
        if self._levels is not None:
            depth = self.level_depth
            raster = device.raster(
                "optics/shading/forward_pass",
                (),
                self.programs[0].constants,
                entries=(over, "fragment_levels"),
            )
            values = {**where, "ids": ids, "levels": self._levels}
            bindings = raster.bind(params={**params, "level": 0.0}, **values)
            recording.draw(raster, bindings, colors=(), depth=depth, vertices=vertices, size=size)
        for k, program in enumerate(self.programs):
            raster = device.raster(
                "optics/shading/forward_pass", formats, program.constants,
                entries=(over, "fragment_seen" + marking),
                depth="equal" if self._levels else "less",
            )  # fmt: skip
            values = {**shared, **where, "ids": ids}
            bindings = raster.bind(params={**params, "level": self._level(k)}, **values)
            recording.draw(
                raster, bindings, colors=colors, depth=depth, vertices=vertices, size=size,
                clear=clear, keep_depth=True,
            )  # fmt: skip
            clear = None


def _large(view: View) -> npt.NDArray[np.bool_]:
    """(T,): large triangles that are worth to be shaded by themselves."""
    none = np.zeros(view.count, bool)
    if view.extent <= LARGE_BOX:
        return none
    low, high = view.box
    wide = np.maximum(high[:, 0] - low[:, 0], high[:, 1] - low[:, 1]) > LARGE_BOX
    return wide if 0 < np.count_nonzero(wide) <= MIN_TRIANGLES and not wide.all() else none


def _apart(programs: list[Program], own: npt.NDArray[np.bool_]) -> list[Program]:
    """The same for some of the triangles, those without any left out."""
    parts = [
        replace(program, triangles=program.triangles[own[program.triangles]])
        for program in programs
    ]
    return [part for part in parts if len(part.triangles)]


def tiles_under(view: View, triangles: npt.NDArray[np.int64], side: int) -> npt.NDArray[np.bool_]:
    """(rows, columns): tiles, ``side`` px wide, within a pixel of the boxes of ``triangles``
    (n,)."""
    shape = (-(-view.camera.height // side), -(-view.camera.width // side))
    first, last = (np.empty((2, len(triangles)), np.int64).T for _ in range(2))
    for ends, own, more in ((first, view.box[0], -0.5), (last, view.box[1], 1.5 + side)):
        for axis, limit in enumerate(shape[::-1]):
            place = np.take(own[:, axis], triangles)
            place += more
            place /= side
            ends[:, axis] = np.clip(np.floor(place), 0, limit)
    return covered(first, last, shape)
