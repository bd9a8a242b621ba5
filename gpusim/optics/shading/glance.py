"""Light on small matte triangles: a function of the pixel each, of first or of second degree.

On a triangle of a few pixels the light changes so evenly that what falls on its corners tells all
between; on one of some hundreds what falls on the middles of its sides does, too. A pixel then
reads four numbers, or eight, in place of a record of 28, and no lamp. Where the light elsewhere on
a triangle (at the middles, or at quarters of its sides and in its middle) is off by more than
`TOLERANCE` of it, and on all other paint, an invocation per triangle shades the triangle's own
pixels one by one, whose record it reads once. On chessboards it takes light from the function and
looks at those pixels more closely that a line passes through.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from gpusim.arrays.sorted_unique import distinct
from gpusim.errors import TwinMismatch
from gpusim.gpu import Buffer, Device, Recording, Texture, compare, twin_check
from gpusim.optics.geometry.view import View
from gpusim.optics.light.lights import Light
from gpusim.optics.paint.checker_lines import on_boards
from gpusim.optics.probes.paints import sheets_setup
from gpusim.optics.raster.compute_raster import LARGEST, Sight, sight_twin
from gpusim.optics.shading.deferred_pass import FEWEST, SMALL
from gpusim.optics.shading.glance_kind import SLENDER, GlanceKind, glance_params
from gpusim.optics.shading.lighting import casts_shadows
from gpusim.optics.shading.looks import check_looks, looks_twin
from gpusim.optics.shading.setup import Setup, radiance_of
from gpusim.surface.paint import Checker, Plain

if TYPE_CHECKING:
    from gpusim.optics.shading.forward_pass import Program
    from gpusim.optics.shading.scene_buffers import Tables

__all__ = ["TOLERANCE", "GlancePass", "fields_glanced", "glance_twin", "may_glance"]

Array = npt.NDArray[np.float64]

TOLERANCE = 1e-5
"""Of the light on a triangle, that its function may be off by where that is tested."""

LEAST_SHARE = 0.5
"""Of the triangles that may have such a function; with fewer it isn't worth it."""

PIXELS = 4
"""Shaded by an invocation, as the shader says."""


