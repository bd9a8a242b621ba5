"""Visibility: which triangle the centre of each pixel sees.

On the device this is the hardware rasteriser, a band of rows at a time; the twin scans rows with
the same rule (a pixel centre on an edge belongs to the triangle on its right or below). The two
may differ by one pixel along an edge, where screen positions are snapped to 1/256 px; such pixels
are edge pixels and are resolved from the exact geometry in `gpusim.optics.edge_pixels.resolve`.
"""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from gpusim.arrays.array_types import Float
from gpusim.arrays.ragged import batches, expand
from gpusim.gpu import Buffer, Device, Recording
from gpusim.optics.geometry.view import View
from gpusim.optics.paint.checker_lines import BoardLines

CHUNK = 4_000_000

NONE = np.zeros(1, np.uint32)
"""Of lists of triangles: the device takes no empty buffers."""


class VertexBuffers:
    """Vertices in fixed point with their depths, and which of them a triangle has.

    ``fixed`` (V, 2) int32: places in 1/65536 px; ``inverse`` (V,) float32: 1 / depth; ``near``:
    what that is scaled by for the depth buffer.
    """

    def __init__(
        self, device: Device, view: View, label: str, lines: BoardLines | None = None
    ) -> None:
        """Buffers are called ``label``.…; strips along ``lines`` follow the view's triangles."""
        fixed, corners = view.fixed(), _corners_of(view)
        self.near, depth = view.raster_depth()
        if lines is not None:
            strips = np.arange(3 * len(lines.parent), dtype=np.uint32) + np.uint32(len(fixed))
            corners = np.concatenate([corners, strips])
            fixed = np.concatenate([fixed, lines.fixed().reshape(-1, 2)])
            depth = np.concatenate([depth, lines.inverse_depth.astype(np.float32).reshape(-1)])
        self.device, self.label = device, label
        self.fixed, self.inverse = fixed, depth
        self.corners: Buffer = device.buffer(corners, f"{label}.corners")

    @cached_property
    def screen(self) -> Buffer:
        """``fixed``; rasterisers and the edge pass read it."""
        return self.device.buffer(self.fixed, f"{self.label}.screen")

    @cached_property
    def inverse_depth(self) -> Buffer:
        """1 / depth of every vertex; rasterisers alone read it."""
        return self.device.buffer(self.inverse, f"{self.label}.inverse_depth")

    def bindings(self) -> dict[str, Any]:
        """All that draws them binds, by WGSL names."""
        return {**self.outlines(), "inverse_depth": self.inverse_depth}

    def outlines(self) -> dict[str, Any]:
        """What tells where triangles lie on the image."""
        return {"screen": self.screen, "corners": self.corners}


def _corners_of(view: View) -> npt.NDArray[np.uint32]:
    """The triangles' vertices, three and three, (3 T,); one triangle at least."""
    result = np.zeros((max(view.count, 1), 3), np.uint32)
    for column, vertices in zip(result.T, view.corner.T, strict=True):
        column[: view.count] = vertices
    return result.reshape(-1)


class VisibilityBuffer:
    """The triangle that each pixel of a band sees.

    ``ids``: numbers + 1, 0 is background; ``depth``: what the rasteriser leaves.
    """

    def __init__(self, vertex_buffers: VertexBuffers, view: View, rows: int) -> None:
        """Of bands of ``rows``."""
        self.vertex_buffers, self.view, self.rows = vertex_buffers, view, rows
        self.device, width = vertex_buffers.device, view.camera.width
        self.ids = self.device.target(width, rows, "r32uint", "shade.ids")
        self.depth = self.device.target(width, rows, "depth32float", "shade.depth")

    @staticmethod
    def of(device: Device, view: View, rows: int) -> VisibilityBuffer:
        """Of a view that isn't on the device yet."""
        return VisibilityBuffer(VertexBuffers(device, view, "visibility"), view, rows)

    def record(self, recording: Recording, row0: int, rows: int) -> None:
        """Draw a band."""
        width, count = self.view.camera.width, self.view.count
        params = {"width": width, "rows": rows, "row0": row0, "near": self.vertex_buffers.near}
        entry, listed = "vertex", {}
        if rows < self.view.camera.height and count:
            # software rasterisers take as long for what lies in other bands
            low, high = (ends[:, 1] for ends in self.view.box)
            in_band = np.flatnonzero((high >= row0 - 1.0) & (low <= row0 + rows)).astype(np.uint32)
            entry, count = "vertex_some", len(in_band)
            listed = {"order": self.device.buffer(in_band if count else NONE, "visibility.order")}
        raster = self.device.raster(
            "optics/raster/id_buffer", ("r32uint",), entries=(entry, "fragment")
        )
        bindings = raster.bind(params=params, **listed, **self.vertex_buffers.bindings())
        recording.draw(
            raster, bindings, colors=(self.ids,), depth=self.depth, vertices=3 * count,
            size=(width, rows),
        )  # fmt: skip

    def read(self) -> npt.NDArray[np.uint32]:
        """Ids of the whole image, (H, W) uint32."""
        camera = self.view.camera
        kernel = self.device.kernel("optics/raster/id_buffer", "read_ids")
        out = self.device.empty(4 * camera.width * self.rows, "visibility.read")
        result = np.empty((camera.height, camera.width), np.uint32)
        for row0 in range(0, camera.height, self.rows):
            rows = min(self.rows, camera.height - row0)
            with self.device.recording("optics.visibility") as recording:
                self.record(recording, row0, rows)
                size = {"width": camera.width, "rows": rows}
                bindings = kernel.bind(copy=size, ids=self.ids, result=out)
                recording.dispatch(kernel, bindings, threads=(camera.width, rows))
            result[row0 : row0 + rows] = out.read(np.uint32, (rows, camera.width))
        return result


