"""Light on large flat matte faces, evaluated at the corners of tiles and interpolated between.

Walls, floors and plates fill most of a picture, and the light on them changes over hundreds of
pixels: on 8 px it is linear in x and in y. Each square of 128 px belongs to one plane; its tiles
get four coefficients, and the pixels of that plane read one texel in place of all lamps. A plane
counts only where the second derivative of light that falls off with the distance and by two
cosines leaves an error below `TOLERANCE` of it. Spots, whose beams have borders, have no tiles.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from gpusim.arrays.array_types import Bool, Float, Long
from gpusim.arrays.ragged import cells_of_boxes
from gpusim.gpu import Recording
from gpusim.gpu.texture_array import Texels
from gpusim.mesh.polygons import unit_normals
from gpusim.optics.camera.undistortion_table import distortion_map
from gpusim.optics.geometry.triangle_corners import NORMAL, corner_range
from gpusim.optics.geometry.view import View
from gpusim.optics.shading.lighting import Lighting
from gpusim.optics.shading.radiance import radiance_of
from gpusim.optics.shading.scene_buffers import SceneBuffers
from gpusim.optics.shading.setup import Setup

TILE = 8
"""px, side of the tiles."""

SQUARE = 128
"""px, side of the squares that belong to one plane."""

MIN_PIXELS = 64.0
"""px; smaller triangles are no part of it."""

MIN_SHARE = 0.1
"""Of the picture that triangles with tiles cover; less isn't worth it."""

TOLERANCE = 5e-5
"""Of the light on a face turned to the lamp, that interpolation may be off by."""

PLANE_TOLERANCE = 1e-9
"""Distance from a plane, by that from the eye, that counts as on it."""

MAX_PLANES = 16


