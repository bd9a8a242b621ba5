"""Shadows: the pixels of tiles in which a lamp is half hidden, shaded again.

`gpusim.optics.shade` lights every pixel by the lamps that its tile sees at all; here the tiles
that see some of them in part (`gpusim.optics.shadow_tiles`) get each lamp's exact visible share
(`gpusim.optics.occlusion`). Views without shadows have neither the tables nor this pass.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from gpusim.gpu import Buffer, Device, Recording, Texture, compare, twin_check
from gpusim.optics.binning import bin_edges
from gpusim.optics.setup import Setup, probe_setup, radiance_factor
from gpusim.optics.shade import ShadePass, Tables, shade_twin
from gpusim.optics.shadow_tiles import TILE
from gpusim.optics.visibility import visibility_twin

__all__ = ["ShadowPass"]

LOOP_TURNS = 50_000
"""Turns that all loops of one shader invocation may take together (see `gpusim.optics.pattern`)."""

TURNS = 18
"""Turns that one face may cost."""


class ShadowPass:
    """The tiles of one view in half shadow, on the device."""

    def __init__(self, tables: Tables) -> None:
        tiles = tables.setup.lighting.shadows
        assert tiles is not None
        self.tables, self.place = tables, tiles.place
        self.dense = TURNS * tiles.count.sum(axis=1) > LOOP_TURNS
        places = tiles.place if len(tiles.place) else np.zeros((1, 2), np.int64)
        self._places = tables.device.buffer(places.astype(np.uint32), "shadow.places")

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
        first, last = np.searchsorted(
            self.place[:, 0], [row0 // TILE, (row0 + rows - 1) // TILE + 1]
        )
        if first == last:
            return
        setup = self.tables.setup
        kernel = self.tables.device.kernel(
            "optics/shadow", constants=setup.lighting.constants()
        )
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
            triangles=self.tables.triangles,
            marks=marks,
            places=self._places,
            lamps=self.tables.lamps,
            **self.tables.shadows.bindings(),
        )
        across = min(int(last - first), 32768)
        recording.dispatch(kernel, bindings, groups=(across, -(-int(last - first) // across)))

    def write_dense(
        self, ids: npt.NDArray[np.uint32], radiance: Buffer, row0: int, rows: int, stride: int
    ) -> None:
        """The host's values."""
        raise NotImplementedError
