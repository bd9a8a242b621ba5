"""Where a picture lies in the window."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from gpusim.arrays.array_types import Float


@dataclass(frozen=True)
class Placement:
    """Where a picture lies in the window: its top left corner, px, and the size of its pixels."""

    x: float = 0.0
    y: float = 0.0
    scale: float = 1.0

    def window(self, pixels: Float) -> Float:
        """Pixel coordinates of the camera (…, 2) as places in the window, px from its corner."""
        result: Float = (self.x, self.y) + self.scale * (pixels + 0.5)
        return result

    def pixels(self, places: npt.ArrayLike) -> Float:
        """The inverse of `window`."""
        result: Float = (np.asarray(places, np.float64) - (self.x, self.y)) / self.scale - 0.5
        return result