@dataclass(frozen=True, eq=False)
class LightTiles:
    """``member`` (T,): triangles that read their light from tiles; ``owner`` (rows, columns).

    ``owner``: per square of `SQUARE` px, number + 1 of a triangle of the plane seen there, or 0.
    """

    member: Bool
    owner: npt.NDArray[np.uint32]

    @staticmethod
    def of(setup: Setup, tolerance: float | None = None) -> LightTiles | None:
        """The tiles of a view, to `TOLERANCE` unless given; None where there is little to gain."""
        view, camera = setup.view, setup.view.camera
        if not setup.lit or not view.count or _has_spots(setup.lighting) or setup.lighting.openness:
            return None
        low, high = view.box
        low = np.maximum(low, -0.5)
        high = np.minimum(high, np.array([camera.width, camera.height]) - 0.5)
        wide, tall = np.maximum(high - low, 0.0).T
        area = np.where(setup.traits.shiny | setup.traits.bumpy, 0.0, 0.5 * (wide * tall))
        large = np.flatnonzero(area >= MIN_PIXELS)
        large = large[_flat(view, large)]
        tolerance = TOLERANCE if tolerance is None else tolerance
        large = large[_smooth(view, setup.lighting, large, tolerance)]
        shape = (-(-camera.height // SQUARE), -(-camera.width // SQUARE))
        owner, plane_of = np.zeros(shape[0] * shape[1], np.uint32), np.full(shape[0] * shape[1], -1)
        member = np.zeros(view.count, bool)
        remaining = large[np.argsort(-area[large], kind="stable")]
        for plane in range(MAX_PLANES):
            if not len(remaining):
                break
            same = _in_plane(view, remaining[0], remaining)
            in_plane, remaining = remaining[same], remaining[~same]
            number, square = _squares(low[in_plane], high[in_plane], shape[1])
            taken = plane_of[square] >= 0
            free = np.bincount(number[taken], minlength=len(in_plane)) == 0
            square = square[free[number]]
            owner[square], plane_of[square] = in_plane[0] + 1, plane
            member[in_plane[free]] = True
        if not area[member].sum() >= MIN_SHARE * camera.width * camera.height:
            return None
        return LightTiles(member, owner.reshape(shape))


def _has_spots(lighting: Lighting) -> bool:
    """Whether some lamp's light ends at a border: emitters of spots have a beam."""
    return bool((lighting.emitters[:, 9] > -1.5).any())


def _squares(low: Float, high: Float, columns: int) -> tuple[Long, Long]:
    """Numbers of boxes (n, 2) px and of the squares under them, pair by pair."""
    first = np.floor((low + 0.5) / SQUARE).astype(np.int64)
    last = np.floor((np.maximum(high, low) + 0.5) / SQUARE - 1e-9).astype(np.int64)
    box, place = cells_of_boxes(first, np.maximum(last, first) + 1)
    return box, place[:, 1] * columns + place[:, 0]


def _flat(view: View, triangles: Long) -> Bool:
    """Whether the normals at a triangle's corners are one."""
    low, high = corner_range(view.corners_of(triangles, NORMAL))
    x, y, z = (high - low <= 1e-9).T
    return np.asarray(x & y & z)


def _smooth(view: View, lighting: Lighting, triangles: Long, tolerance: float) -> Bool:
    """Whether light is linear over the tiles of flat triangles, by their distance from the lamps.

    With both cosines over the square of the distance r, the second derivative along a plane is
    at most 11 / r^2 of the light on a face turned to the lamp; linear interpolation over a length
    is off by an eighth of that times the length squared.
    """
    T = view.camera.camera_from_world
    corners = view.corners_of(triangles)
    world, depth = corners[:, :, :3] @ T[:3, :3], corners[:, :, 2]
    plane = view.planes_of(triangles).sum(axis=1)
    bends = distortion_map(view.camera)
    side = TILE * (1.0 if bends is None else bends.stretch)
    squares = np.zeros(len(triangles))
    for axis in range(2):  # how far the plane's points move per column and per row, at most
        change = view.rays()[:, axis] - world * plane[:, None, axis, None]
        squares += (side * depth * np.linalg.norm(change, axis=2)).max(axis=1) ** 2
    middle, normal = world.mean(axis=1), corners[:, 0, NORMAL]
    radius = np.linalg.norm(world - middle[:, None], axis=2).max(axis=1)
    near = np.full(len(triangles), np.inf)
    for row in lighting.emitters[lighting.emitters[:, 8] > 0.0]:
        to = row[:3] - middle
        height = np.abs(np.sum(to * normal, axis=1))
        near = np.minimum(near, np.maximum(height, np.linalg.norm(to, axis=1) - radius))
    return np.asarray(11.0 / 8.0 * squares <= tolerance * near**2)


def _in_plane(view: View, first: np.int64, triangles: Long) -> Bool:
    """Which triangles lie in the plane of the first one and have its normal."""
    corners, one = view.corners_of(triangles), view.corners_of(np.array([first]))[0]
    (normal,) = unit_normals(one[None, :, :3])
    off = np.abs((corners[:, :, :3] - one[0, :3]) @ normal)
    far = np.linalg.norm(corners[:, :, :3], axis=2)
    alike = np.abs(corners[:, 0, NORMAL] - one[0, NORMAL]).max(axis=1)
    return np.asarray((off <= PLANE_TOLERANCE * far).all(axis=1) & (alike <= 1e-9))


class TileLightPass:
    """The tiles of one view on the device."""

    def __init__(self, buffers: SceneBuffers, tiles: LightTiles) -> None:
        camera = buffers.setup.view.camera
        self.buffers, self.tiles = buffers, tiles
        self.shape = (-(-camera.height // TILE), -(-camera.width // TILE))
        count = self.shape[0] * self.shape[1] * len(buffers.setup.bands)
        self.texels = Texels(buffers.device, count, "rgba32float", "light_tiles.light")
        self._owners = buffers.device.buffer(tiles.owner, "light_tiles.owners")
        self._found = False

    def found(self, recording: Recording) -> Texels:
        """The light of all tiles, found with the first band."""
        if not self._found:
            self.record(recording)
            self._found = True
        return self.texels

    def record(self, recording: Recording) -> None:
        """Find the light of all tiles."""
        setup, buffers = self.buffers.setup, self.buffers
        constants = setup.programs.light_constants(False, False)
        name = setup.programs.name("optics/shading/tile_light")
        kernel = buffers.device.kernel(name, constants=constants)
        bindings = kernel.bind_used(
            params={
                "rays": buffers.rays(),
                "columns": self.shape[1],
                "rows": self.shape[0],
                "owner_columns": self.tiles.owner.shape[1],
                "owner_tiles": SQUARE // TILE,
            },
            owners=self._owners,
            light=self.texels,
            **buffers.surface(),
        )
        recording.dispatch(kernel, bindings, threads=(self.shape[0] * self.shape[1],))


def light_tiles_twin(setup: Setup, tiles: LightTiles) -> Float:
    """(rows, columns, bands, 4) coefficients in a view without shadows; 0 where a tile has no
    owner."""
    camera = setup.view.camera
    shape = (-(-camera.height // TILE), -(-camera.width // TILE))
    row, column = np.mgrid[: shape[0], : shape[1]].reshape(2, -1)
    owner = tiles.owner[row // (SQUARE // TILE), column // (SQUARE // TILE)].astype(np.int64)
    owned = np.flatnonzero(owner)
    corners = []
    for j, i in ((0, 0), (0, 1), (1, 0), (1, 1)):
        x, y = (TILE * (column[owned] + i) - 0.5, TILE * (row[owned] + j) - 0.5)
        one, none = np.ones((len(setup.bands), len(owned))), np.zeros(len(owned))
        corners.append(radiance_of(setup, owner[owned] - 1, x, y, one, none))
    a, b, c, d = corners
    result = np.zeros((shape[0] * shape[1], len(setup.bands), 4))
    result[owned] = np.stack([a.T, (b - a).T, (c - a).T, (a - b - c + d).T], axis=2)
    return result.reshape(*shape, len(setup.bands), 4)
