"""Receivers: what asks how much of each lamp it sees.

They are the pixels of a picture, in tiles of 8 x 8, or listed places, such as pieces of pixels on
edges, in groups of neighbours. An *entry* is what is searched for together: of a group those that
lie nearer, and those that lie farther where depths differ.
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
from gpusim.optics.shadow.occluders import NOBODY, Occluders
from gpusim.optics.view import View
from gpusim.surface.surface import Surface

__all__ = [
    "APART",
    "MOST",
    "TILE",
    "DeviceReceivers",
    "PixelReceivers",
    "Receivers",
    "group_starts",
    "plane_words",
]

Array = npt.NDArray[np.float64]
Numbers = npt.NDArray[np.int64]

TILE = 8

MOST = TILE * TILE
"""Receivers of a group."""

NO_OWNER, LEAN = 0xFFFFFF, 255.0 / 1.5
"""Of `plane_words`, as in ``shaders/optics/shadow/receiver.wgsl``."""

APART = 1.01
"""Depths in a group that differ by this factor are two entries."""


@dataclass(frozen=True, eq=False)
class Receivers:
    """Listed receivers.

    ``at`` (n, 3): places relative to the eye; ``normal`` (n, 3) unit, as light is reflected;
    ``across``, ``down`` (n, 3): how the places change over the pixel, or the piece of one;
    ``on`` (n,): the occluder that each lies on, -1 for none. ``start`` (G + 1,): where groups of
    at most `MOST` neighbours begin, and the last one ends; None: each is by itself.
    """

    at: Array
    normal: Array
    across: Array
    down: Array
    on: Numbers
    start: Numbers | None = None

    def __getitem__(self, rows: Any) -> Receivers:
        """Some of them, each by itself."""
        return Receivers(
            self.at[rows], self.normal[rows], self.across[rows], self.down[rows], self.on[rows]
        )

    @property
    def starts(self) -> Numbers:
        """``start``, of every one where there are no groups."""
        return np.arange(len(self.at) + 1) if self.start is None else self.start

    def upright(self) -> Array:
        """(n, 3): unit normals of the planes in which the places change."""
        up = np.cross(self.across, self.down)
        size = np.linalg.norm(up, axis=1)
        up = np.where(
            size[:, None] > 0.0, up / np.where(size > 0.0, size, 1.0)[:, None], self.normal
        )
        return np.where(np.sum(up * self.normal, axis=1)[:, None] > 0.0, up, -up)


def group_starts(size: Numbers) -> Numbers:
    """(G + 1,): where groups begin, and the last one ends, that divide parts of ``size`` (n,), one
    after the other, into `MOST` at most."""
    parts = -(-size // MOST)
    first = np.repeat(np.cumsum(size) - size, parts)
    place = np.arange(len(first)) - np.repeat(np.cumsum(parts) - parts, parts)
    return np.append(first + MOST * place, size.sum())


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


def plane_words(on: Numbers, lean: Array) -> npt.NDArray[np.uint32]:
    """(T,): in 24 bits the occluder that each triangle of a view is part of, -1 for none, and in
    the others how far normals for shading ``lean`` from its own."""
    steps = np.where(lean > 1e-4, np.minimum(np.ceil(lean * LEAN), 255.0), 0.0)
    owner = np.where(on >= 0, on, NO_OWNER).astype(np.uint32)
    return owner | steps.astype(np.uint32) << np.uint32(24)


class DeviceReceivers:
    """Receivers of one kind on a device: pixels of one band after the other, or a list."""

    def __init__(self, device: Device, occluders: Occluders, listed: bool) -> None:
        self.device, self.listed, self.leaves = device, listed, occluders.leaves
        self.source: Receivers | PixelReceivers | None = None
        self.size, self.columns = (0, 0), 1
        self.row0, self.stride, self.step = 0, 1, 1
        self.ids = device.buffer(np.zeros(4, np.uint32), "shadow.no_ids")
        self.pieces = device.buffer(np.zeros(4, np.float32), "shadow.no_pieces")
        self.planes = device.no_texels("rgba32uint")
        self.undistortion = device.no_texels("rgba32float")
        self.bends: dict[str, object] = {
            "last": np.zeros(2), "middle": np.zeros(2), "size": 1, "columns": 1,
        }  # fmt: skip
        self.constants = {"listed": float(listed), "distorted": 0.0}
        self._capacity = 0
        self._uniform: Uniform | None = None
        self._rays = {key: np.zeros(4) for key in ("x", "y", "one")}

    @staticmethod
    def of(
        device: Device, receivers: Receivers | PixelReceivers, occluders: Occluders
    ) -> DeviceReceivers:
        """Those of a list, or of a whole picture."""
        result = DeviceReceivers(device, occluders, isinstance(receivers, Receivers))
        result.source = receivers
        if isinstance(receivers, Receivers):
            result.list(receivers.starts)
            rows = np.zeros((max(result.count, 1), 4, 4), np.float32)
            for k, values in enumerate(
                (receivers.at, receivers.normal, receivers.across, receivers.down)
            ):
                rows[: result.count, k, :3] = values
            on = np.where(receivers.on >= 0, receivers.on, NOBODY).astype(np.uint32)
            rows[: result.count, 0, 3] = on.view(np.float32)
            result.pieces = device.buffer(rows, "shadow.pieces")
            return result
        result.look_through(receivers.camera, receivers.camera.height)
        result.stride = receivers.camera.width
        result.ids = device.buffer(receivers.ids, "shadow.ids")
        words = np.empty((len(receivers.planes), 4), np.uint32)
        words[:, :3] = receivers.planes.astype(np.float32).view(np.uint32)
        words[:, 3] = plane_words(receivers.on, np.zeros(len(words)))
        result.planes = device.texels(len(words), "rgba32uint", "shadow.planes")
        result.planes.write(words)
        return result

    def list(self, starts: Numbers) -> None:
        """Let receivers be listed in groups that begin there; the last number is their count."""
        self.count, self.groups = int(starts[-1]), len(starts) - 1
        words = np.zeros(self.groups + 1 + max(self.count, 1), np.uint32)
        words[: self.groups + 1] = starts
        self.halves = self.device.buffer(words, "shadow.halves")
        self.cells = self.device.empty(96 * max(self.groups, 1), "shadow.cells")

    def look_through(self, camera: Camera, rows: int) -> None:
        """Let receivers be pixels of a camera, in bands of so many rows at most."""
        self.columns = -(-camera.width // TILE)
        self.aim(camera.width, 0, rows)
        bends = distortion_map(camera)
        if bends is not None:
            self.bends, texels = bends.tiles(), bends.texels()
            self.undistortion = self.device.texels(len(texels), "rgba32float", "shadow.bends")
            self.undistortion.write(texels)
        rays = camera.camera_from_world[:3, :3].T @ camera.ray_matrix()
        self._rays = {key: np.array([*rays[:, k], 0.0]) for k, key in enumerate(("x", "y", "one"))}
        self.constants |= {"distorted": float(bends is not None), "aperture": camera.pixel_side}
        self.halves = self.device.empty(8 * self.groups, "shadow.halves")
        self.cells = self.device.empty(96 * self.groups, "shadow.cells")

    def aim(self, width: int, row0: int, rows: int) -> None:
        """Take pixels of these rows, of no more than at first."""
        self.size, self.row0 = (width, rows), row0
        self.groups, self.count = self.columns * -(-rows // TILE), width * rows
        if self._uniform is not None:
            self._uniform.update(self._numbers())

    @property
    def entries(self) -> int:
        """Twice the groups."""
        return 2 * self.groups

    def _numbers(self) -> dict[str, object]:
        return {
            **self._rays, "size": np.array(self.size, np.uint32), "columns": self.columns,
            "groups": self.groups, "capacity": self._capacity, "leaves": self.leaves,
            "count": self.count, "row0": self.row0, "stride": self.stride, "step": self.step,
        }  # fmt: skip

    def bindings(self, capacity: int) -> dict[str, Any]:
        """By their WGSL names; ``capacity``: chunks in the pool."""
        if self._uniform is None or capacity != self._capacity:
            self._capacity = capacity
            self._uniform = Uniform(self.device, self._numbers(), "shadow.receivers")
        return {
            "receivers": self._uniform, "ids": self.ids, "planes": self.planes,
            "pieces": self.pieces, "halves": self.halves, "cells": self.cells,
            "tiles": Uniform(self.device, self.bends, "shadow.tiles"),
            "undistortion": self.undistortion,
        }  # fmt: skip
