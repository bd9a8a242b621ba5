"""The triangles' records, made on the device from the vertices that triangles share.

A record (`gpusim.optics.shading.setup.TRIANGLE`) holds what the pixels of a triangle have in
common. Where triangles cover a few pixels each, finding all of them on the host takes as long as
the picture, and they are ten times as large as what they follow from. Its twin is
`Setup.record_blocks`, which also serves large triangles, bitmaps and reliefs.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import numpy.typing as npt

from gpusim.gpu import Device, Recording
from gpusim.gpu.texture_array import Texels
from gpusim.optics.geometry.triangle_corners import NORMAL, ST
from gpusim.optics.raster.vertex_buffers import VertexBuffers
from gpusim.optics.shading.setup import TRIANGLE, Setup

__all__ = ["TriangleRecords", "vertex_blocks"]

Array = npt.NDArray[np.float64]

NEAR = 1 << 31
"""Added to the paint of triangles near a feature, as in the shader."""

STEPS = 65536
"""Of a pixel, and of one of these."""

BLOCK = 8192
"""Vertices at a time, which stay in the processor's cache and fill whole rows of a texture."""

REAL = 2, slice(6, 12)
"""Words of a vertex that are float32."""


class TriangleRecords:
    """The records of a view's triangles on the device.

    ``texels``: seven a triangle, good until those of another view are made. They are made of
    ``vertices``, whose 1 / depth is relative to ``inverse_depth``.
    """

    def __init__(
        self, setup: Setup, vertex_buffers: VertexBuffers, vertices: Texels, inverse_depth: float
    ) -> None:
        view, device = setup.view, vertex_buffers.device
        self.device, self.count, self.inverse_depth = device, view.count, inverse_depth
        looks = device.buffer(_albedo_and_paint(setup), "records.looks")
        traits = setup.traits().astype(np.float32)
        traited = device.texels(len(traits), "rgba32float", "records.traits")
        traited.write(traits)
        per = TRIANGLE.itemsize // 16
        self.texels = device.pool.texels(per * view.count, "rgba32uint", "records.triangles")
        self._bound = {
            "corners": vertex_buffers.corners, "looks": looks, "vertices": vertices,
            "traits": traited, "triangles": self.texels,
        }  # fmt: skip

    @staticmethod
    def of(device: Device, setup: Setup, vertex_buffers: VertexBuffers) -> TriangleRecords | None:
        """Those of a setup, not made yet; None where float32 or the shader can't."""
        view = setup.view
        if not view.count or setup.bitmaps.images or setup.bumps is not None:
            return None
        inverse_depth = float((1.0 / view.vertices[:, 2]).mean())
        vertices = device.pool.texels(3 * len(view.place), "rgba32uint", "records.vertices")
        for first, words, finite in vertex_blocks(setup, inverse_depth):
            if not finite:
                return None
            vertices.write(words.reshape(-1, 4), 3 * first)
        return TriangleRecords(setup, vertex_buffers, vertices, inverse_depth)

    def make(self, recording: Recording) -> None:
        """Make those of all triangles."""
        kernel = self.device.kernel("optics/shading/triangle_records")
        params = {"count": self.count, "inverse_depth": self.inverse_depth}
        bindings = kernel.bind(params=params, **self._bound)
        recording.dispatch(kernel, bindings, threads=(self.count,))


def _albedo_and_paint(setup: Setup) -> npt.NDArray[np.uint32]:
    """(T, 2): bits of the triangles' albedo, and their paint."""
    looks = np.empty((setup.view.count, 2), np.uint32)
    looks[:, 0] = setup.albedo.view(np.uint32)
    looks[:, 1] = setup.view.paint
    looks[:, 1] |= setup.near_feature.astype(np.uint32) << np.uint32(31)
    return looks


def vertex_blocks(
    setup: Setup, inverse_depth: float
) -> Iterator[tuple[int, npt.NDArray[np.uint32], bool]]:
    """A view's vertices as the shader reads them, block by block: the first one's number, words
    (n, 12), used again, and whether those that are float32 are finite.

    ``inverse_depth``: what theirs are relative to.
    """
    view = setup.view
    vertices, ideal, sides = view.vertices, view.ideal_place, _sides(setup)
    patterned = bool((setup.table.paints["featured"] > 0).any())
    words = np.empty((BLOCK, 12), np.uint32)
    columns = np.zeros((12, BLOCK), np.uint32)
    for first in range(0, len(ideal), BLOCK):
        part = slice(first, min(first + BLOCK, len(ideal)))
        block = columns[:, : part.stop - first]
        whole, real = block.view(np.int32), block.view(np.float32)
        block[3] = 0
        for axis in range(2):
            steps = ideal[part, axis] * STEPS
            below = np.floor(steps)
            whole[axis] = below
            block[3] |= ((steps - below) * STEPS).astype(np.uint32) << np.uint32(16 * axis)
        real[2] = 1.0 / vertices[part, 2] / inverse_depth - 1.0
        if patterned:
            side = sides[part]
            for axis in range(2):
                value = vertices[part, ST.start + axis]
                cell = np.floor(value / side)
                whole[4 + axis] = cell
                real[6 + axis] = value - cell * side
        if setup.lit:
            real[8:11] = vertices[part, NORMAL].T
        real[11] = sides[part]
        own = words[: part.stop - first]
        for k, column in enumerate(block):
            own[:, k] = column
        yield first, own, all(bool(np.isfinite(real[rows]).all()) for rows in REAL)


def _sides(setup: Setup) -> Array:
    """(V,): side of the cells of the pattern that each vertex has; 1 without."""
    view, paints = setup.view, setup.table.paints
    side = np.ones(len(view.place))
    for number in np.flatnonzero(paints["featured"] > 0):
        own = view.paint == number
        whole = bool(own.all())
        rows = slice(None) if whole else view.corner[own].reshape(-1)
        side[rows] = paints["cell"][number]
    return side
