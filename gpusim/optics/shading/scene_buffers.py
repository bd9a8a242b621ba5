"""What shaders read of a setup: its triangles, paints, lights and shadows, on the device."""

from __future__ import annotations

from copy import copy
from typing import Any

import numpy as np
import numpy.typing as npt

from gpusim.gpu import Device, Uniform
from gpusim.gpu.texture_array import Texels
from gpusim.optics.ambient.sky_visibility_buffers import sky_visibility_texels
from gpusim.optics.camera.undistortion_table import distortion_map
from gpusim.optics.light.microfacet_material import gloss_texels
from gpusim.optics.paint.checker_lines import BoardLines
from gpusim.optics.paint.relief_normals import bump_texels, bump_uniform
from gpusim.optics.raster.vertex_buffers import VertexBuffers
from gpusim.optics.shading.setup import TRIANGLE, Setup
from gpusim.optics.shading.triangle_records import TriangleRecords
from gpusim.optics.shadow.scene import Shadows

__all__ = ["SceneBuffers"]

NO_TILES = {"last": np.zeros(2), "middle": np.zeros(2), "size": 1, "columns": 1}


class SceneBuffers:
    """A setup on the device, shared by the interior and the edge pass."""

    def __init__(
        self,
        device: Device,
        setup: Setup,
        lines: BoardLines | None = None,
        vertex_buffers: VertexBuffers | None = None,
    ) -> None:
        """``lines``: strips that are drawn along the lines of boards; ``vertex_buffers``: of a
        view without those whose triangles are small, where they are on the device already."""
        table, view = setup.table, setup.view
        self.device, self.setup = device, setup
        self.lamps = Uniform(device, setup.lighting.uniform(), "shade.lamps")
        self.gloss = gloss_texels(device, setup.lighting.gloss)
        self.relief = Uniform(device, bump_uniform(setup.bumps), "shade.relief")
        self.bumps = bump_texels(device, setup.bumps)
        self.openness = sky_visibility_texels(device, setup.lighting.openness)
        self.planes = device.no_texels("rgba32uint")
        self.paints = _as_texels(device, table.paints, "shade.paints")
        self.patterns = table.texels(device)
        self.lines = lines
        self.vertex_buffers = vertex_buffers or VertexBuffers(device, view, "shade", lines)
        records = None
        if vertex_buffers is not None:
            records = TriangleRecords.of(device, setup, vertex_buffers)
        if records is None:
            self.triangles = _triangles(device, setup, self.lines)
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

    def with_shadows(self, shadows: Shadows, planes: Texels) -> SceneBuffers:
        """The same scene with shadows; ``planes``: `gpusim.optics.shading.receiver_planes`."""
        result = copy(self)
        result.setup, result.planes = self.setup.with_shadows(shadows), planes
        return result

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
        }

    def rays(self) -> dict[str, npt.NDArray[np.float64]]:
        """The ray matrix as uniform columns."""
        columns = np.zeros((3, 4))
        columns[:, :3] = self.setup.rays().T
        return {"x": columns[0], "y": columns[1], "one": columns[2]}


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
    own = np.zeros((len(parent), 4 * per), np.float32)
    texels = device.texels(per * max(count + len(parent), 1), "rgba32uint", "shade.triangles")
    for first, words in setup.record_blocks():
        texels.write(words.view(np.uint32).reshape(-1, 4), per * first)
        rows = np.flatnonzero((parent >= first) & (parent < first + len(words)))
        own[rows] = words[parent[rows] - first]
    if lines is not None:
        texels.write(own.view(np.uint32).reshape(-1, 4), per * count)
    return texels
