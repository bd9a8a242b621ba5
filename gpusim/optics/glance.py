"""Light on small matte triangles: an affine function of the pixel each, read as one texel.

On a triangle of a few pixels the light changes so evenly that what falls on its corners tells all
between. A pixel then reads four numbers in place of a record of 28, and no lamp. Where the light at
the middles of a triangle's sides is off by more than `TOLERANCE` of it, and on all other paint, an
invocation per triangle shades the triangle's own pixels one by one, whose record it reads once.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from gpusim.errors import TwinMismatch
from gpusim.gpu import Buffer, Device, Recording, compare, twin_check
from gpusim.optics.camera import Camera
from gpusim.optics.light import AmbientLight, Light, PointLight
from gpusim.optics.setup import Setup, radiance_of
from gpusim.optics.sight import Sight, sheet, sight_twin
from gpusim.optics.view import look
from gpusim.surface.paint import Checker, Plain

if TYPE_CHECKING:
    from gpusim.optics.shade import Program, Tables

__all__ = ["TOLERANCE", "GlancePass", "glance_twin"]

Array = npt.NDArray[np.float64]

TOLERANCE = 1e-5
"""Of the light on a triangle, that its function may be off by at the middle of a side."""

LEAST_SHARE = 0.5
"""Of the triangles that have such a function; with fewer it isn't worth it."""

PIXELS = 4
"""Shaded by an invocation, as the shader says."""


