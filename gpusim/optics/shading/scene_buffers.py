"""What shaders read of a setup: its triangles, paints, lights and shadows, on the device.

A triangle's record (`gpusim.optics.shading.triangle_records`) holds what its pixels have in common.
Where triangles cover a few pixels each, finding all of them on the host takes as long as the
picture, and they are ten times as large as what they follow from: there the device makes them from
the vertices that triangles share. Their twin is `record_blocks`, which also serves large
triangles, bitmaps and reliefs.

The planes of triangles, from which their pixels ask for lamps, follow from the records, so that a
pixel lies at the same place in both. Their twin finds them from the corners, in float64.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import numpy.typing as npt

from gpusim.arrays.array_types import Float, Int
from gpusim.gpu import Device, Recording, Uniform
from gpusim.gpu.texture_array import Texels
from gpusim.optics.ambient.sky_visibility import sky_visibility_texels
from gpusim.optics.camera.undistortion_table import distortion_map
from gpusim.optics.geometry.triangle_corners import NORMAL, ST
from gpusim.optics.geometry.view import View
from gpusim.optics.light.microfacet_material import gloss_texels
from gpusim.optics.paint.checker_lines import BoardLines
from gpusim.optics.paint.feature_grid import FeatureGrid
from gpusim.optics.paint.relief_normals import bump_texels, bump_uniform
from gpusim.optics.shading.setup import Setup
from gpusim.optics.shading.spectrum import tints
from gpusim.optics.shading.triangle_records import TRIANGLE, paint_traits, record_blocks
from gpusim.optics.shading.triangle_traits import TriangleTraits
from gpusim.optics.shadow.receivers import PixelReceivers
from gpusim.optics.visibility_buffer import VertexBuffers

STEPS = 65536
"""Of a pixel, and of one of these."""

BLOCK = 8192
"""Vertices at a time, which stay in the processor's cache and fill whole rows of a texture."""

REAL = 2, slice(6, 12)
"""Words of a vertex that are float32."""

NO_TILES = {"last": np.zeros(2), "middle": np.zeros(2), "size": 1, "columns": 1}


class SceneBuffers:
    """A setup on the device, shared by the interior and the edge pass."""

    def __init__(
        self,
        device: Device,
        setup: Setup,
        lines: BoardLines | None = None,
        fine: bool = False,
    ) -> None:
        """``lines``: strips that are drawn along the lines of boards; ``fine``: the triangles'
        records are made on the device."""
        table, view = setup.table, setup.view
        self.device, self.setup = device, setup
        self.lamps = Uniform(device, setup.lighting.uniform(), "shade.lamps")
        self.gloss = gloss_texels(device, [band.lighting.gloss for band in setup.bands])
        self._color = _color_bindings(device, setup)
        self.relief = Uniform(device, bump_uniform(setup.traits.bumps), "shade.relief")
        self.bumps = bump_texels(device, setup.traits.bumps)
        self.openness = sky_visibility_texels(device, setup.lighting.openness)
        self.paints = _as_texels(device, table.paints, "shade.paints")
        self.patterns = table.texels(device)
        self.lines = lines
        self.vertex_buffers = VertexBuffers(device, view, "shade", lines)
        records = TriangleRecords.of(device, setup, self.vertex_buffers) if fine else None
        if records is None:
            self.triangles = _triangles(device, setup, lines)
        else:
            self.triangles = records.texels
            with device.recording("optics.records") as recording:
                records.make(recording)
        bends = distortion_map(view.camera)
        self.undistortion = self.bitmap_texels = device.no_texels("rgba32float")
        if bends is not None:
            bent = bends.texels()
            self.undistortion = device.texels(len(bent), "rgba32float", "shade.undistortion")
            self.undistortion.write(bent)
        tiles = NO_TILES if bends is None else bends.tiles()
        self.tiles = Uniform(device, tiles, "shade.tiles")
        if setup.bitmaps.images:
            texels = setup.bitmaps.texels()
            self.bitmap_texels = Texels(device, len(texels), "rgba32float", "shade.bitmaps")
            self.bitmap_texels.write(texels)
        self.speckles = table.speckle.texels(device)
        self.planes = device.no_texels("rgba32uint")
        if setup.lighting.shadows is not None:
            on = setup.lighting.shadows.owners
            on = on if lines is None else np.append(on, on[lines.parent])
            self.planes = planes_on_device(self, on)

    def shared(self) -> dict[str, Any]:
        """The bindings that both passes have, by their WGSL names."""
        return {
            "paints": self.paints,
            "patterns": self.patterns,
            **self.surface(),
            "bitmap_texels": self.bitmap_texels,
            "speckles": self.speckles,
        }

    def surface(self) -> dict[str, Any]:
        """The bindings of all that light a surface."""
        return {
            "triangles": self.triangles,
            "lamps": self.lamps,
            "gloss_table": self.gloss,
            "relief": self.relief,
            "bumps": self.bumps,
            "openness": self.openness,
            "tiles": self.tiles,
            "undistortion": self.undistortion,
            **self._color,
        }

    def rays(self) -> dict[str, Float]:
        """The ray matrix as uniform columns."""
        columns = np.zeros((3, 4))
        columns[:, :3] = self.setup.view.rays().T
        return {"x": columns[0], "y": columns[1], "one": columns[2]}


