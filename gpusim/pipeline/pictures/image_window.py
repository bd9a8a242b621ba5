"""The part of an image that anything is seen in: a small target needs no whole frame."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from gpusim.optics.camera.pinhole import Camera
from gpusim.optics.geometry.view import look
from gpusim.surface import Surface

MARGIN = 2  # px around the outermost corner


@dataclass(frozen=True)
class Window:
    """Columns ``left`` … ``left + width - 1`` and rows ``top`` … of a camera's image."""

    left: int
    top: int
    width: int
    height: int

    @property
    def box(self) -> tuple[int, int, int, int]:
        """Left, top, right and bottom; the last two just outside."""
        return self.left, self.top, self.left + self.width, self.top + self.height

    def camera(self, whole: Camera) -> Camera:
        """The camera whose image is this part of the one of ``whole``."""
        return whole.reframed(self.width, self.height, (self.left, self.top))

    def placed(self, part: npt.NDArray[Any], whole: Camera) -> npt.NDArray[Any]:
        """The whole image, black around ``part``."""
        image = np.zeros((whole.height, whole.width, *part.shape[2:]), part.dtype)
        image[self.top : self.top + self.height, self.left : self.left + self.width] = part
        return image


def whole_window(camera: Camera) -> Window:
    """The window that is all of the image."""
    return Window(0, 0, camera.width, camera.height)


def window_of(surfaces: Sequence[Surface], camera: Camera, rows: int = 1) -> Window | None:
    """The smallest window with all that ``camera`` sees of ``surfaces``; None for the whole image.

    It begins at a multiple of ``rows``. Also None if the camera sees nothing of them.
    """
    view = look(surfaces, camera, lit=False)
    if not view.count:
        return None
    size = np.array([camera.width, camera.height])
    corners = view.screen.reshape(-1, 2)
    low = np.clip(np.floor(corners.min(axis=0)) - MARGIN, 0, size - 1).astype(int)
    low[1] -= low[1] % rows
    high = np.clip(np.ceil(corners.max(axis=0)) + MARGIN + 1, low + 1, size).astype(int)
    width, height = (int(v) for v in high - low)
    if not width * height < 0.7 * camera.width * camera.height:
        return None
    if height & (height - 1) == 0:  # a software rasteriser slows down at powers of two
        height += 1 if low[1] + height < camera.height else -1
    if height < 1 or width < 1:
        return None
    return Window(int(low[0]), int(low[1]), width, height)
