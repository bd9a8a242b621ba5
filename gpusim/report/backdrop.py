"""A picture behind a drawing, as large as the page that it is drawn on."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from matplotlib.artist import Artist

__all__ = ["Backdrop"]


class Backdrop(Artist):
    """A grey picture over the whole page, put there as it is: no colours to map, no resampling.

    ``grey`` (H, W) uint8, the page's pixels, the upper row first.
    """

    def __init__(self, grey: npt.NDArray[np.uint8]) -> None:
        super().__init__()
        self.set_zorder(-1)
        self._grey = grey

    def draw(self, renderer: Any) -> None:
        """Put it onto the page."""
        opaque = np.full((*self._grey.shape, 4), 255, np.uint8)
        opaque[..., :3] = self._grey[::-1, :, None]
        context = renderer.new_gc()
        renderer.draw_image(context, 0, 0, opaque)
        context.restore()
