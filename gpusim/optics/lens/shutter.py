"""Exposure in time: moments of the exposure, and rows that are exposed one after the other."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from gpusim.errors import InputError
from gpusim.optics.camera.pinhole import Camera
from gpusim.surface.surface import Surface
from gpusim.validation import checked

__all__ = ["CameraAt", "Shutter", "SurfacesAt", "moments", "moments_for", "motion"]

Array = npt.NDArray[np.float64]
SurfacesAt = Callable[[float], Sequence[Surface]]
CameraAt = Callable[[float], Camera]

STILL = 0.02
"""px; a motion below this during the exposure is left out."""
POINTS_PER_PX = 3.2
MAX_MOMENTS = 256


@checked
@dataclass(frozen=True)
class Shutter:
    """When the pixels collect light; times in s.

    Row r collects from time + r x ``line_time`` on for ``exposure_time``; a ``line_time`` of 0 is a
    global shutter, a negative one reads from the bottom up. ``samples``: moments that the exposure
    is averaged over, unless the motion decides.

    Examples
    --------
    >>> gs.Shutter(exposure_time=1e-3, line_time=5e-6).line_time
    5e-06
    """

    exposure_time: float = 0.0
    line_time: float = 0.0
    samples: int | None = None

    def __post_init__(self) -> None:
        if not (np.isfinite(self.exposure_time) and self.exposure_time >= 0.0):
            raise InputError(f"Shutter exposure_time; got {self.exposure_time}; expected from 0 up")
        if not np.isfinite(self.line_time):
            raise InputError(f"Shutter line_time; got {self.line_time}; expected a finite number")
        if self.samples is not None and not 1 <= self.samples <= 4096:
            raise InputError(f"Shutter samples; got {self.samples}; expected 1 to 4096")


def motion(surfaces: SurfacesAt, camera: CameraAt, start: float, length: float) -> float:
    """The longest way in px that a vertex in view goes on the image within a time."""
    times = start + length * np.linspace(0.0, 1.0, 5)
    longest = np.zeros(0)
    before: list[Array] | None = None
    for time in times:
        lens = camera(float(time))
        at = [lens.project(s.points) for s in surfaces(float(time))]
        if before is not None:
            steps = [_seen_step(a, b, lens) for a, b in zip(before, at, strict=True)]
            step = np.concatenate(steps) if steps else np.zeros(0)
            longest = longest + step if len(longest) else step
        before = at
    return float(longest.max(initial=0.0))


def _seen_step(a: Array, b: Array, camera: Camera) -> Array:
    """Lengths (n,) of steps; 0 where a point isn't in front, and no more than the image's size."""
    with np.errstate(invalid="ignore"):
        step = np.hypot(*(b - a).T)
    return np.asarray(np.minimum(np.nan_to_num(step, nan=0.0), camera.width + camera.height))


def moments_for(travel: float) -> int:
    """How many moments have gaps of half a pixel at most, for a motion of ``travel`` px."""
    return 1 if travel <= STILL else int(np.ceil(POINTS_PER_PX * travel)) + 2


def moments(shutter: Shutter, travel: float) -> tuple[Array, Array]:
    """Shares of the exposure (K,) and weights (K,) for a motion of ``travel`` px.

    Gauss-Legendre points, which integrate a motion's transfer function to 1e-6 up to the Nyquist
    frequency, and enough of them (`moments_for`) that edges show no steps; no more than
    MAX_MOMENTS unless the shutter's ``samples`` say so.
    """
    count = shutter.samples or min(moments_for(travel), MAX_MOMENTS)
    if shutter.exposure_time == 0.0:
        count = 1
    nodes, weights = np.polynomial.legendre.leggauss(count)
    return 0.5 + 0.5 * nodes, 0.5 * weights
