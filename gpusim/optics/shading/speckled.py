"""Small matte triangles with speckle: what pixels read of theirs is as little as can be.

Where triangles cover a few pixels each, every pixel reads its own one's record (112 bytes), and
looks at all lamps. On matte paint the light is a function of the pixel that goes for a whole
triangle (`gpusim.optics.shading.glance`); with what gives paint coordinates that makes 64 bytes, a
line of the cache. Triangles whose light isn't such a function shade their own pixels afterwards.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from gpusim.errors import TwinMismatch
from gpusim.gpu import Buffer, Device, Recording, Texture, compare, twin_check
from gpusim.gpu.texture_array import Texels
from gpusim.optics.camera.pinhole import Camera
from gpusim.optics.geometry.view import View, look
from gpusim.optics.light.lights import AmbientLight, Light, PointLight
from gpusim.optics.raster.compute_raster import LARGEST, Sight, sheet, sight_twin
from gpusim.optics.shading.deferred_pass import small_triangles
from gpusim.optics.shading.glance import glance_twin
from gpusim.optics.shading.glance_kind import GlanceKind, glance_params
from gpusim.optics.shading.lighting import casts_shadows
from gpusim.optics.shading.setup import Setup
from gpusim.surface.speckle import Speckle

if TYPE_CHECKING:
    from gpusim.optics.shading.scene_buffers import Tables

__all__ = ["SpeckledPass", "all_speckled"]

TOLERANCE = 2e-6
"""Of the light on a triangle, that its function may be off by where that is tested."""


ROUNDING = 5e-7
"""Of the light, by which float32 may see it off otherwise."""

TEXELS = 4
"""Of each triangle."""

SAMPLED = 256
"""Triangles that tell whether light is even on most of them."""

MOST_REFUSED = 0.25
"""Share of the triangles that may shade their own pixels: those cost more than a pixel otherwise
does."""

MOST_CELLS = 65535
"""Columns or rows of a pattern's cells, which share a word."""

SPECKLES = [2], [3]
"""`Setup.groups` of soft and of hard speckle."""

LIT = {"lit": 1.0, "quadratic": 1.0}

PAINT = ("speckle", "grazing", "checkers", "discs", "sectors", "fine", "distorted")
"""Override constants of the shader, of those that its program has."""