def visibility_twin(view: View) -> npt.NDArray[np.uint32]:
    """Triangle number + 1 (0: none) per pixel, (H, W) uint32, by scanning rows in float64."""
    camera = view.camera
    shape = (camera.height, camera.width)
    nearest = np.zeros(shape[0] * shape[1])
    ids = np.zeros(shape[0] * shape[1], np.uint32)
    screen = np.rint(view.screen * 65536) / 65536
    low = np.maximum(np.ceil(screen[:, :, 1].min(axis=1)), 0).astype(np.int64)
    high = np.minimum(np.ceil(screen[:, :, 1].max(axis=1)), shape[0]).astype(np.int64)
    spans = np.maximum(high - low, 0)
    triangle, row = expand(spans)
    row += low[triangle]
    left, right = _row_interval(screen[triangle], row.astype(np.float64))
    first = np.maximum(np.ceil(left), 0).astype(np.int64)
    count = np.maximum(np.minimum(np.ceil(right), shape[1]).astype(np.int64) - first, 0)
    depth_plane = depth_planes(screen, view.inverse_depth())
    for part in batches(count, CHUNK):
        span, column = expand(count[part])
        span += part.start
        column += first[span]
        plane = depth_plane[triangle[span]]
        depth = plane[:, 0] * column + plane[:, 1] * row[span] + plane[:, 2]
        pixel = row[span] * shape[1] + column
        better = np.flatnonzero(depth > nearest[pixel])
        better = better[np.argsort(depth[better], kind="stable")]
        nearest[pixel[better]] = depth[better]
        ids[pixel[better]] = triangle[span[better]] + 1
    return ids.reshape(shape)


def _row_interval(corners: Float, row: Float) -> tuple[Float, Float]:
    """Where the line y = row enters and leaves each triangle (n, 3, 2)."""
    left = np.full(len(row), np.inf)
    right = np.full(len(row), -np.inf)
    for k in range(3):
        a, b = corners[:, k], corners[:, (k + 1) % 3]
        lower, upper = np.minimum(a[:, 1], b[:, 1]), np.maximum(a[:, 1], b[:, 1])
        crosses = (lower <= row) & (row < upper)
        rise = np.where(crosses, b[:, 1] - a[:, 1], 1.0)
        x = a[:, 0] + (row - a[:, 1]) * (b[:, 0] - a[:, 0]) / rise
        left = np.where(crosses, np.minimum(left, x), left)
        right = np.where(crosses, np.maximum(right, x), right)
    empty = ~(right > left)
    return np.where(empty, 0.0, left), np.where(empty, 0.0, right)


def depth_planes(corners: Float, inverse: Float) -> Float:
    """(n, 3): 1 / z = a x + b y + c through corners (n, 3, 2), where it is ``inverse`` (n, 3)."""
    x, y = np.asfortranarray(corners).T
    z = np.asfortranarray(inverse).T
    ux, uy, vx, vy = x[1] - x[0], y[1] - y[0], x[2] - x[0], y[2] - y[0]
    area = ux * vy - uy * vx
    safe = np.where(area != 0.0, area, np.inf)
    p, q = z[1] - z[0], z[2] - z[0]
    a = (p * vy - q * uy) / safe
    b = (q * ux - p * vx) / safe
    return np.stack([a, b, z[0] - a * x[0] - b * y[0]]).T
