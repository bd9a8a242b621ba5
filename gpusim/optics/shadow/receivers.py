"""Receivers: what asks how much of each lamp it sees.

They are the pixels of a picture, in tiles of 8 x 8, or listed places, such as pieces of pixels on
edges, in groups of neighbours. An *entry* is what is searched for together: of a group those that
lie nearer, and those that lie farther where depths differ.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from gpusim.arrays.array_types import Float, Long
from gpusim.arrays.ragged import expand
from gpusim.gpu import Buffer, Device, Texels, Uniform
from gpusim.optics.camera.pinhole import Camera
from gpusim.optics.camera.undistortion_table import distortion_map
from gpusim.optics.geometry.view import View
from gpusim.optics.shadow.occluders import NO_OCCLUDER, Occluders

TILE = 8

MOST = TILE * TILE
"""Receivers of a group."""

NO_OWNER, LEAN = 0xFFFFFF, 255.0 / 1.5
"""Of `plane_words`, as in ``shaders/optics/shadow/plane_words.wgsl``."""

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

    at: Float
    normal: Float
    across: Float
    down: Float
    on: Long
    start: Long | None = None

    def __getitem__(self, rows: Any) -> Receivers:
        """Some of them, each by itself."""
        return Receivers(
            self.at[rows], self.normal[rows], self.across[rows], self.down[rows], self.on[rows]
        )

    @property
    def starts(self) -> Long:
        """``start``, of every one where there are no groups."""
        return np.arange(len(self.at) + 1) if self.start is None else self.start

    def upright(self) -> Float:
        """(n, 3): unit normals of the planes in which the places change."""
        up = np.cross(self.across, self.down)
        size = np.linalg.norm(up, axis=1)
        up = np.where(
            size[:, None] > 0.0, up / np.where(size > 0.0, size, 1.0)[:, None], self.normal
        )
        return np.where(np.sum(up * self.normal, axis=1)[:, None] > 0.0, up, -up)


def group_starts(size: Long) -> Long:
    """(G + 1,): where groups begin, and the last one ends, that divide parts of ``size`` (n,), one
    after the other, into `MOST` at most."""
    parts = -(-size // MOST)
    owner, place = expand(parts)
    return np.append((np.cumsum(size) - size)[owner] + MOST * place, size.sum())


@dataclass(frozen=True, eq=False)
class PixelReceivers:
    """The pixels of a picture.

    ``ids`` (H, W) uint32: triangle of the view + 1 that each sees; ``planes`` (T, 3): of each
    triangle n / d of its plane n x = d, relative to the eye; ``on`` (T,): its occluder, or -1.
    """

    camera: Camera
    ids: npt.NDArray[np.uint32]
    planes: Float
    on: Long

    @staticmethod
    def of(view: View, ids: npt.NDArray[np.uint32], occluders: Occluders) -> PixelReceivers:
        """Those of a view."""
        on = occluders.owner[view.source].astype(np.int64)
        return PixelReceivers(view.camera, ids, PixelReceivers.planes_of(view), on)

    @staticmethod
    def planes_of(view: View) -> Float:
        """``planes`` of a view."""
        rays = view.camera.camera_from_world[:3, :3].T @ view.camera.ray_matrix()
        result: Float = view.planes_of(slice(None)).sum(axis=1) @ np.linalg.inv(rays)
        return result

    def receivers(self) -> tuple[Long, Receivers]:
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


def plane_words(on: Long, lean: Float) -> npt.NDArray[np.uint32]:
    """(T,): in 24 bits the occluder that each triangle of a view is part of, -1 for none, and in
    the others how far normals for shading ``lean`` from its own."""
    steps = np.where(lean > 1e-4, np.minimum(np.ceil(lean * LEAN), 255.0), 0.0)
    owner = np.where(on >= 0, on, NO_OWNER).astype(np.uint32)
    return owner | steps.astype(np.uint32) << np.uint32(24)


def lens_constants(camera: Camera) -> dict[str, float]:
    """What programs that look along pixels' rays are compiled for."""
    return {"distorted": float(camera.lens is not None), "aperture": camera.pixel_side}