class GlancePass:
    """The pixels of a view without shadows whose triangles are known.

    ``color``: what a band is drawn into, four pixels of a row in a texel; copied into a buffer,
    its bytes are those of single pixels.
    """

    def __init__(self, tables: Tables, programs: list[Program], sight: Sight) -> None:
        device, view = tables.device, tables.setup.view
        assert tables.records is not None
        columns = -(-view.camera.width // PIXELS)
        self.color = device.target(columns, sight.rows, "rgba32float", "glance.radiance")
        self.tables, self.sight, self._records = tables, sight, tables.records
        self._own = []
        for program in programs:
            count = len(program.triangles)
            if glanced(program):
                self._plain = program
                self._order = device.buffer(program.triangles, "glance.order")
                self._refused = device.empty(4 * max(count, 1), "glance.refused")
                self._refusals = device.buffer(np.array([0, 1, 1, 0], np.uint32), "glance.refusals")
            elif count:
                numbers = device.buffer(program.triangles + np.uint32(1), "glance.numbers")
                self._own.append((program.constants, count, numbers))
        self._glances = device.kept.texels(max(view.count, 1), "rgba32uint", "glance.glances")
        self._found = False

    @staticmethod
    def suits(tables: Tables, programs: list[Program], sight: Sight) -> bool:
        """Whether most triangles of a view are matte and plain, without shadows on them."""
        count = tables.setup.view.count
        return (
            tables.records is not None
            and glances(tables.setup, sight)
            and any(
                glanced(program) and len(program.triangles) >= LEAST_SHARE * count
                for program in programs
            )
        )

    def record(
        self,
        recording: Recording,
        params: dict[str, Any],
        shared: dict[str, Any],
        radiance: Buffer,
    ) -> None:
        """Shade a band into ``radiance``, whose rows are as long as those of ``color``."""
        device, sight = self.tables.device, self.sight
        assert sight.nearest is not None
        size = int(params["width"]), int(params["rows"])
        sight.record(recording, int(params["row0"]), size[1])
        own = {
            "rays": params["rays"], "count": len(self._plain.triangles), "width": size[0],
            "row0": params["row0"], "background": self.tables.setup.background,
            "tolerance": TOLERANCE, "inverse_depth": self._records.inverse_depth,
        }  # fmt: skip
        constants = {
            "lit": float(self.tables.setup.lit),
            **self.tables.setup.light_constants(False, False),
        }
        if not self._found:
            self._find(recording, own, constants)
            for _, _, numbers in self._own:
                self._records.make(recording, numbers)
            self._records.make(recording, self._refused, self._refusals)
            self._found = True
        raster = device.raster(
            "optics/glance", (self.color.format,), constants=constants, depth="none"
        )
        bent = {name: shared[name] for name in ("tiles", "undistortion")}
        bindings = raster.bind(params=own, nearest=sight.nearest, seen=self._glances, **bent)
        recording.draw(
            raster, bindings, colors=(self.color,), depth=None, vertices=3,
            size=(self.color.width, size[1]),
        )  # fmt: skip
        recording.copy_texture(self.color, radiance, size[1])
        rest = (self._plain.constants, len(self._plain.triangles), self._refused)
        for constants, count, numbers in (*self._own, rest):
            kernel = device.kernel("optics/shade", "own_pixels", constants)
            bindings = kernel.bind(
                params=params, band={"count": count, "stride": self.color.stride // 4},
                order=numbers, band_nearest=sight.nearest, band_radiance=radiance,
                corners=sight.drawn.corners, places=sight.places, **shared,
            )  # fmt: skip
            if numbers is self._refused:
                recording.dispatch_counted(kernel, bindings, self._refusals)
            else:
                recording.dispatch(kernel, bindings, threads=(count,))

    @property
    def triangles(self) -> npt.NDArray[np.uint32]:
        """Those that are matte and plain."""
        return self._plain.triangles

    def refused(self) -> npt.NDArray[np.uint32]:
        """Numbers + 1 of those that turned out to have no affine light."""
        count = int(self._refusals.read(np.uint32, (4,))[3])
        return self._refused.read(np.uint32, (count,))

    def read(self) -> Array:
        """(T, 3): radiance at the corners by what was found; of those `triangles` alone."""
        view = self.tables.setup.view
        words = self._glances.read()[: view.count]
        value, slope = words.view(np.float32)[:, :1].astype(np.float64), words.view(np.float32)
        anchor = np.stack([words[:, 3] << np.uint32(16), words[:, 3]], axis=1).view(np.int32) >> 16
        d = view.ideal - anchor[:, None]
        result: Array = value + np.einsum("tck,tk->tc", d, slope[:, 1:3].astype(np.float64))
        return result

    def _find(
        self, recording: Recording, params: dict[str, Any], constants: dict[str, float]
    ) -> None:
        """Find the triangles' functions, and which of them have none."""
        kernel = self.tables.device.kernel("optics/glance", constants=constants)
        records = self._records
        surface = {
            name: value
            for name, value in self.tables.surface().items()
            if name in kernel.layout.bindings
        }
        bindings = kernel.bind(
            params=params, order=self._order, corners=self.sight.drawn.corners,
            vertices=records.vertices, looks=records.looks, glances=self._glances,
            refused=self._refused, refusals=self._refusals, **surface,
        )  # fmt: skip
        recording.dispatch(kernel, bindings, threads=(len(self._plain.triangles),))


def glances(setup: Setup, sight: Sight | None) -> bool:
    """Whether most triangles of a view may be matte and plain, without shadows on them."""
    lighting, count = setup.lighting, setup.view.count
    if sight is None or sight.nearest is None:
        return False
    if lighting.shadows is not None or lighting.openness is not None:
        return False
    plain = np.count_nonzero((setup.groups == 0) & ~setup.shiny)
    return bool(plain >= LEAST_SHARE * count)


def glanced(program: Program) -> bool:
    """Whether the triangles of a program are matte and plain."""
    traits = ("patterned", "glossy", "bumpy", "board", "light_tiled")
    return not any(program.constants[name] for name in traits)


def glance_twin(setup: Setup, triangles: npt.NDArray[np.int64]) -> tuple[Array, Array]:
    """Radiance (n, 3) at the corners of matte plain triangles, and by how much of it (n,) it is off
    from affine at the middles of their sides."""
    at = setup.view.ideal[triangles]
    n = len(triangles)
    places = np.concatenate([at, 0.5 * (np.roll(at, -1, 1) + np.roll(at, -2, 1))], axis=1)
    image = setup.view.camera.distort(places.reshape(-1, 2), beyond=True)
    each = np.repeat(triangles, 6)
    x, y = image.T
    light = radiance_of(setup, each, x, y, np.ones(6 * n), np.zeros(6 * n)).reshape(n, 6)
    corner, middle = light[:, :3], light[:, 3:]
    off = np.abs(middle - 0.5 * (np.roll(corner, -1, 1) + np.roll(corner, -2, 1)))
    share = off.max(axis=1) / np.maximum(corner.max(axis=1), 1e-300)
    return corner * setup.albedo[triangles].astype(np.float64)[:, None], share


@twin_check("optics/glance")
def _check(device: Device) -> None:
    from gpusim.optics.shade import ShadePass, Tables, shade_twin

    if not device.atomics64:
        return  # pixels read records: optics/shade
    setup = probe_setup()
    view, camera = setup.view, setup.view.camera
    sight = Sight(device, view, camera.height)
    shading = ShadePass(Tables(device, setup, sight), camera.height, True, sight)
    out = device.empty(4 * shading.stride * camera.height, "glance.check")
    with device.recording("optics.glance") as recording:
        shading.record(recording, out, 0, camera.height)
    work = shading.glance
    assert work is not None
    triangles = work.triangles.astype(np.int64)
    want, off = glance_twin(setup, triangles)
    affine = ~np.isin(triangles + 1, work.refused())
    wrong = affine != (off <= TOLERANCE)
    # float32 may see those at the limit either way
    wrong &= np.abs(off - TOLERANCE) > 0.05 * TOLERANCE
    if wrong.any() or affine.all() or not affine.any():
        raise TwinMismatch(f"optics/glance: {int(wrong.sum())} triangles of another kind")
    compare("optics/glance", work.read()[triangles[affine]], want[affine], "pixel")
    radiance = out.read(np.float32, (camera.height, shading.stride))[:, : camera.width]
    compare(
        "optics/glance", radiance, shade_twin(setup, sight_twin(view, 0, camera.height)), "pixel"
    )


def probe_setup() -> Setup:
    """A bent picture of a plain sheet behind a checkered one, so crumpled that light isn't affine
    on some triangles."""
    sheets = [sheet(0.95, 1.3, 0.0, Plain(0.6)), sheet(0.3, 0.4, 0.4, Checker(0.31), 3.6)]
    K = np.array([[111.0, 0.3, 28.7], [0.0, 110.0, 20.2], [0.0, 0.0, 1.0]])
    camera = Camera(59, 39, K, distortion=[-0.1, 0.03, 1e-3, -2e-3])
    lights: list[Light] = [
        PointLight((-60.0, -50.0, -90.0), 2e4, shadows=False),
        PointLight((40.0, -70.0, -80.0), 3e4, shadows=False),
        AmbientLight(0.3),
    ]
    return Setup.build(look(sheets, camera, lit=True), lights, 0.25)
