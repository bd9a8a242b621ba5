"""The tables of `gpusim.optics.ambient.sky_visibility` as lib/light/sky_visibility.wgsl reads
them."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from gpusim.gpu import Device
from gpusim.gpu.texture_array import Texels
from gpusim.optics.ambient.sky_visibility import SkyVisibility

__all__ = ["sky_visibility_texels"]


def sky_visibility_texels(device: Device, openness: SkyVisibility | None) -> Texels:
    """The shares on the device; empty where nothing hides surroundings."""
    if openness is None:
        return device.no_texels("rgba32uint")
    words = _words(openness)
    texels = device.texels(len(words), "rgba32uint", "shade.openness")
    texels.write(words)
    return texels


def _words(openness: SkyVisibility) -> npt.NDArray[np.uint32]:
    """(N, 4): three texels per triangle, one per piece, one per node with the cell it begins."""
    count, pieces = len(openness.pieces), len(openness.cells)
    head = np.zeros((count, 3, 4), np.uint32)
    head[:, :2] = openness.planes.astype(np.float32).view(np.uint32)
    head[:, 2, 0] = openness.pieces
    head[:, 2, 1] = 3 * count + openness.first
    piece = np.zeros((pieces, 4), np.uint32)
    piece[:, 0] = 3 * count + pieces + openness.start
    piece[:, 1] = openness.cells
    # a cell's other corners lie one, a row, and a row and one further
    first, which = np.unique(openness.start, return_index=True)
    row = np.repeat(openness.cells[which] + 1, np.diff(np.append(first, len(openness.values))))
    value = openness.values.astype(np.float32)
    value = np.concatenate([value, np.zeros(int(row.max(initial=0)) + 1, np.float32)])
    i = np.arange(len(openness.values))
    cells = np.stack([value[i], value[i + 1], value[i + row], value[i + row + 1]], axis=1)
    return np.concatenate([head.reshape(-1, 4), piece, cells.view(np.uint32)])