class DeviceReceivers:
    """Receivers on a device, `most_groups` and `most` of them at a time: programs are bound to them
    once."""

    def __init__(
        self, device: Device, occluders: Occluders, listed: bool, groups: int, count: int
    ) -> None:
        self.device, self.listed, self.leaves = device, listed, occluders.leaves
        self.most_groups, self.most = max(groups, 1), max(count, 1)
        self.groups, self.count = groups, count
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
        self.constants = {"distorted": 0.0}
        words = self.most_groups + 1 + self.most if listed else 2 * self.most_groups
        self.halves = device.empty(4 * words, "shadow.halves")
        self.cells = device.empty(128 * self.most_groups, "shadow.cells")
        self._rays = {key: np.zeros(4) for key in ("x", "y", "one")}
        self._capacity = 0
        self._uniform: Uniform | None = None

    @property
    def kind(self) -> dict[str, float]:
        """Constants of programs that look at these receivers again and again."""
        return {**self.constants, "listed": float(self.listed)}

    @property
    def entries(self) -> int:
        """Twice the groups."""
        return 2 * self.groups

    def _numbers(self) -> dict[str, object]:
        return {
            **self._rays, "size": np.array(self.size, np.uint32), "columns": self.columns,
            "groups": self.groups, "capacity": self._capacity, "leaves": self.leaves,
            "count": self.count, "row0": self.row0, "stride": self.stride, "step": self.step,
            "listed": int(self.listed),
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


class DeviceList(DeviceReceivers):
    """Listed receivers, which a program may fill in, in groups that begin at ``starts`` (G + 1,);
    the last number is their count."""

    def __init__(
        self, device: Device, occluders: Occluders, starts: Long, camera: Camera | None = None
    ) -> None:
        super().__init__(device, occluders, True, len(starts) - 1, int(starts[-1]))
        if camera is not None:  # programs that work for its pixels, too, are compiled once
            self.constants = lens_constants(camera)
        self.pieces: Buffer = device.empty(64 * self.most, "shadow.pieces")
        self.halves.write(starts.astype(np.uint32))

    @staticmethod
    def of(device: Device, receivers: Receivers, occluders: Occluders) -> DeviceList:
        """Those of a list."""
        result = DeviceList(device, occluders, receivers.starts)
        result.fill(receivers)
        return result

    def fill(self, receivers: Receivers) -> None:
        """Let them be these."""
        self.source = receivers
        rows = np.zeros((self.count, 4, 4), np.float32)
        for k, values in enumerate(
            (receivers.at, receivers.normal, receivers.across, receivers.down)
        ):
            rows[:, k, :3] = values
        on = np.where(receivers.on >= 0, receivers.on, NO_OCCLUDER).astype(np.uint32)
        rows[:, 0, 3] = on.view(np.float32)
        if self.count:
            self.pieces.write(rows)


class DevicePixels(DeviceReceivers):
    """The pixels that a camera sees, in one band of ``rows`` at most after the other; ``ids`` and
    ``planes`` as in ``shaders/optics/shadow/receiver.wgsl``."""

    def __init__(
        self, device: Device, occluders: Occluders, camera: Camera, rows: int, planes: Texels,
        ids: Buffer, stride: int, step: int = 1,
    ) -> None:  # fmt: skip
        columns = -(-camera.width // TILE)
        groups = columns * -(-rows // TILE)
        super().__init__(device, occluders, False, groups, camera.width * rows)
        self.columns, self.planes, self.ids = columns, planes, ids
        self.stride, self.step = stride, step
        self._width, bends = camera.width, distortion_map(camera)
        if bends is not None:
            self.bends, texels = bends.tiles(), bends.texels()
            self.undistortion = device.texels(len(texels), "rgba32float", "shadow.bends")
            self.undistortion.write(texels)
        self.constants = lens_constants(camera)
        rays = camera.camera_from_world[:3, :3].T @ camera.ray_matrix()
        self._rays = {key: np.array([*rays[:, k], 0.0]) for k, key in enumerate(("x", "y", "one"))}
        self.aim(0, rows)

    @staticmethod
    def of(device: Device, receivers: PixelReceivers, occluders: Occluders) -> DevicePixels:
        """Those of a whole picture."""
        camera = receivers.camera
        words = np.empty((len(receivers.planes), 4), np.uint32)
        words[:, :3] = receivers.planes.astype(np.float32).view(np.uint32)
        words[:, 3] = plane_words(receivers.on, np.zeros(len(words)))
        planes = device.texels(len(words), "rgba32uint", "shadow.planes")
        planes.write(words)
        ids = device.buffer(receivers.ids, "shadow.ids")
        result = DevicePixels(device, occluders, camera, camera.height, planes, ids, camera.width)
        result.source = receivers
        return result

    def aim(self, row0: int, rows: int) -> None:
        """Take the pixels of these rows."""
        self.size, self.row0 = (self._width, rows), row0
        self.groups, self.count = self.columns * -(-rows // TILE), self._width * rows
        if self._uniform is not None:  # from the next submit on
            self._uniform.update(self._numbers())


def on_device(
    device: Device, receivers: Receivers | PixelReceivers, occluders: Occluders
) -> DeviceReceivers:
    """Receivers of either kind."""
    if isinstance(receivers, Receivers):
        return DeviceList.of(device, receivers, occluders)
    return DevicePixels.of(device, receivers, occluders)