def _color_bindings(device: Device, setup: Setup) -> dict[str, Any]:
    """What programs read of colours, by their WGSL names; nothing where all is grey."""
    if setup.palette is None:
        return {}
    palette = device.texels(len(setup.palette), "rgba32float", "shade.palette")
    palette.write(setup.palette)
    light = Uniform(device, tints(setup.lighting, setup.bands), "shade.tints")
    return {"palette": palette, "tints": light}


def _as_texels(device: Device, records: npt.NDArray[np.void], label: str) -> Texels:
    """Records of 32-bit words, each filled up to whole texels."""
    words = records.view(np.uint32).reshape(len(records), -1)
    if words.shape[1] % 4:
        words = np.pad(words, ((0, 0), (0, -words.shape[1] % 4)))
    texels = Texels(device, words.size // 4, "rgba32uint", label)
    texels.write(words.reshape(-1, 4))
    return texels


def _triangles(device: Device, setup: Setup, lines: BoardLines | None) -> Texels:
    """The triangles' records; written block by block, while they are in the processor's cache.

    Behind them those of the strips along ``lines``, which are their parents'.
    """
    per, count = TRIANGLE.itemsize // 16, setup.view.count
    parent = np.zeros(0, np.int64) if lines is None else lines.parent
    records = np.zeros((len(parent), 4 * per), np.float32)
    texels = device.texels(per * max(count + len(parent), 1), "rgba32uint", "shade.triangles")
    for first, words in record_blocks(setup):
        texels.write(words.view(np.uint32).reshape(-1, 4), per * first)
        rows = np.flatnonzero((parent >= first) & (parent < first + len(words)))
        records[rows] = words[parent[rows] - first]
    if lines is not None:
        texels.write(records.view(np.uint32).reshape(-1, 4), per * count)
    return texels


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
        looks = device.buffer(_albedo_and_paint(view, setup.traits), "records.looks")
        traits = paint_traits(setup.table, setup.lighting.gloss).astype(np.float32)
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
        if not view.count or setup.bitmaps.images or setup.traits.bumps is not None:
            return None
        inverse_depth = float((1.0 / view.vertices[:, 2]).mean())
        vertices = device.pool.texels(3 * len(view.place), "rgba32uint", "records.vertices")
        for first, words, finite in vertex_blocks(view, setup.table, setup.lit, inverse_depth):
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


def _albedo_and_paint(view: View, traits: TriangleTraits) -> npt.NDArray[np.uint32]:
    """(T, 2): bits of the triangles' albedo, and their paint."""
    looks = np.empty((view.count, 2), np.uint32)
    looks[:, 0] = traits.albedo.view(np.uint32)
    looks[:, 1] = view.paint
    looks[:, 1] |= traits.near_feature.astype(np.uint32) << np.uint32(31)
    return looks


def vertex_blocks(
    view: View, table: FeatureGrid, lit: bool, inverse_depth: float
) -> Iterator[tuple[int, npt.NDArray[np.uint32], bool]]:
    """A view's vertices as the shader reads them, block by block: the first one's number, words
    (n, 12), used again, and whether those that are float32 are finite.

    ``inverse_depth``: what theirs are relative to.
    """
    vertices, ideal, sides = view.vertices, view.ideal_place, _sides(view, table)
    patterned = bool((table.paints["featured"] > 0).any())
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
        if lit:
            real[8:11] = vertices[part, NORMAL].T
        real[11] = sides[part]
        records = words[: part.stop - first]
        for k, column in enumerate(block):
            records[:, k] = column
        yield first, records, all(bool(np.isfinite(real[rows]).all()) for rows in REAL)


def _sides(view: View, table: FeatureGrid) -> Float:
    """(V,): side of the cells of the pattern that each vertex has; 1 without."""
    paints = table.paints
    side = np.ones(len(view.place))
    for number in np.flatnonzero(paints["featured"] > 0):
        of_paint = view.paint == number
        whole = bool(of_paint.all())
        rows = slice(None) if whole else view.corner[of_paint].reshape(-1)
        side[rows] = paints["cell"][number]
    return side


def planes_on_device(buffers: SceneBuffers, on: Int) -> Texels:
    """Of each triangle n / d of its plane n x = d, and its `plane_words`; ``on`` (T,): the occluder
    that it is part of, -1 for none."""
    device, camera = buffers.device, buffers.setup.view.camera
    texels = device.pool.texels(max(len(on), 1), "rgba32uint", "shadow.planes")
    last = np.array([camera.width - 1.0, camera.height - 1.0])
    kernel = device.kernel(
        "optics/shading/receiver_planes", "main", {"distorted": float(camera.lens is not None)}
    )
    bindings = kernel.bind_used(
        params={**buffers.rays(), "last": last, "count": len(on)},
        owners=device.buffer(on, "shadow.owners"), planes=texels,
        **buffers.vertex_buffers.outlines(), **buffers.surface(),
    )  # fmt: skip
    with device.recording("optics.shadow") as recording:
        recording.dispatch(kernel, bindings, threads=(len(on),))
    return texels


def planes_twin(view: View) -> tuple[Float, Float]:
    """(T, 3): n / d of the triangles of a view; (T,): how far normals for shading are from n."""
    planes = PixelReceivers.planes_of(view)
    normals = view.corners_of(slice(None), NORMAL)
    cosine = np.abs(np.einsum("tka,ta->tk", normals, planes)).min(axis=1)
    cosine /= np.linalg.norm(planes, axis=1)
    return planes, np.sqrt(np.maximum(2.0 - 2.0 * cosine, 0.0))
