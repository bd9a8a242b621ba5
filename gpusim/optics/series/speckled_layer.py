"""Speckle on a fine surface in a series, whose vertices the device looks at
(`gpusim.optics.series.late`).

It is one layer, so that triangles leave their marks on their pixels
(`gpusim.optics.shading.layer_pass`), which are then shaded all at once. The largest pixel is
guessed from some triangles, and that none turns so far away that the pattern bends at its edges
(`gpusim.optics.geometry.pattern_seams`). The device looks at all of them and tells where that was
wrong.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from gpusim.gpu import Buffer, Recording
from gpusim.optics.geometry.anisotropic_footprint import may_graze
from gpusim.optics.geometry.pattern_seams import STEEP
from gpusim.optics.geometry.single_layer import STEPS
from gpusim.optics.geometry.view import View
from gpusim.optics.light.lights import Light
from gpusim.optics.raster.compute_raster import Sight
from gpusim.optics.shading.layer_bands import LayerBands
from gpusim.optics.shading.looks import SAMPLED, SURE, footprints
from gpusim.optics.shading.speckled import LIT, SpeckledPass, may_be_speckled
from gpusim.surface.speckle import Speckle

if TYPE_CHECKING:
    from gpusim.optics.shading.scene_buffers import Tables

__all__ = ["SpeckledLayer", "likely_speckled"]

LARGER = 1.08
"""Largest pixel there may be over the largest that was found: more makes lists of discs longer."""

LEAST_COSINE = STEEP + 0.01
"""With what float32 may be off by."""


class SpeckledLayer(LayerBands, SpeckledPass):
    """`SpeckledPass` of a view that is one layer, of which the host knows some triangles."""

    def __init__(self, tables: Tables, sight: Sight) -> None:
        super().__init__(tables, sight)
        view = tables.setup.view
        paint = int(self._looked["last"])
        self._looked |= {
            "tall": view.camera.height, "longest": int(np.ceil(STEPS * view.extent)) + 1,
            "late": True, "stride": self.stride, "margin": SURE * view.paints[paint].reach,
            "steep": LEAST_COSINE, "ground": float(tables.setup.table.paints["ground"][paint]),
        }  # fmt: skip
        self._params["width"] = self.stride

    def record(
        self,
        recording: Recording,
        params: dict[str, Any],
        shared: dict[str, Any],
        radiance: Buffer,
    ) -> None:
        self._complete(recording, params, radiance)
        self._shade_own(recording, params, shared, radiance, self._records.vertices)
        self._draw(recording, "fragment_layer", params, shared, radiance, marks=radiance)

    def _write(self, recording: Recording, radiance: Buffer, row0: int, rows: int) -> None:
        params = {**self._looked, "row0": row0, "rows": rows, "looking": not self._found}
        lists = ((self.kind.refused, self.kind.refusals),)
        constants = {**LIT, **self.tables.setup.light_constants(False, False)}
        self._prepare(recording, radiance, lists, constants, params)
        self._dispatch(
            recording, "patterned_layer", params, band_radiance=radiance,
            counts=self.sight.counts,
        )  # fmt: skip
        self._found = True


def likely_speckled(view: View, lights: Sequence[Light] | None) -> View | None:
    """A view with the largest pixel guessed, whose vertices the device looks at; None where it
    isn't one of speckle, or pixels may be too large for usual tables."""
    if not may_be_speckled(view, lights):
        return None
    region = view.regions[0]
    some = np.arange(0, view.count, max(view.count // SAMPLED, 1))
    reach = LARGER * float(footprints(view, some).max())
    if not isinstance(region.paint, Speckle) or may_graze(region.paint, reach):
        return None
    seen = np.array([region.low, region.high])
    region = replace(region, reach=reach, seen=seen)
    return replace(view, found=((region,), np.zeros(view.count)), guessed=True)
