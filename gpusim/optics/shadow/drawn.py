"""Receivers that a frame's passes leave on the device: a band of pixels, and pieces of pixels."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from gpusim.gpu import Buffer, Device, Recording, Texels, Texture
from gpusim.optics.shadow.receivers import DeviceReceivers
from gpusim.optics.shadow.scene import Shadows

__all__ = ["BandReceivers", "PieceReceivers"]


class BandReceivers(DeviceReceivers):
    """The pixels of one band after the other, by the numbers in a texture of ``marks``."""

    def __init__(
        self, device: Device, shadows: Shadows, planes: Texels, marks: Texture, rows: int
    ) -> None:
        super().__init__(device, shadows.occluders, listed=False)
        self.look_through(shadows.view.camera, rows)
        self.planes, self.marks, self.stride = planes, marks, marks.stride // 4
        self.step = 2 if marks.format.startswith("rg") else 1
        self.ids = device.empty(marks.stride * rows, "shadow.ids")

    def record(self, recording: Recording) -> None:
        """Take over who sees what."""
        recording.copy_texture(self.marks, self.ids, self.size[1])


class PieceReceivers(DeviceReceivers):
    """Places for receivers in groups, which begin at ``starts`` (G + 1,); a program fills them."""

    def __init__(self, device: Device, shadows: Shadows, starts: npt.NDArray[np.int64]) -> None:
        super().__init__(device, shadows.occluders, listed=True)
        self.list(starts)
        self.pieces: Buffer = device.kept.take(64 * max(self.count, 1), "shadow.pieces")
