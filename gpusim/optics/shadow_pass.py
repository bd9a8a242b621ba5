"""Shadows: the pixels of tiles in which a lamp is hidden, or half, shaded again.

Here the tiles that see some lamps in part (`gpusim.optics.shadow_tiles`) get each lamp's exact
visible share (`gpusim.optics.occlusion`). `gpusim.optics.shade` lights all pixels by the lamps that
their tile sees at all, or, where the device has begun before that is known, by all lamps; what
sees none of one is then shaded again as well. Views without shadows have neither the tables nor
this pass.
"""

from __future__ import annotations

from itertools import product

import numpy as np
import numpy.typing as npt

from gpusim.errors import InputError
from gpusim.gpu import Buffer, Device, Recording, Texture, compare, twin_check
from gpusim.optics.binning import bin_edges
from gpusim.optics.pattern import LOOP_TURNS
from gpusim.optics.setup import Setup
from gpusim.optics.shade import ShadePass, shade_twin
from gpusim.optics.shadow_probe import probe_outlines, probe_shadows
from gpusim.optics.shadow_tiles import TILE, ShadowTiles
from gpusim.optics.tables import Tables
from gpusim.optics.under import under
from gpusim.optics.visibility import visibility_twin

__all__ = ["ShadowPass"]


class ShadowPass:
    """The tiles of one view in half shadow, on the device."""

    def __init__(self, tables: Tables, dark: bool = False) -> None:
        """``dark``: whether tiles that a lamp is hidden from were shaded as if it wasn't."""
        tiles = tables.setup.lighting.shadows
        assert isinstance(tiles, ShadowTiles)
        self.tables, self.dark = tables, dark
        most = int(tiles.edge_counts.max(initial=0))
        if not most <= LOOP_TURNS:
            raise InputError(
                f"render shadows; got {most} edges that may hide lamps from one tile of pixels; "
                f"expected at most {LOOP_TURNS}: take smaller or fewer lamps, a coarser "
                "mesh, shadows = False, or backend 'numpy'"
            )
        # a program each for tiles with and without gloss, as the wall behind steel is most of them,
        # and for those in full shadow
        place = np.argwhere((tiles.entry > 0) | (tiles.dark if dark else False))
        glossy_tiles = under(tables.setup.view, np.flatnonzero(tables.setup.shiny), TILE)
        shiny = glossy_tiles[place[:, 0], place[:, 1]]
        half = tiles.entry[place[:, 0], place[:, 1]] > 0
        self._parts: list[tuple[bool, bool, npt.NDArray[np.int64], Buffer]] = []
        for glossy, whole in product((True, False), (False, True)):
            own = place[(shiny == glossy) & (half != whole)]
            if len(own):
                buffer = tables.device.buffer(own.astype(np.uint32), "shadow.places")
                self._parts.append((glossy, whole, own[:, 0], buffer))

    def record(
        self,
        recording: Recording,
        marks: Texture,
        radiance: Buffer,
        row0: int,
        rows: int,
        stride: int,
    ) -> None:
        """Shade the half shadows of a band of rows again, in place."""
        for glossy, whole, tile_row, places in self._parts:
            first, last = np.searchsorted(tile_row, [row0 // TILE, (row0 + rows - 1) // TILE + 1])
            if first == last:
                continue
            setup = self.tables.setup
            constants = setup.light_constants(glossy, bool(setup.bumpy.any()))
            constants["scaled"] = 0.0 if setup.shiny.any() else 1.0 if self.dark else 2.0
            constants["whole"] = float(whole)
            kernel = self.tables.device.kernel("optics/shadow_pass", constants=constants)
            bindings = kernel.bind(
                params={
                    "rays": self.tables.rays(),
                    "width": setup.view.camera.width,
                    "stride": stride,
                    "row0": row0,
                    "rows": rows,
                    "first": first,
                    "count": last - first,
                },
                radiance=radiance,
                marks=marks,
                places=places,
                **self.tables.surface(),
                **self.tables.shadows.bindings(),
            )
            across = min(int(last - first), 32768)
            recording.dispatch(kernel, bindings, groups=(across, -(-int(last - first) // across)))


@twin_check("optics/shadow_pass")
def _check(device: Device) -> None:
    for matte in (False, True):
        for early in (False, True):
            _compare(device, probe_shadows(matte), early)
    _compare(device, probe_outlines(), False)


def _compare(device: Device, setup: Setup, early: bool) -> None:
    """Against the twin; ``early``: shaded before shadows are known."""
    camera = setup.view.camera
    tables = Tables(device, setup)
    before = tables.with_shadows(None) if early else tables
    shading, shadows = ShadePass(before, camera.height, marked=True), ShadowPass(tables, early)
    assert shading.marks is not None
    out = device.empty(4 * shading.stride * camera.height, "shadow.out")
    with device.recording("optics.shadow_pass") as recording:
        shading.record(recording, out, 0, camera.height)
        shadows.record(recording, shading.marks, out, 0, camera.height, shading.stride)
    got = out.read(np.float32, (camera.height, shading.stride))[:, : camera.width]
    want = shade_twin(setup, visibility_twin(setup.view))
    tiles = setup.lighting.shadows
    assert isinstance(tiles, ShadowTiles)
    half = np.kron((tiles.entry > 0) | tiles.dark, np.ones((TILE, TILE), bool))
    inside = half[: camera.height, : camera.width].reshape(-1)
    inside[bin_edges(setup.view).pixel] = False
    # one sample of 512 may fall to the other side of an outline
    atol = 2.5 / 512 * float(want.max())
    compare(
        "optics/shadow_pass", got.reshape(-1)[inside], want.reshape(-1)[inside], "pixel", atol=atol
    )
