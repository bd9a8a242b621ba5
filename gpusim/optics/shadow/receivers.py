"""Receivers: what asks how much of each lamp it sees, and what a group of them has in common.

They are the pixels of a picture in tiles of 8 x 8, or single pieces of pixels on edges, which lie
in no pixel's middle and so have a group each. An *entry* is what is searched for together: of a
tile's pixels those that lie nearer, and those that lie farther where depths differ.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from gpusim.gpu import Device, Uniform
from gpusim.optics.camera import Camera
from gpusim.optics.distortion_map import distortion_map
from gpusim.optics.shadow.light_space import LightSpace
from gpusim.optics.shadow.occluders import NOBODY, Occluders
from gpusim.optics.view import View
from gpusim.surface.surface import Surface

__all__ = ["TILE", "DeviceReceivers", "PixelReceivers", "Receivers", "entries_of"]

Array = npt.NDArray[np.float64]
Numbers = npt.NDArray[np.int64]

TILE = 8

APART = 1.01
"""Depths in a tile that differ by this factor are two entries."""


@dataclass(frozen=True, eq=False)
class Receivers:
    """Single receivers.

    ``at`` (n, 3): places relative to the eye; ``normal`` (n, 3) unit, as light is reflected;
    ``across``, ``down`` (n, 3): how the places change over the pixel, or the piece of one;
    ``on`` (n,): the occluder that each lies on, -1 for none.
    """

    at: Array
    normal: Array
    across: Array
    down: Array
    on: Numbers

    def __getitem__(self, rows: Any) -> Receivers:
        return Receivers(
            self.at[rows], self.normal[rows], self.across[rows], self.down[rows], self.on[rows]
        )

    def upright(self) -> Array:
        """(n, 3): unit normals of the planes in which the places change."""
        up = np.cross(self.across, self.down)
        size = np.linalg.norm(up, axis=1)
        up = np.where(
            size[:, None] > 0.0, up / np.where(size > 0.0, size, 1.0)[:, None], self.normal
        )
        return np.where(np.sum(up * self.normal, axis=1)[:, None] > 0.0, up, -up)


@dataclass(frozen=True, eq=False)
class PixelReceivers:
    """The pixels of a picture.

    ``ids`` (H, W) uint32: triangle of the view + 1 that each sees; ``planes`` (T, 3): of each
    triangle n / d of its plane n x = d, relative to the eye; ``on`` (T,): its occluder, or -1.
    """

    camera: Camera
    ids: npt.NDArray[np.uint32]
    planes: Array
    on: Numbers

    @staticmethod
    def of(
        view: View, ids: npt.NDArray[np.uint32], surfaces: Sequence[Surface], occluders: Occluders
    ) -> PixelReceivers:
        """Those of a view of ``surfaces``."""
        planes, own = (
            PixelReceivers.planes_of(view),
            PixelReceivers.owners(view, surfaces, occluders),
        )
        return PixelReceivers(view.camera, ids, planes, own)

    @staticmethod
    def planes_of(view: View) -> Array:
        """``planes`` of a view."""
        rays = view.camera.camera_from_world[:3, :3].T @ view.camera.ray_matrix()
        result: Array = view.planes_of(slice(None)).sum(axis=1) @ np.linalg.inv(rays)
        return result

    @staticmethod
    def owners(view: View, surfaces: Sequence[Surface], occluders: Occluders) -> Numbers:
        """(T,): the occluder that each triangle of a view is part of."""
        faces = np.cumsum([0, *(len(surface.faces) for surface in surfaces)])
        first = np.cumsum([0, *(len(surface.topology.triangles) for surface in surfaces)])
        result = np.empty(view.count, np.int64)
        eye = view.camera.eye
        turn = view.camera.camera_from_world[:3, :3]
        for number, surface in enumerate(surfaces):
            own = np.flatnonzero(view.body == number)
            topology = surface.topology
            face = view.face[own] - faces[number]
            start = np.searchsorted(topology.source, face)
            last = np.searchsorted(topology.source, face, side="right") - 1
            # of a quad's halves that on whose side of the diagonal the middle is
            a, b, c = (surface.points[topology.triangles[start, k]] for k in range(3))
            middle = view.corners_of(own, slice(0, 3)).mean(axis=1) @ turn + eye
            diagonal = c - a
            one, other = np.cross(diagonal, middle - a), np.cross(diagonal, b - a)
            result[own] = np.where(np.sum(one * other, axis=1) >= 0.0, start, last) + first[number]
        return occluders.rank[result]

    def receivers(self) -> tuple[Numbers, Receivers]:
        """Indices (n,) of the pixels that see something, and these one by one."""
        camera = self.camera
        pixel = np.flatnonzero(self.ids)
        place = np.stack([pixel % camera.width, pixel // camera.width], axis=1)
        at, change = place.astype(np.float64), np.broadcast_to(np.eye(2), (len(pixel), 2, 2))
        bends = distortion_map(camera)
        if bends is not None:
            shift, change = bends.evaluate(place, np.zeros((len(pixel), 2)))
            at = at + shift
        rays = camera.camera_from_world[:3, :3].T @ camera.ray_matrix()
        triangle = self.ids.reshape(-1)[pixel].astype(np.int64) - 1
        m = self.planes[triangle]
        ray = at @ rays[:, :2].T + rays[:, 2]
        rate = 1.0 / np.sum(m * ray, axis=1)
        x = rate[:, None] * ray
        sides = camera.pixel_side * np.einsum("ab,nbk->nka", rays[:, :2], change)
        changes = rate[:, None, None] * (
            sides - x[:, None] * np.einsum("na,nka->nk", m, sides)[..., None]
        )
        normal = -m / np.linalg.norm(m, axis=1)[:, None]
        return pixel, Receivers(x, normal, changes[:, 0], changes[:, 1], self.on[triangle])


class DeviceReceivers:
    """Receivers of one kind on a device."""

    def __init__(
        self, device: Device, receivers: Receivers | PixelReceivers, occluders: Occluders
    ) -> None:
        self.device = device
        self.listed = isinstance(receivers, Receivers)
        self.size, self.columns = (1, 1), 1
        self.ids = device.buffer(np.zeros(4, np.uint32), "shadow.no_ids")
        self.pieces = device.buffer(np.zeros(4, np.float32), "shadow.no_pieces")
        self.planes = device.no_texels("rgba32uint")
        self.undistortion = device.no_texels("rgba32float")
        self.bends: dict[str, object] = {
            "last": np.zeros(2), "middle": np.zeros(2), "size": 1, "columns": 1,
        }  # fmt: skip
        self.constants = {"listed": 1.0, "distorted": 0.0}
        self.row0, self.stride, self.step = 0, 1, 1
        self._capacity = 0
        self._uniform: Uniform | None = None
        self._rays = {key: np.zeros(4) for key in ("x", "y", "one")}
        if isinstance(receivers, Receivers):
            self.count = self.groups = self.entries = len(receivers.at)
            rows = np.zeros((max(self.count, 1), 4, 4), np.float32)
            for k, values in enumerate(
                (receivers.at, receivers.normal, receivers.across, receivers.down)
            ):
                rows[: self.count, k, :3] = values
            on = np.where(receivers.on >= 0, receivers.on, NOBODY).astype(np.uint32)
            rows[: self.count, 0, 3] = on.view(np.float32)
            self.pieces = device.buffer(rows, "shadow.pieces")
        else:
            camera = receivers.camera
            self._look_through(camera)
            self.size, self.stride = (camera.width, camera.height), camera.width
            self.groups = self.columns * -(-camera.height // TILE)
            self.entries, self.count = 2 * self.groups, camera.width * camera.height
            self.ids = device.buffer(receivers.ids, "shadow.ids")
            rows = np.empty((len(receivers.planes), 4), np.uint32)
            rows[:, :3] = receivers.planes.astype(np.float32).view(np.uint32)
            rows[:, 3] = np.where(receivers.on >= 0, receivers.on, NOBODY)
            self.planes = device.texels(len(rows), "rgba32uint", "shadow.planes")
            self.planes.write(rows)
        self._leaves = occluders.leaves
        self.groups_of = device.empty(48 * max(self.entries, 1), "shadow.groups")

    def _look_through(self, camera: Camera) -> None:
        """Let receivers be pixels of a camera."""
        self.listed, self.columns = False, -(-camera.width // TILE)
        bends = distortion_map(camera)
        if bends is not None:
            self.bends, texels = bends.tiles(), bends.texels()
            self.undistortion = self.device.texels(len(texels), "rgba32float", "shadow.bends")
            self.undistortion.write(texels)
        rays = camera.camera_from_world[:3, :3].T @ camera.ray_matrix()
        self._rays = {key: np.array([*rays[:, k], 0.0]) for k, key in enumerate(("x", "y", "one"))}
        self.constants = {
            "listed": 0.0, "distorted": float(bends is not None), "aperture": camera.pixel_side,
        }  # fmt: skip

    def _numbers(self) -> dict[str, object]:
        return {
            **self._rays, "size": np.array(self.size, np.uint32), "columns": self.columns,
            "groups": self.groups, "capacity": self._capacity, "leaves": self._leaves,
            "count": self.count, "row0": self.row0, "stride": self.stride, "step": self.step,
        }  # fmt: skip

    def update(self) -> None:
        """Other numbers from the next submit on."""
        if self._uniform is not None:
            self._uniform.update(self._numbers())

    def bindings(self, capacity: int) -> dict[str, Any]:
        """By their WGSL names; ``capacity``: chunks in the pool."""
        if self._uniform is None or capacity != self._capacity:
            self._capacity = capacity
            self._uniform = Uniform(self.device, self._numbers(), "shadow.receivers")
        return {
            "receivers": self._uniform, "ids": self.ids,
            "planes": self.planes, "pieces": self.pieces, "groups_of": self.groups_of,
            "tiles": Uniform(self.device, self.bends, "shadow.tiles"),
            "undistortion": self.undistortion,
        }  # fmt: skip

    def entry(self, tiles: str = "tiles_of_pixels", pieces: str = "pieces_alone") -> str:
        """Name of an entry point for this kind."""
        return pieces if self.listed else tiles


def entries_of(
    receivers: Receivers | PixelReceivers, space: LightSpace
) -> tuple[Numbers, Receivers, Numbers, int]:
    """Index (n,) and place of the receivers that ask, the entry (n,) that each is in, and the
    number of entries."""
    if isinstance(receivers, Receivers):
        asking = np.flatnonzero(space.asks(receivers.at, receivers.normal))
        return asking, receivers[asking], asking, len(receivers.at)
    camera = receivers.camera
    pixel, every = receivers.receivers()
    columns = -(-camera.width // TILE)
    groups = columns * -(-camera.height // TILE)
    row, column = np.divmod(pixel, camera.width)
    tile = row // TILE * columns + column // TILE
    depth = every.at @ camera.camera_from_world[2, :3]
    near, far = np.full(groups, np.inf), np.zeros(groups)
    np.minimum.at(near, tile, depth)
    np.maximum.at(far, tile, depth)
    asking = np.flatnonzero(space.asks(every.at, every.normal))
    pixel, every, tile, depth = pixel[asking], every[asking], tile[asking], depth[asking]
    # a tile within one triangle is one
    every_tile = np.arange(receivers.ids.size)
    every_tile = every_tile // camera.width // TILE * columns + every_tile % camera.width // TILE
    least, most = np.full(groups, 1 << 60), np.full(groups, -1)
    np.minimum.at(least, every_tile, receivers.ids.reshape(-1))
    np.maximum.at(most, every_tile, receivers.ids.reshape(-1))
    full = np.bincount(every_tile, minlength=groups) == TILE * TILE
    alike = (least == most) & full & (camera.lens is None)
    alike &= np.isin(np.bincount(tile, minlength=groups), (0, TILE * TILE))
    split = np.where((far > APART * near) & ~alike, 0.5 * (near + far), np.inf)
    return pixel, every, tile + groups * (depth > split[tile]), 2 * groups
