"""Receivers that a frame's passes leave on the device: a band of pixels, and pieces of pixels."""

from __future__ import annotations

import numpy as np

from gpusim.gpu import Buffer, Device, Recording, Texels, Texture
from gpusim.optics.shadow.receivers import TILE, DeviceReceivers, Receivers
from gpusim.optics.shadow.scene import Shadows

__all__ = ["BandReceivers", "PieceReceivers"]

NOWHERE = np.zeros((0, 3))
NO_RECEIVERS = Receivers(NOWHERE, NOWHERE, NOWHERE, NOWHERE, np.zeros(0, np.int64))


class BandReceivers(DeviceReceivers):
    """The pixels of one band after the other, by the numbers in a texture of ``marks``."""

    def __init__(
        self, device: Device, shadows: Shadows, planes: Texels, marks: Texture, rows: int
    ) -> None:
        super().__init__(device, NO_RECEIVERS, shadows.occluders)
        self._look_through(shadows.view.camera)
        self.planes, self.marks, self.stride = planes, marks, marks.stride // 4
        self.step = 2 if marks.format.startswith("rg") else 1
        self.ids = device.empty(marks.stride * rows, "shadow.ids")
        self.aim(0, rows)
        self.groups_of = device.empty(48 * max(self.entries, 1), "shadow.groups")

    def aim(self, row0: int, rows: int) -> None:
        """Take this band, of no more rows than the first."""
        width = self.marks.width
        self.size, self.row0 = (width, rows), row0
        self.groups = self.columns * -(-rows // TILE)
        self.entries, self.count = 2 * self.groups, width * rows
        self.update()

    def record(self, recording: Recording) -> None:
        """Take over who sees what."""
        recording.copy_texture(self.marks, self.ids, self.size[1])


class PieceReceivers(DeviceReceivers):
    """So many places for receivers, which a program fills in."""

    def __init__(self, device: Device, shadows: Shadows, count: int) -> None:
        super().__init__(device, NO_RECEIVERS, shadows.occluders)
        self.count = self.groups = self.entries = count
        self.pieces: Buffer = device.kept.take(64 * max(count, 1), "shadow.pieces")
        self.groups_of = device.empty(48 * max(count, 1), "shadow.groups")
