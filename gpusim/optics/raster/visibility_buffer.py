"""The triangle that each pixel's centre sees, a band of rows at a time.

The rasteriser finds it, or, where triangles are small, a compute program
(`gpusim.optics.raster.compute_raster`).
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
import numpy.typing as npt

from gpusim.gpu import Buffer, Device, Recording, Texture
from gpusim.gpu.texture_array import Texels
from gpusim.optics.geometry.triangle_corners import CHUNK
from gpusim.optics.geometry.view import View
from gpusim.optics.raster.vertex_buffers import VertexBuffers

__all__ = ["MAX_BOX", "NONE", "VisibilityBuffer", "compute_raster_suits"]

MAX_BOX = 64.0
"""px; triangles in a larger box are left to the rasteriser: their areas don't fit into 32 bits, and
invocations beside them wait for them."""

NONE = np.zeros(1, np.uint32)
"""Of lists of triangles or tiles: the device takes no empty buffers."""


def compute_raster_suits(device: Device, view: View) -> bool:
    """Whether the compute program can find what pixels of a view see."""
    return device.atomics64 and view.extent <= MAX_BOX


class VisibilityBuffer:
    """The triangle that each pixel of a band sees.

    It takes no more than where triangles are, so that the device finds it while the host still
    works on what they look like. ``nearest``: depth and triangle of each pixel as the shader says,
    or None where a rasteriser looks; ``ids``: numbers + 1, 0 is background; ``depth``: what a
    rasteriser leaves, or None.
    """

    def __init__(self, device: Device, view: View, rows: int, compute: bool | None = None) -> None:
        """Of bands of ``rows``; ``compute``: by the compute program, None where it suits."""
        self.device, self.view, self.rows = device, view, rows
        width = view.camera.width
        self.vertex_buffers = VertexBuffers(device, view, "shade")
        self.ids = device.target(width, rows, "r32uint", "shade.ids")
        self.depth: Texture | None = None
        self._begun: tuple[int, int] | None = None
        self.nearest: Buffer | None = None
        if compute_raster_suits(device, view) if compute is None else compute:
            self.nearest = device.pool.take(8 * width * rows, "visibility.nearest")
        else:
            self.depth = device.target(width, rows, "depth32float", "shade.depth")

    @cached_property
    def places(self) -> Texels:
        """Vertices as the shader reads them."""
        return _places(self.vertex_buffers)

    def begin(self, row0: int, rows: int) -> None:
        """Let the device look at a band, which `record` then finds there."""
        with self.device.recording("optics.visibility") as recording:
            self._look(recording, row0, rows)
        self._begun = row0, rows

    def record(self, recording: Recording, row0: int, rows: int) -> None:
        """Look at a band, unless that has begun already."""
        begun, self._begun = self._begun, None
        if begun != (row0, rows):
            self._look(recording, row0, rows)

    def release(self) -> None:
        """Leave its memory to the next one; ``ids`` stay."""
        if self.nearest is not None:
            self.device.pool.give(self.nearest)

    def read(self) -> npt.NDArray[np.uint32]:
        """Ids of the whole image, (H, W) uint32."""
        camera = self.view.camera
        band = self.rows
        kernel = self.device.kernel("optics/raster/id_buffer", "read_ids")
        out = self.device.empty(4 * camera.width * band, "visibility.read")
        result = np.empty((camera.height, camera.width), np.uint32)
        for row0 in range(0, camera.height, band):
            rows = min(band, camera.height - row0)
            with self.device.recording("optics.visibility") as recording:
                self.record(recording, row0, rows)
                self.number(recording, row0, rows)
                size = {"width": camera.width, "rows": rows}
                bindings = kernel.bind(copy=size, ids=self.ids, result=out)
                recording.dispatch(kernel, bindings, threads=(camera.width, rows))
            result[row0 : row0 + rows] = out.read(np.uint32, (rows, camera.width))
        return result

    def _look(self, recording: Recording, row0: int, rows: int) -> None:
        if self.nearest is None:
            self._draw(recording, row0, rows)
            return
        count, width = self.view.count, self.view.camera.width
        place = {"count": count, "width": width, "rows": rows, "row0": row0}
        kernel = self.device.kernel("optics/raster/compute_raster")
        bindings = kernel.bind(
            params=place,
            corners=self.vertex_buffers.corners,
            places=self.places,
            nearest=self.nearest,
        )
        recording.clear(self.nearest)
        recording.dispatch(kernel, bindings, threads=(count,))

    def number(self, recording: Recording, row0: int, rows: int) -> None:
        """Bring ``ids`` of a band up to date, which `record` has looked at."""
        if self.nearest is None:
            return
        size = (self.view.camera.width, rows)
        place = {"count": self.view.count, "width": size[0], "rows": rows, "row0": row0}
        raster = self.device.raster("optics/raster/compute_raster", ("r32uint",), depth="none")
        bindings = raster.bind(params=place, found=self.nearest)
        recording.draw(raster, bindings, colors=(self.ids,), depth=None, vertices=3, size=size)

    def _draw(self, recording: Recording, row0: int, rows: int) -> None:
        width, count = self.view.camera.width, self.view.count
        values = {
            "params": {"width": width, "rows": rows, "row0": row0, "near": self.vertex_buffers.near}
        }
        entry, some = "vertex", {}
        if rows < self.view.camera.height and count:
            # software rasterisers take as long for what lies in other bands
            low, high = (ends[:, 1] for ends in self.view.box)
            own = np.flatnonzero((high >= row0 - 1.0) & (low <= row0 + rows)).astype(np.uint32)
            entry, count = "vertex_some", len(own)
            some = {"order": self.device.buffer(own if count else NONE, "visibility.order")}
        raster = self.device.raster(
            "optics/raster/id_buffer", ("r32uint",), entries=(entry, "fragment")
        )
        bindings = raster.bind(**values, **some, **self.vertex_buffers.bindings())
        recording.draw(
            raster, bindings, colors=(self.ids,), depth=self.depth, vertices=3 * count,
            size=(width, rows),
        )  # fmt: skip


def _places(vertex_buffers: VertexBuffers) -> Texels:
    """Vertices as the shader reads them, block by block while they are in the cache."""
    count = len(vertex_buffers.fixed)
    texels = vertex_buffers.device.pool.texels(count, "rgba32uint", "visibility.places")
    block = np.zeros((CHUNK, 4), np.uint32)
    for first in range(0, count, CHUNK):
        part = slice(first, min(first + CHUNK, count))
        words = block[: part.stop - first]
        words.view(np.int32)[:, :2] = vertex_buffers.fixed[part]
        np.multiply(
            vertex_buffers.inverse[part],
            np.float32(vertex_buffers.near),
            out=words.view(np.float32)[:, 2],
        )
        texels.write(words, first)
    return texels