class SpeckledPass:
    """The pixels of a view without shadows, all of whose triangles have one speckle.

    ``marked``: triangles leave marks on their own pixels.
    """

    marked = False

    tables: Tables
    sight: Sight
    _found: bool

    def __init__(self, tables: Tables, sight: Sight) -> None:
        device, setup = tables.device, tables.setup
        assert tables.records is not None
        self.tables, self.sight, self._records = tables, sight, tables.records
        count = setup.view.count
        numbers = np.arange(1, count + 1, dtype=np.uint32)
        kinds = [kind for kind in setup.groups_present() if kind]
        constants = {**setup.constants(kinds, False, False), "light_tiled": 0.0, "board": 0.0}
        self.kind = GlanceKind.of(device, constants, device.buffer(numbers, "speckled.numbers"))
        self._seen = device.pool.texels(TEXELS * count, "rgba32uint", "speckled.seen")
        self._found = False
        self._constants = {"quadratic": 1.0, **{name: constants[name] for name in PAINT}}
        paint = int(setup.view.paint[0])
        lowest = tuple(int(setup.table.paints[name][paint]) for name in ("i0", "j0"))
        self._params = {
            "width": setup.view.camera.width, "background": setup.background, "paint": paint
        }  # fmt: skip
        self._looked = {
            **glance_params(tables, TOLERANCE), "count": count, "width": setup.view.camera.width,
            "last": paint, "lowest": lowest,
        }  # fmt: skip

    @cached_property
    def color(self) -> Texture:
        """What a band is drawn into, and copied from into a buffer."""
        width = self.tables.setup.view.camera.width
        return self.tables.device.target(width, self.sight.rows, "r32float", "speckled.radiance")

    @property
    def stride(self) -> int:
        """Pixels from one row of a band's buffer to the next."""
        return self.color.stride // 4

    def begin(self, radiance: Buffer, row0: int, rows: int) -> None:
        """Let the device find the triangles' functions, which `record` does otherwise."""
        with self.tables.device.recording("optics.glance") as recording:
            self._find(recording)

    def record(
        self,
        recording: Recording,
        params: dict[str, Any],
        shared: dict[str, Any],
        radiance: Buffer,
    ) -> None:
        """Shade a band into ``radiance``."""
        sight = self.sight
        assert sight.nearest is not None
        sight.record(recording, int(params["row0"]), int(params["rows"]))
        if not self._found:
            self._find(recording)
        self._draw(recording, "fragment", params, shared, radiance, nearest=sight.nearest)
        self._shade_own(recording, params, shared, radiance, sight.places)

    def _draw(
        self,
        recording: Recording,
        entry: str,
        params: dict[str, Any],
        shared: dict[str, Any],
        radiance: Buffer,
        **seen: Buffer,
    ) -> None:
        """Shade all pixels of a band; ``seen`` tells which triangle each sees."""
        device, size = self.tables.device, (int(params["width"]), int(params["rows"]))
        raster = device.raster(
            "optics/shading/speckled",
            (self.color.format,),
            self._constants,
            ("vertex", entry),
            "none",
        )
        names = ("paints", "patterns", "speckles", "tiles", "undistortion")
        bindings = raster.bind(
            params={**self._params, "row0": params["row0"]}, seen=self._seen, **seen,
            **{name: shared[name] for name in names},
        )  # fmt: skip
        recording.draw(
            raster, bindings, colors=(self.color,), depth=None, vertices=3, size=size, clear=None
        )
        recording.copy_texture(self.color, radiance, size[1])

    def _shade_own(
        self,
        recording: Recording,
        params: dict[str, Any],
        shared: dict[str, Any],
        radiance: Buffer,
        places: Texels,
    ) -> None:
        """Shade the pixels of triangles whose light isn't even one by one."""
        degree = {"quadratic": 0.0, "spacing": 1.0 + 2.0 * self.marked, "signed": self.marked}
        constants = {**self.kind.constants, **{k: float(v) for k, v in degree.items()}}
        kernel = self.tables.device.kernel("optics/shading/forward_pass", "own_pixels", constants)
        values = {
            **shared, "params": params, "band_radiance": radiance, "order": self.kind.refused,
            "band_nearest": self.sight.nearest, "corners": self.sight.drawn.corners,
            "places": places, "band": {"count": self.kind.count, "stride": self.stride},
        }  # fmt: skip
        recording.dispatch_counted(kernel, kernel.bind_used(**values), self.kind.refusals)

    def refused(self) -> npt.NDArray[np.uint32]:
        """Numbers + 1 of those whose light turned out to be no such function; waits."""
        count = int(self.kind.refusals.read(np.uint32, (4,))[3])
        return self.kind.refused.read(np.uint32, (count,))

    def _find(self, recording: Recording) -> None:
        """Find what pixels read, and make the records of triangles that shade their own."""
        self._dispatch(recording, "patterned", self._looked)
        self._found = True

    def _dispatch(
        self, recording: Recording, entry: str, params: dict[str, Any], **more: Any
    ) -> None:
        tables, kind = self.tables, self.kind
        constants = {**LIT, **tables.setup.light_constants(False, False)}
        kernel = tables.device.kernel("optics/shading/glance", entry, constants)
        values = {
            "corners": self.sight.drawn.corners, "vertices": self._records.vertices,
            "looks": self._records.looks, "glances": self._seen, "refused": kind.refused,
            "refusals": kind.refusals, **tables.surface(), **more,
        }  # fmt: skip
        bindings = kernel.bind_used(params=params, **values)
        recording.dispatch(kernel, bindings, threads=(kind.count,))
        self._records.make(recording, kind.refused, kind.refusals)


