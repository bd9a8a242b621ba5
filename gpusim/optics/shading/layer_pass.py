"""The pixels of a view that is one layer: its triangles write them as soon as they are lit.

No triangle lies over another (`gpusim.optics.geometry.single_layer`), so that none has to be found
to be the nearest one first: an invocation finds a triangle's light as a function of the pixel,
walks over its box and writes the pixels inside. Those that are shaded one by one, on lines of
boards or where light isn't even, get the triangle's mark, by which it finds them afterwards.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from gpusim.gpu import Buffer, Recording
from gpusim.optics.geometry.single_layer import STEPS
from gpusim.optics.raster.compute_raster import Sight
from gpusim.optics.shading.glance import GlancePass
from gpusim.optics.shading.layer_bands import LayerBands

if TYPE_CHECKING:
    from gpusim.optics.shading.scene_buffers import Tables

__all__ = ["LayerPass"]


class LayerPass(LayerBands, GlancePass):
    """`GlancePass` of a view that is one layer, of which `gpusim.optics.shading.looks` tells."""

    def __init__(self, tables: Tables, sight: Sight) -> None:
        super().__init__(tables, [], sight)

    def _band(
        self,
        recording: Recording,
        params: dict[str, Any],
        shared: dict[str, Any],
        radiance: Buffer,
    ) -> None:
        self._complete(recording, params, radiance)

    def _write(self, recording: Recording, radiance: Buffer, row0: int, rows: int) -> None:
        kind, view = self._kinds[0], self.tables.setup.view
        camera = view.camera
        assert kind.looks is not None
        params = {
            **self._params, **kind.looks.params, "count": kind.count, "row0": row0, "rows": rows,
            "width": camera.width, "stride": self.stride, "looking": not self._found,
            "tall": camera.height, "longest": int(np.ceil(STEPS * view.extent)) + 1,
            "late": self.sight.late,
        }  # fmt: skip
        lists = (kind.order, kind.looks.groups), (kind.refused, kind.refusals)
        self._prepare(recording, radiance, lists, self._constants, params)
        self._dispatch(
            recording, kind, "layered", self._constants, params, band_radiance=radiance
        )  # fmt: skip
        self._make(recording, kind)
        self._found = True
