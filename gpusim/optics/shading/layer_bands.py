"""Bands of a view that is one layer: triangles write into them what pixels see, band by band."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from gpusim.gpu import Buffer, Recording
from gpusim.optics.raster.compute_raster import Sight
from gpusim.optics.shading.looks import NONE

if TYPE_CHECKING:
    from gpusim.optics.shading.scene_buffers import Tables

__all__ = ["LayerBands"]


class LayerBands:
    """What passes over a layer have in common (`gpusim.optics.shading.glance`)."""

    marked = True

    tables: Tables
    sight: Sight
    _found: bool
    _begun: int | None = None

    def begin(self, radiance: Buffer, row0: int, rows: int) -> None:
        """Let the device begin with a band, which `record` then finds there."""
        with self.tables.device.recording("optics.glance") as recording:
            self._write(recording, radiance, row0, rows)
        self._begun = row0

    def _complete(self, recording: Recording, params: dict[str, Any], radiance: Buffer) -> None:
        """Write a band unless the device has begun with it."""
        if self._begun != params["row0"]:
            self._write(recording, radiance, int(params["row0"]), int(params["rows"]))
        self._begun = None

    def _write(self, recording: Recording, radiance: Buffer, row0: int, rows: int) -> None:
        """Let triangles write their pixels of a band, and make records of those that need one."""
        raise NotImplementedError

    def _prepare(
        self,
        recording: Recording,
        radiance: Buffer,
        lists: Sequence[tuple[Buffer, Buffer]],
        constants: dict[str, float],
        params: dict[str, Any],
    ) -> None:
        """Find what isn't known of the vertices yet, or empty the ``lists`` of numbers, which are
        those of a band, and their groups; set the pixels to the background."""
        device = self.tables.device
        if not self._found:
            self.sight.prepare(recording)
        else:
            none = device.buffer(NONE, "layer.none")
            for numbers, groups in lists:
                recording.clear(numbers)
                recording.copy(none, groups, groups.nbytes)
        if params["background"] == 0.0:
            recording.clear(radiance)
        else:
            blank = device.kernel("optics/shading/glance", "blank", constants)
            bindings = blank.bind(params=params, band_radiance=radiance)
            recording.dispatch(blank, bindings, threads=(radiance.nbytes // 4,))
