"""Fall-off of the irradiance from the image's centre to its corners."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import scipy

from gpusim.errors import InputError
from gpusim.field_summary import field_summary
from gpusim.optics.camera.pinhole import Camera
from gpusim.validation import checked

__all__ = ["Vignetting"]

Array = npt.NDArray[np.float64]


@checked
@dataclass(frozen=True, eq=False)
class Vignetting:
    """The product of what is given.

    Parameters
    ----------
    cos4 : the natural law, cos^4 of the angle between a pixel's ray in image space and the axis.
    polynomial : (a1, a2, …) of 1 + a1 r^2 + a2 r^4 + …, r = 1 at half the image's diagonal from
        the principal point.
    map : (rows, columns) measured gains, corners on the corner pixels' centres, linear between.

    Examples
    --------
    >>> camera = gs.Camera.from_lens((36, 24), 50, (6, 4), (0, 0, 2), (0, 0, 0), up=(0, 1, 0))
    >>> gains = gs.Vignetting(cos4=True).gains(camera, row0=0, rows=4)
    >>> gains.shape, bool(gains[0, 0] < gains[2, 3])
    ((4, 6), True)
    """

    cos4: bool = True
    polynomial: tuple[float, ...] = ()
    map: Array | None = None
    __repr__ = field_summary

    def __post_init__(self) -> None:
        if not np.isfinite(np.asarray(self.polynomial, np.float64)).all():
            raise InputError(f"Vignetting polynomial; got {self.polynomial}; expected numbers")
        if self.map is not None:
            gains = np.asarray(self.map, np.float64)
            if gains.ndim != 2 or min(gains.shape) < 2 or not (gains >= 0.0).all():
                raise InputError(
                    f"Vignetting map; got shape {gains.shape}; expected at least 2 x 2 gains from 0"
                )
            object.__setattr__(self, "map", gains)

    def gains(self, camera: Camera, row0: int, rows: int) -> Array:
        """(rows, width) factors of rows ``row0`` … of an image."""
        x = np.arange(camera.width, dtype=np.float64)
        y = np.arange(row0, row0 + rows, dtype=np.float64)[:, None]
        result = np.ones((rows, camera.width))
        K = camera.K
        if self.cos4:
            v = (y - K[1, 2]) / K[1, 1]
            u = (x - K[0, 2] - K[0, 1] * v) / K[0, 0]
            result /= (1.0 + u * u + v * v) ** 2
        if self.polynomial:
            half = 0.25 * (camera.width**2 + camera.height**2)
            square = ((x - K[0, 2]) ** 2 + (y - K[1, 2]) ** 2) / half
            result *= np.polynomial.polynomial.polyval(square, [1.0, *self.polynomial])
        if self.map is not None:
            down = (self.map.shape[0] - 1) / max(camera.height - 1, 1)
            across = (self.map.shape[1] - 1) / max(camera.width - 1, 1)
            at = np.broadcast_arrays(y * down, x * across)
            result *= scipy.ndimage.map_coordinates(self.map, at, order=1, mode="nearest")
        if not result.min() >= 0.0:
            raise InputError("Vignetting: its gain falls below 0 inside the image")
        return result