class GlancePass:
    """The pixels of a view without shadows whose triangles are known.

    ``stride``: pixels from one row of a band's buffer to the next.
    """

    marked = False
    """Whether triangles leave marks on their own pixels that are shaded one by one."""

    tables: Tables
    sight: Sight
    _found: bool

    def __init__(self, tables: Tables, programs: list[Program], sight: Sight) -> None:
        device, view = tables.device, tables.setup.view
        assert tables.records is not None
        # whole rows of `color`, as textures are copied
        self.stride = -(-view.camera.width // 64) * 64
        self.tables, self.sight, self._records = tables, sight, tables.records
        self.quadratic = view.mean_pixels > SMALL
        self._own: list[tuple[dict[str, float], Buffer]] = []
        self._kinds: list[GlanceKind] = []
        if tables.looks is not None:
            self._kinds.append(GlanceKind.of(device, tables.looks.constants, tables.looks))
        for program in programs:
            if len(program.triangles):
                numbers = device.buffer(program.triangles + np.uint32(1), "glance.numbers")
                if glanced(program):
                    self._kinds.append(GlanceKind.of(device, program.constants, numbers))
                else:
                    self._own.append((program.constants, numbers))
        texels = (1 + self.quadratic) * max(view.count, 1)
        self._glances = device.pool.texels(texels, "rgba32uint", "glance.glances")
        self._found = False
        setup = tables.setup
        self._degree = {"quadratic": float(self.quadratic), "spacing": 3.0 if self.marked else 1.0}
        self._constants = {
            "lit": float(setup.lit), **self._degree, **setup.light_constants(False, False)
        }  # fmt: skip
        self._params = glance_params(tables, TOLERANCE)

    @cached_property
    def color(self) -> Texture:
        """What a band is drawn into, four pixels of a row in a texel; copied into a buffer, its
        bytes are those of single pixels."""
        columns = -(-self.tables.setup.view.camera.width // PIXELS)
        device = self.tables.device
        return device.target(columns, self.sight.rows, "rgba32float", "glance.radiance")

    def begin(self, radiance: Buffer, row0: int, rows: int) -> None:
        """Let the device find the triangles' functions, which `record` does otherwise."""
        with self.tables.device.recording("optics.glance") as recording:
            self._find_all(recording)

    def record(
        self,
        recording: Recording,
        params: dict[str, Any],
        shared: dict[str, Any],
        radiance: Buffer,
    ) -> None:
        """Shade a band into ``radiance``."""
        self._band(recording, params, shared, radiance)
        sight, known = self.sight, self._records.vertices  # no lens bends a layer
        values = {
            **shared, "params": params, "band_nearest": sight.nearest, "band_radiance": radiance,
            "corners": sight.drawn.corners, "seen": self._glances,
            "places": known if self.marked else sight.places,
        }  # fmt: skip
        for kind in self._kinds:
            if kind.bare:
                own = kind.constants
                self._shade(recording, "own_fields", own, kind.order, values, kind.groups)
            self._shade(
                recording, "own_pixels", kind.constants, kind.refused, values, kind.refusals
            )
        for constants, numbers in self._own:
            self._shade(recording, "own_pixels", constants, numbers, values)

    def _band(
        self,
        recording: Recording,
        params: dict[str, Any],
        shared: dict[str, Any],
        radiance: Buffer,
    ) -> None:
        """Shade the pixels of a band whose triangles' light is known."""
        device, sight = self.tables.device, self.sight
        assert sight.nearest is not None
        size = int(params["width"]), int(params["rows"])
        sight.record(recording, int(params["row0"]), size[1])
        if not self._found:
            self._find_all(recording)
        raster = device.raster(
            "optics/shading/glance", (self.color.format,), constants=self._constants, depth="none"
        )
        bent = {name: shared[name] for name in ("tiles", "undistortion")}
        bindings = raster.bind(
            params={**self._params, "width": size[0], "row0": params["row0"]},
            nearest=sight.nearest, seen=self._glances, **bent,
        )  # fmt: skip
        # every pixel is drawn: setting them all before costs an eighth of that
        recording.draw(
            raster, bindings, colors=(self.color,), depth=None, vertices=3,
            size=(self.color.width, size[1]), clear=None,
        )  # fmt: skip
        recording.copy_texture(self.color, radiance, size[1])

    def _shade(
        self,
        recording: Recording,
        entry: str,
        constants: dict[str, float],
        numbers: Buffer,
        values: dict[str, Any],
        groups: Buffer | None = None,
    ) -> None:
        """Shade the own pixels of triangles ``numbers`` - 1; ``groups``: of 64 that are to be
        looked at, as the device counted them."""
        constants = {**constants, **self._degree, "signed": float(self.marked)}
        kernel = self.tables.device.kernel("optics/shading/forward_pass", entry, constants)
        count = numbers.nbytes // 4
        values = {
            **values, "order": numbers, "band": {"count": count, "stride": self.stride}
        }  # fmt: skip
        bindings = kernel.bind_used(**values)
        if groups is None:
            recording.dispatch(kernel, bindings, threads=(count,))
        else:
            recording.dispatch_counted(kernel, bindings, groups)

    @property
    def triangles(self) -> npt.NDArray[np.uint32]:
        """Those whose light was looked at."""
        own = [
            kind.numbers() if kind.looks is None else np.arange(kind.count, dtype=np.uint32)
            for kind in self._kinds
        ]
        return np.concatenate([np.zeros(0, np.uint32), *own])

    @property
    def bare(self) -> npt.NDArray[np.uint32]:
        """Those of `triangles` whose light was found without their albedo."""
        own = [kind.numbers() for kind in self._kinds if kind.bare]
        return np.concatenate([np.zeros(0, np.uint32), *own])

    def refused(self) -> npt.NDArray[np.uint32]:
        """Numbers + 1 of those whose light turned out to be no such function."""
        found = [np.zeros(0, np.uint32)]
        for kind in self._kinds:
            count = int(kind.refusals.read(np.uint32, (4,))[3])
            found.append(kind.refused.read(np.uint32, (count,)))
        return np.concatenate(found)

    def read(self) -> Array:
        """(T, 3): radiance at the corners by what was found; of those `triangles` alone."""
        view = self.tables.setup.view
        words = self._glances.read()[: (1 + self.quadratic) * view.count]
        words = words.reshape(view.count, -1)
        real = words.view(np.float32).astype(np.float64)
        anchor = np.stack([words[:, 3] << np.uint32(16), words[:, 3]], axis=1).view(np.int32) >> 16
        x, y = np.moveaxis(view.ideal - anchor[:, None], 2, 0)
        result: Array = real[:, :1] + real[:, 1:2] * x + real[:, 2:3] * y
        if self.quadratic:
            result += real[:, 4:5] * x * x + real[:, 5:6] * x * y + real[:, 6:7] * y * y
        return result

    def _find_all(self, recording: Recording) -> None:
        """Find the functions, and make the records of triangles that need them."""
        for kind in self._kinds:
            self._find(recording, kind)
            self._make(recording, kind)
        for _, numbers in self._own:
            self._records.make(recording, numbers)
        self._found = True

    def _make(self, recording: Recording, kind: GlanceKind) -> None:
        """Make records of those that are shaded pixel by pixel."""
        if kind.bare:
            self._records.make(recording, kind.order, kind.groups)
        if kind.looks is not None or not kind.bare:
            self._records.make(recording, kind.refused, kind.refusals)

    def _find(self, recording: Recording, kind: GlanceKind) -> None:
        """Find the triangles' functions, and which of them have none."""
        constants = {**self._constants, "bare": float(kind.bare)}
        own = {} if kind.looks is None else kind.looks.params
        params = {**self._params, "count": kind.count, **own}
        entry = "main" if kind.looks is None else "looked"
        self._dispatch(recording, kind, entry, constants, params)

    def _dispatch(
        self,
        recording: Recording,
        kind: GlanceKind,
        entry: str,
        constants: dict[str, float],
        params: dict[str, Any],
        **more: Any,
    ) -> None:
        """Run an entry of the shader for a kind's triangles, with what it reads and writes of them
        and ``more``, by WGSL names."""
        kernel = self.tables.device.kernel("optics/shading/glance", entry, constants)
        values = {
            "order": kind.order, "corners": self.sight.drawn.corners,
            "vertices": self._records.vertices, "looks": self._records.looks,
            "glances": self._glances, "refused": kind.refused, "refusals": kind.refusals,
            **self.tables.surface(), **({} if kind.looks is None else kind.looks.bindings()),
            **more,
        }  # fmt: skip
        bindings = kernel.bind_used(params=params, **values)
        recording.dispatch(kernel, bindings, threads=(kind.count,))


def may_glance(view: View, lights: Sequence[Light] | None) -> bool:
    """Whether `fields_glanced` is likely to find triangles in a view, as far as its paints and
    lights tell."""
    # without lights the rasteriser is as fast
    if lights is None or view.count < FEWEST or view.extent > LARGEST or casts_shadows(lights):
        return False
    if any(getattr(light, "occlusion", False) for light in lights):
        return False
    # all of the image is passed over, unless triangles write their own pixels
    image = view.camera.width * view.camera.height
    if not view.layer and view.mean_pixels * view.count < LEAST_SHARE * image:
        return False
    return all(
        isinstance(region.paint, Plain | Checker)
        and region.paint.bump is None
        and region.paint.roughness == 1.0
        for region in view.regions
    )


def fields_glanced(setup: Setup, sight: Sight | None) -> npt.NDArray[np.bool_] | None:
    """(T,): which triangles of a view are large fields of boards that lines pass through; None
    where `gpusim.optics.shading.looks` finds them, and unless most triangles are those or plain,
    and matte, without shadows on them."""
    lighting, count = setup.lighting, setup.view.count
    if sight is None or sight.nearest is None or setup.view.guessed:
        return None
    if lighting.shadows is not None or lighting.openness is not None or setup.bumps is not None:
        return None
    fields = on_boards(setup) & ~setup.shiny
    some = np.count_nonzero((setup.groups == 0) & ~setup.shiny) + np.count_nonzero(fields)
    return fields if some >= LEAST_SHARE * count else None


def glanced(program: Program) -> bool:
    """Whether the triangles of a program are matte, and plain or fields of boards."""
    traits = program.constants
    plain = not traits["patterned"] or traits["board"]
    return bool(plain) and not any(traits[name] for name in ("glossy", "bumpy", "light_tiled"))


def glance_twin(
    setup: Setup, triangles: npt.NDArray[np.int64], quadratic: bool
) -> tuple[Array, Array]:
    """Light (n, 3) at the corners of matte triangles, and by how much of it (n,) it is off from a
    function of first or second degree where the shader looks; of slivers infinite."""
    at = setup.view.ideal[triangles]
    n, one, none = len(triangles), np.eye(3), np.zeros((3, 3))
    # barycentric coordinates of the places: corners, middles of the sides opposite to them
    middle = 0.5 * (np.roll(one, 1, 0) + np.roll(one, -1, 0))
    looked, by = [], np.concatenate([0.5 * (1.0 - one), none], axis=1)
    if quadratic:
        quarter = 0.75 * one + 0.25 * np.roll(one, 1, 1)
        looked = [quarter, np.full((1, 3), 1.0 / 3.0)]
        by = np.concatenate(
            [0.375 * one - 0.125 * np.roll(one, 1, 1), 0.75 * np.roll(one, -1, 1)], axis=1
        )
        by = np.concatenate([by, [[-1.0 / 9.0] * 3 + [4.0 / 9.0] * 3]])
    weights = np.concatenate([one, middle, *looked])
    each, many = np.repeat(triangles, len(weights)), n * len(weights)
    places = np.einsum("pk,tkc->tpc", weights, at).reshape(-1, 2)
    x, y = setup.view.camera.distort(places, beyond=True).T
    light = radiance_of(setup, each, x, y, np.ones(many), np.zeros(many)).reshape(n, -1)
    corner = light[:, :3]
    tested = light[:, 6:] if quadratic else light[:, 3:]
    off = np.abs(tested - light[:, :6] @ by.T)
    share = off.max(axis=1) / np.maximum(corner.max(axis=1), 1e-300)
    if quadratic:
        u, v = at[:, 1] - at[:, 0], at[:, 2] - at[:, 0]
        area = np.abs(u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0])
        share[np.sum(u * u + v * v, axis=1) > SLENDER * area] = np.inf
    return corner, share


@twin_check("optics/shading/glance")
def _check(device: Device) -> None:
    if not device.atomics64:
        return  # pixels read records: optics/shading/forward_pass
    _compare(device, sheets_setup(), False)
    _compare(device, sheets_setup(5.0), False)
    _compare(device, sheets_setup(10.0), True)
    ending = Checker(0.11, 4, 3, (-0.21, -0.17), 0.1, 0.7, 0.4)
    for scale in (5.0, 10.0):
        setup = sheets_setup(scale, ending)
        found = setup.view.paints, np.zeros(setup.view.count)
        guessed = replace(setup.view, found=found, guessed=True)
        _compare(device, replace(setup, view=guessed), scale > 5.0)
        setup = sheets_setup(scale, ending, layer=True)
        found = setup.view.paints, np.zeros(setup.view.count)
        guessed = replace(setup.view, found=found, guessed=True, layer=True)
        _compare(device, replace(setup, view=guessed), scale > 5.0)


def _compare(device: Device, setup: Setup, quadratic: bool) -> None:
    from gpusim.optics.shading.forward_pass import ShadePass, shade_twin
    from gpusim.optics.shading.scene_buffers import Tables

    view, camera = setup.view, setup.view.camera
    sight = Sight(device, view, camera.height)
    tables = Tables(device, setup, sight)
    shading = ShadePass(tables, camera.height, True, sight)
    out = device.empty(4 * shading.stride * camera.height, "glance.check")
    with device.recording("optics.glance") as recording:
        shading.record(recording, out, 0, camera.height)
    work = shading.glance
    assert isinstance(work, GlancePass) and work.quadratic == quadratic
    albedo = setup.albedo
    if tables.looks is not None:
        check_looks(setup, tables.looks)
        albedo = looks_twin(setup)[1]
    triangles, ids = work.triangles.astype(np.int64), sight_twin(view, 0, camera.height)
    if work.marked:
        # others aren't looked at
        triangles = distinct(ids[ids > 0]).astype(np.int64) - 1
    want, off = glance_twin(setup, triangles, quadratic)
    plain = ~np.isin(triangles, work.bare)
    want[plain] *= albedo[triangles[plain]].astype(np.float64)[:, None]
    even = ~np.isin(triangles + 1, work.refused())
    wrong = even != (off <= TOLERANCE)
    # float32 may see those at the limit either way
    wrong &= np.abs(off - TOLERANCE) > 0.05 * TOLERANCE
    alike = not work.marked and (even.all() or not even.any())
    if wrong.any() or alike:
        raise TwinMismatch(f"optics/shading/glance: {int(wrong.sum())} triangles of another kind")
    if not work.marked:
        compare("optics/shading/glance", work.read()[triangles[even]], want[even], "pixel")
    radiance = out.read(np.float32, (camera.height, shading.stride))[:, : camera.width]
    compare("optics/shading/glance", radiance, shade_twin(setup, ids), "pixel")
