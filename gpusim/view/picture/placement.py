"""Where a picture lies in the window."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from gpusim.optics.camera.pinhole import Camera

__all__ = ["Placement"]

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Placement:
    """Where a picture lies in the window: its top left corner, px, and the size of its pixels."""

    x: float = 0.0
    y: float = 0.0
    scale: float = 1.0

    @staticmethod
    def fit(camera: Camera, width: float, height: float) -> Placement:
        """A camera's image in the middle of a window, as large as fits.

        Examples
        --------
        >>> from gpusim.view.picture.placement import Placement
        >>> camera = gs.Camera.from_lens((36, 24), 50, (600, 400), (0, 0, 2), (0, 0, 0), (0, 1, 0))
        >>> Placement.fit(camera, 300, 300)
        Placement(x=0.0, y=50.0, scale=0.5)
        """
        scale = min(width / camera.width, height / camera.height)
        x, y = 0.5 * (width - scale * camera.width), 0.5 * (height - scale * camera.height)
        return Placement(x, y, scale)

    def window(self, pixels: Array) -> Array:
        """Pixel coordinates of the camera (…, 2) as places in the window, px from its corner."""
        result: Array = (self.x, self.y) + self.scale * (pixels + 0.5)
        return result

    def pixels(self, places: npt.ArrayLike) -> Array:
        """The inverse of `window`."""
        result: Array = (np.asarray(places, np.float64) - (self.x, self.y)) / self.scale - 0.5
        return result
