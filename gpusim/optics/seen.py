"""Shading pixel by pixel: first which triangle each one sees, then its light.

Where triangles cover a few pixels each, rasterisers shade several times what is seen (blocks of
pixels at every border), and set up all that a triangle's pixels share for those few. Here the
triangles draw their numbers only, and every pixel reads its own one's record. Each program draws
the whole band at a depth of its own, so that it runs where the triangle seen is of its kind.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from gpusim.gpu import Recording, Texture
from gpusim.gpu.texels import Texels
from gpusim.optics.sight import Sight
from gpusim.optics.view import View

if TYPE_CHECKING:
    from gpusim.optics.shade import Program
    from gpusim.optics.tables import Tables

__all__ = ["FEWEST", "SMALL", "SeenPass", "small_triangles"]

SMALL = 200.0
"""px; triangles that cover fewer are shaded pixel by pixel, larger ones where
`gpusim.optics.glance.may_glance` says so.

Several programs pass over all of the image once more.
"""

FEWEST = 2000
"""Triangles of a view that is worth it."""

LEVELS = 64
"""More than there are programs; as in the shader."""

PER_TEXEL = 16


def small_triangles(view: View) -> bool:
    """Whether the triangles of a view (some of them, if they are many) cover few pixels each."""
    if view.count < FEWEST:
        return False
    pixels = view.mean_pixels
    if len(view.regions) > 1:
        pixels += view.camera.width * view.camera.height / view.count
    return pixels <= SMALL


class SeenPass:
    """The programs of a view, each over the pixels that see triangles of its kind."""

    def __init__(self, tables: Tables, rows: int, programs: list[Program], sight: Sight) -> None:
        device, width = tables.device, tables.setup.view.camera.width
        self.tables, self.programs, self.sight = tables, programs, sight
        self._levels: Texels | None = None
        if len(programs) > 1 or sight.depth is None:
            count = -(-tables.setup.view.count // PER_TEXEL)
            levels = np.zeros(PER_TEXEL * count, np.uint8)
            for k, program in enumerate(programs):
                levels[program.triangles] = k + 1
            self._levels = device.texels(count, "rgba32uint", "shade.levels")
            self._levels.write(levels.view(np.uint32).reshape(-1, 4))
            self.level_depth = device.target(width, rows, "depth32float", "shade.level_depth")

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
        device = self.tables.device
        size = (int(params["width"]), int(params["rows"]))
        self.sight.record(recording, int(params["row0"]), size[1])
        self.sight.number(recording, int(params["row0"]), size[1])
        ids, depth = self.sight.ids, self.sight.depth
        if self._levels is not None:
            depth = self.level_depth
            raster = device.raster(
                "optics/shade", (), self.programs[0].constants,
                entries=("vertex_band", "fragment_levels"),
            )  # fmt: skip
            bindings = raster.bind(params={**params, "level": 0.0}, ids=ids, levels=self._levels)
            recording.draw(raster, bindings, colors=(), depth=depth, vertices=3, size=size)
        entry = "fragment_seen" if len(colors) == 1 else "fragment_seen_marked"
        clear: float | None = self.tables.setup.background
        for k, program in enumerate(self.programs):
            raster = device.raster(
                "optics/shade", tuple(texture.format for texture in colors), program.constants,
                entries=("vertex_band", entry), depth="equal" if self._levels else "less",
            )  # fmt: skip
            bindings = raster.bind(params={**params, "level": self._level(k)}, ids=ids, **shared)
            recording.draw(
                raster, bindings, colors=colors, depth=depth, vertices=3, size=size, clear=clear,
                keep_depth=True,
            )  # fmt: skip
            clear = None