def may_be_speckled(view: View, lights: Sequence[Light] | None) -> bool:
    """Whether `all_speckled` is likely, as far as a view's paints, sizes and lights tell."""
    if lights is None or len(view.regions) != 1 or view.extent > LARGEST:
        return False
    paint = view.regions[0].paint
    if not isinstance(paint, Speckle) or paint.bump is not None or paint.roughness != 1.0:
        return False
    if casts_shadows(lights) or any(getattr(light, "occlusion", False) for light in lights):
        return False
    return small_triangles(view)


def all_speckled(setup: Setup, sight: Sight | None) -> bool:
    """Whether all triangles of a view are small, matte, lit without shadows, and have one speckle
    that none of them shows at a grazing angle."""
    view, lighting = setup.view, setup.lighting
    if sight is None or sight.nearest is None or not setup.lit:
        return False
    if view.guessed and not sight.late:
        return False
    if lighting.shadows is not None or lighting.openness is not None or setup.bumps is not None:
        return False
    grid = setup.table.speckle.grids
    if len(view.regions) != 1 or not grid or max(grid[0].shape) >= MOST_CELLS:
        return False
    if not view.guessed and setup.groups_present() not in SPECKLES:
        return False
    return not setup.shiny.any() and _mostly_even(setup)


def _mostly_even(setup: Setup) -> bool:
    """Whether light on most triangles (of some) is a function of the pixel."""
    some = np.arange(0, setup.view.count, max(setup.view.count // SAMPLED, 1))
    _, off = glance_twin(replace(setup, view=setup.view.some(some)), np.arange(len(some)), True)
    return bool(np.count_nonzero(off > TOLERANCE) <= MOST_REFUSED * len(some))


@twin_check("optics/shading/speckled")
def _check(device: Device) -> None:
    if not device.atomics64:
        return  # pixels read records: optics/shading/forward_pass
    for paint in (Speckle(0.23, 0.5, 0.03, "lognormal", 0.25, seed=3), Speckle(0.31, seed=4)):
        _compare(device, _probe(paint))


def _probe(paint: Speckle) -> Setup:
    """A bent picture of a crumpled sheet whose light isn't even on some triangles."""
    K = np.array([[555.0, 0.3, 143.5], [0.0, 550.0, 101.0], [0.0, 0.0, 1.0]])
    camera = Camera(295, 195, K, distortion=[-0.1, 0.03, 1e-3, -2e-3])
    lights: list[Light] = [PointLight((0.5, -0.4, -0.3), 150.0, shadows=False), AmbientLight(0.3)]
    return Setup.build(look([sheet(0.95, 1.3, 0.0, paint)], camera, lit=True), lights, 0.25)


def _compare(device: Device, setup: Setup) -> None:
    from gpusim.optics.shading.forward_pass import ShadePass, shade_twin
    from gpusim.optics.shading.scene_buffers import Tables

    view, camera = setup.view, setup.view.camera
    rows = camera.height // 2 + 1
    sight = Sight(device, view, rows)
    shading = ShadePass(Tables(device, setup, sight), rows, True, sight)
    work, parts = shading.glance, []
    if not isinstance(work, SpeckledPass):
        raise TwinMismatch("optics/shading/speckled: shaded in another way")
    for row0 in (0, camera.height - rows):
        out = device.empty(4 * shading.stride * rows, "speckled.check")
        with device.recording("optics.speckled") as recording:
            shading.record(recording, out, row0, rows)
        parts.append(out.read(np.float32, (rows, shading.stride))[:, : camera.width])
    ids = sight_twin(view, 0, camera.height)
    own = np.arange(view.count)
    _, off = glance_twin(setup, own, True)
    refused = np.isin(own + 1, work.refused())
    # float32 may see those at the limit either way
    wrong = (refused != (off > TOLERANCE)) & ~(np.abs(off - TOLERANCE) < ROUNDING)
    if wrong.any() or refused.all() or not refused.any():
        raise TwinMismatch(f"optics/shading/speckled: {int(wrong.sum())} triangles of another kind")
    want = shade_twin(setup, ids)
    for part, twin in zip(parts, (want[:rows], want[-rows:]), strict=True):
        compare("optics/shading/speckled", part, twin, "pixel")
