"""The triangle that each pixel sees, where triangles are small.

A rasteriser sets triangles up one after another (a software one in a single thread: 600,000 take
0.13 s of processor time). Triangles of a few pixels are drawn here by a compute program, one
invocation each, which takes a third of that. A pixel keeps the largest of 64-bit numbers: depth,
then the triangle's number, so that the result doesn't depend on the order of work. Places are
snapped to 1/256 px, as rasterisers do, and edges are whole numbers from there on: neighbours leave
no gaps. Devices without 64-bit atomics, and views with large triangles, take the rasteriser.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
import numpy.typing as npt

from gpusim.arrays.ragged import expand
from gpusim.gpu import Buffer, Device, Recording, Texture, compare, twin_check
from gpusim.gpu.texture_array import Texels
from gpusim.optics.camera.pinhole import Camera
from gpusim.optics.geometry.triangle_corners import CHUNK
from gpusim.optics.geometry.view import FIXED, View, look
from gpusim.optics.raster.vertex_buffers import VertexBuffers
from gpusim.surface.paint import Paint, Plain
from gpusim.surface.surface import Surface

__all__ = ["LARGEST", "NONE", "VisibilityBuffer", "compute_raster_suits", "compute_raster_twin"]

LARGEST = 64.0
"""px; triangles in a larger box are left to the rasteriser: their areas don't fit into 32 bits, and
invocations beside them wait for them."""

NONE = np.zeros(1, np.uint32)
"""Of lists of triangles or tiles: the device takes no empty buffers."""

STEPS = 256
"""Of a pixel, to which places are snapped."""


def compute_raster_suits(device: Device, view: View) -> bool:
    """Whether the compute program can find what pixels of a view see."""
    return device.atomics64 and view.extent <= LARGEST


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
            self.nearest = device.kept.take(8 * width * rows, "sight.nearest")
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
            self.device.kept.give(self.nearest)

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
            some = {"order": self.device.buffer(own if count else NONE, "sight.order")}
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
    texels = vertex_buffers.device.kept.texels(count, "rgba32uint", "sight.places")
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


def compute_raster_twin(view: View, row0: int, rows: int) -> npt.NDArray[np.uint32]:
    """Triangle number + 1 (0: none) per pixel of a band, (rows, W) uint32, box by box."""
    width, none = view.camera.width, np.zeros(0, np.int64)
    result = np.zeros((rows, width), np.uint32)
    fixed = np.rint(view.screen * FIXED).astype(np.int64)
    at = (fixed + FIXED // STEPS // 2) // (FIXED // STEPS)
    at[:, :, 1] -= STEPS * row0
    depth = view.inverse_depth()
    area = _cross(at[:, 1] - at[:, 0], at[:, 2] - at[:, 0])
    turned = area < 0
    at[turned], depth[turned] = at[turned][:, [0, 2, 1]], depth[turned][:, [0, 2, 1]]
    low = np.maximum(-(-at.min(axis=1) // STEPS), 0)
    high = np.minimum(at.max(axis=1) // STEPS, [width - 1, rows - 1])
    wide, tall = np.maximum(high - low + 1, 0).T
    owner, offset = expand(np.where(area != 0, wide * tall, 0))
    x = low[owner, 0] + offset % np.maximum(wide, 1)[owner]
    y = low[owner, 1] + offset // np.maximum(wide, 1)[owner]
    centre = STEPS * np.stack([x, y], axis=1)
    inside, z = np.ones(len(owner), bool), np.zeros(len(owner))
    for k in range(3):
        start, end = at[owner, k], at[owner, (k + 1) % 3]
        edge = end - start
        upper = (edge[:, 1] < 0) | ((edge[:, 1] == 0) & (edge[:, 0] > 0))
        opposite = _cross(edge, centre - start)
        inside &= opposite > np.where(upper, -1, 0)
        z += depth[owner, (k + 2) % 3] * opposite
    z = np.where(inside, z, 0.0)[inside] / np.abs(area[owner[inside]])
    owner, pixel = owner[inside], (y * width + x)[inside]
    # the last one of a pixel is the nearest, and the first of those as near
    order = np.lexsort((-owner, z, pixel)) if len(owner) else none
    result.reshape(-1)[pixel[order]] = owner[order] + 1
    return result


def _cross(a: npt.NDArray[np.int64], b: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])


@twin_check("optics/raster/compute_raster")
def _check(device: Device) -> None:
    view, rows = probe_view(), 21
    if not device.atomics64:
        return  # the rasteriser does it: optics/raster/id_buffer
    visibility = VisibilityBuffer(device, view, rows)
    out = device.empty(visibility.ids.stride * rows, "sight.check")
    for row0 in (0, 18):
        with device.recording("optics.sight") as recording:
            visibility.record(recording, row0, rows)
            visibility.number(recording, row0, rows)
            recording.copy_texture(visibility.ids, out, rows)
        got = out.read(np.uint32, (rows, visibility.ids.stride // 4))[:, : view.camera.width]
        compare("optics/raster/compute_raster", got, compute_raster_twin(view, row0, rows), "exact")


def probe_view() -> View:
    """Small triangles over and through each other, and beyond the borders of the image."""
    camera = Camera(59, 39, np.array([[111.0, 0.3, 28.7], [0.0, 110.0, 20.2], [0.0, 0.0, 1.0]]))
    return look([sheet(0.95, 1.3, 0.0), sheet(0.6, 0.6, 0.4)], camera, lit=False)


def sheet(
    wide: float, tall: float, tilt: float, paint: Paint | None = None, depth: float = 4.0
) -> Surface:
    """For probes: a sheet of 704 triangles across the viewing direction, more and more crumpled."""
    rng, columns, rows = np.random.default_rng(11), 23, 17
    grid = np.stack(np.meshgrid(np.linspace(-1, 1, columns), np.linspace(-1, 1, rows)), axis=-1)
    flat = np.concatenate([grid.reshape(-1, 2), np.full((columns * rows, 1), depth)], axis=1)
    noise = rng.normal(size=flat.shape) * [0.01 * wide, 0.01 * tall, 0.003]
    noise[:, 2] *= (0.5 + 0.5 * flat[:, 0]) ** 3
    points = flat * [wide, tall, 1.0] + noise
    points[:, 2] += tilt * points[:, 0]
    number = np.arange(columns * rows, dtype=np.int32).reshape(rows, columns)
    faces = np.stack([number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]], axis=-1)
    paint = paint or Plain()
    return Surface(points, faces.reshape(-1, 4), paint, reference=flat * [wide, tall, 1.0])
