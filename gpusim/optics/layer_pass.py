"""The pixels of a view that is one layer: its triangles write them as soon as they are lit.

No triangle lies over another (`gpusim.optics.layer`), so that none has to be found to be the
nearest one first: an invocation finds a triangle's light as a function of the pixel, walks over
its box and writes the pixels inside. Those that are shaded one by one, on lines of boards or where
light isn't even, get the triangle's mark, by which it finds them afterwards.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from gpusim.gpu import Buffer, Recording
from gpusim.optics.glance import GlancePass
from gpusim.optics.layer import STEPS
from gpusim.optics.looks import NONE
from gpusim.optics.sight import Sight

if TYPE_CHECKING:
    from gpusim.optics.tables import Tables

__all__ = ["LayerPass"]


class LayerPass(GlancePass):
    """`GlancePass` of a view that is one layer, of which `gpusim.optics.looks` tells."""

    marked = True

    def __init__(self, tables: Tables, sight: Sight) -> None:
        super().__init__(tables, [], sight)
        device = tables.device
        self._none = device.buffer(NONE, "layer.none")
        self._begun: int | None = None

    def begin(self, radiance: Buffer, row0: int, rows: int) -> None:
        """Let the device begin with a band, which `record` then finds there."""
        with self.tables.device.recording("optics.glance") as recording:
            self._write(recording, radiance, row0, rows)
        self._begun = row0

    def _band(
        self,
        recording: Recording,
        params: dict[str, Any],
        shared: dict[str, Any],
        radiance: Buffer,
    ) -> None:
        if self._begun != params["row0"]:
            self._write(recording, radiance, int(params["row0"]), int(params["rows"]))
        self._begun = None

    def _write(self, recording: Recording, radiance: Buffer, row0: int, rows: int) -> None:
        """Let triangles write their pixels of a band, and make records of those that need one."""
        device, kind, view = self.tables.device, self._kinds[0], self.tables.setup.view
        camera = view.camera
        assert kind.looks is not None
        if not self._found:
            self.sight.prepare(recording)
        else:
            # lists are those of a band
            for numbers, groups in ((kind.order, kind.looks.groups), (kind.refused, kind.refusals)):
                recording.clear(numbers)
                recording.copy(self._none, groups, groups.nbytes)
        params = {
            **self._params, **kind.looks.params, "count": kind.count, "row0": row0, "rows": rows,
            "width": camera.width, "stride": self.stride, "looking": not self._found,
            "tall": camera.height, "longest": int(np.ceil(STEPS * view.extent)) + 1,
            "late": self.sight.late,
        }  # fmt: skip
        if params["background"] == 0.0:
            recording.clear(radiance)
        else:
            blank = device.kernel("optics/glance", "blank", self._constants)
            bindings = blank.bind(params=params, band_radiance=radiance)
            recording.dispatch(blank, bindings, threads=(radiance.nbytes // 4,))
        self._dispatch(
            recording, kind, "layered", self._constants, params, band_radiance=radiance
        )  # fmt: skip
        self._make(recording, kind)
        self._found = True
