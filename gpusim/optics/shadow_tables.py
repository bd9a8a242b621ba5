"""The tables of `gpusim.optics.shadow_tiles` as the shaders read them (common/occlusion.wgsl)."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from gpusim.errors import OutOfDeviceMemory
from gpusim.gpu import Device, Uniform
from gpusim.gpu.texels import Texels, most_texels
from gpusim.optics.emitters import MOST_LAMPS
from gpusim.optics.lighting import Lighting
from gpusim.optics.occlusion import ENOUGH_EDGES, TOLERANCE, lamp_masks
from gpusim.optics.ragged import expand
from gpusim.optics.shadow_tiles import Chains, ShadowTiles

__all__ = ["ShadowTables"]

Numbers = npt.NDArray[np.int64]

TEXELS = 3
"""Of an edge."""


class ShadowTables:
    """Uniform and textures; a view without shadows gets empty ones."""

    def __init__(self, device: Device, lighting: Lighting) -> None:
        tiles = lighting.shadows if isinstance(lighting.shadows, ShadowTiles) else None
        self.shades = Uniform(device, _shades(lighting), "shade.shades")
        edges = np.zeros((0, 3, 4), np.float32)
        lists = grid = np.zeros((0, 4), np.uint32)
        if tiles is not None:
            start, count, faces, edges = _with_chains(tiles.chains, *_edges(tiles))
            most = most_texels(device) // TEXELS
            if not len(edges) <= most:
                raise OutOfDeviceMemory(
                    f"render shadows; got {len(edges)} edges that may hide lamps from tiles of "
                    f"pixels; expected at most {most}: take smaller or fewer lamps, a coarser "
                    "mesh, fewer pixels, shadows = False, or backend 'numpy'"
                )
            lists = np.zeros((start.size, 4), np.uint32)
            # the lamps that a tile sees in part come first
            order = np.argsort(count == 0, axis=1, kind="stable")
            lists[:, 0] = np.take_along_axis(start, order, axis=1).reshape(-1)
            lists[:, 1] = np.take_along_axis(count, order, axis=1).reshape(-1)
            lists[:, 2] = order.reshape(-1)
            lists[:, 3] = np.repeat((count > 0).sum(axis=1), count.shape[1])
            faces = np.take_along_axis(faces, order, axis=1).reshape(-1)
            lists[:, 3] |= faces.astype(np.uint32) << np.uint32(8)
            grid = np.zeros((tiles.lit.size, 4), np.uint32)
            grid[:, 0], grid[:, 1] = tiles.lit.reshape(-1), tiles.entry.reshape(-1)
        self.occluders = _texels(device, edges.reshape(-1, 4), "shadow.occluders")
        self.lists = _texels(device, lists, "shadow.lists")
        self.tiles = _texels(device, grid, "shadow.tiles")

    def bindings(self) -> dict[str, Any]:
        """By their WGSL names."""
        return {
            "shades": self.shades,
            "occluders": self.occluders,
            "shadow_lists": self.lists,
            "shadow_tiles": self.tiles,
        }


def _edges(tiles: ShadowTiles) -> tuple[Numbers, Numbers, npt.NDArray[np.float32]]:
    """First and number (E, L) of the edges that lamps' shares of a tile depend on, and these as the
    shaders read them, (n, 3, 4)."""
    across = tiles.corners[:, 2] - tiles.corners[:, 0]
    normal = np.cross(across, tiles.corners[:, 3] - tiles.corners[:, 1])
    length = np.linalg.norm(normal, axis=1)[:, None]
    normal /= np.where(length > 0.0, length, 1.0)
    faces = np.zeros((len(tiles.corners), 4, 3, 4), np.float32)
    corners = tiles.corners.astype(np.float32)
    faces[:, :, 0, :3], faces[:, :, 0, 3] = corners, 2.0 * tiles.both_sides[:, None]
    faces[:, :, 1, :3] = np.roll(corners, -1, axis=1) - corners
    faces[:, :, 2, :3] = normal[:, None]
    faces[:, :, 2, 3] = np.sum(normal * tiles.corners.mean(axis=1), axis=1)[:, None]
    pair, edge = np.nonzero(tiles.edges[:, None] >> np.arange(4, dtype=np.uint8) & 1)
    begin = np.searchsorted(pair, np.arange(len(tiles.edges) + 1))
    edges = faces[tiles.face[pair], edge]
    edges[begin[1:] - 1, 0, 3] += 1.0
    edges[:, 1, 3] = (np.bitwise_count(tiles.edges) < ENOUGH_EDGES)[pair]
    start = begin[tiles.start]
    return start, begin[tiles.start + tiles.count] - start, edges


def _with_chains(
    chains: Chains, start: Numbers, count: Numbers, edges: npt.NDArray[np.float32]
) -> tuple[Numbers, Numbers, Numbers, npt.NDArray[np.float32]]:
    """`_edges` with those of outlines behind those of faces; first and number (E, L) of all, the
    number of those of faces, and all of them."""
    if not len(chains.ends):
        return start, count, count, edges
    both = count + chains.count
    first = (np.cumsum(both) - both.reshape(-1)).reshape(both.shape)
    result = np.zeros((len(edges) + len(chains.ends), 3, 4), np.float32)
    for own, many, skipped in ((edges, count, 0), (_ends(chains), chains.count, count)):
        list_of, step = expand(many.reshape(-1))
        result[(first + skipped).reshape(-1)[list_of] + step] = own
    return first, both, count, result


def _ends(chains: Chains) -> npt.NDArray[np.float32]:
    """(n, 3, 4) the edges of outlines."""
    result = np.zeros((len(chains.ends), 3, 4), np.float32)
    result[:, :2, :3], result[:, 0, 3] = chains.ends, chains.last
    result[:, 2] = chains.cut
    return result


def _texels(device: Device, values: np.ndarray[Any, Any], label: str) -> Texels:
    fmt = "rgba32float" if values.dtype == np.float32 else "rgba32uint"
    if not len(values):
        return device.no_texels(fmt)
    texels = device.texels(len(values), fmt, label)
    texels.write(values)
    return texels


def _shades(lighting: Lighting) -> dict[str, Any]:
    tiles = lighting.shadows if isinstance(lighting.shadows, ShadowTiles) else None
    lamps: dict[str, np.ndarray[Any, Any]] = {
        "centre": np.zeros((MOST_LAMPS, 4)), "u": np.zeros((MOST_LAMPS, 4)),
        "v": np.zeros((MOST_LAMPS, 4)), "part": np.zeros((MOST_LAMPS, 4), np.uint32),
        "mask": np.zeros((MOST_LAMPS, 4, 4), np.uint32),
    }  # fmt: skip
    own = lighting.emitters[:, 11]
    for number, lamp in enumerate(tiles.lamps if tiles is not None else ()):
        masks = lamp_masks(lamp)
        first, stop = np.searchsorted(own, [number, number + 1])
        lamps["centre"][number] = *lamp.centre, 0.0 if lamp.far else 1.0
        across = lamp.u if lamp.extended else tiles.chains.scans[number] if tiles else lamp.u
        lamps["u"][number] = *across, float(lamp.extended)
        lamps["v"][number] = *lamp.v, float(np.bitwise_count(masks).sum())
        lamps["part"][number, :2] = first, stop
        lamps["mask"][number] = masks.reshape(4, 4)
    return {
        "count": len(tiles.lamps) if tiles is not None else 0,
        "columns": tiles.lit.shape[1] if tiles is not None else 1,
        "tolerance": TOLERANCE,
        "lamps": lamps,
    }
