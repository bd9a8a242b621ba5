"""Independent float64 reference images: 64 x 64 rays a pixel against plane shapes.

Nothing here uses gpusim's view, patterns or coverage: a ray is met with each plane, the nearest
hit decides, and the shape says its albedo (or radiance) at that point.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from gpusim.optics import Camera
from gpusim.surface.paint import Checker, Dots

Array = npt.NDArray[np.float64]
SAMPLES = 64
_AT_ONCE = 8
"""Rows of them: more would not fit the caches."""
# rows of samples are shifted against each other, so that no edge direction runs along the lattice;
# the shifts average to 1/2, so that the samples' mean is the pixel's centre
SHIFT = ((np.arange(SAMPLES) * 27) % SAMPLES + 0.5) / SAMPLES
Value = Callable[[Array, Array], Array]


@dataclass(frozen=True)
class Plate:
    """The rectangle origin + s s_axis + t t_axis, 0 <= s <= size[0], 0 <= t <= size[1].

    ``value`` gives the radiance at (s, t).
    """

    origin: Array
    s_axis: Array
    t_axis: Array
    size: tuple[float, float]
    value: Value

    def corners(self) -> Array:
        """The four corners, in the order (0, 0), (1, 0), (1, 1), (0, 1) of (s, t)."""
        s, t = self.size[0] * self.s_axis, self.size[1] * self.t_axis
        return np.stack([self.origin, self.origin + s, self.origin + s + t, self.origin + t])


def flat(value: float) -> Value:
    """The same radiance everywhere."""
    return lambda s, t: np.full(np.shape(s), value)


def pattern(paint: Checker | Dots) -> Value:
    """Albedo of a checker or a grid of dots by its definition."""

    def checker(s: Array, t: Array) -> Array:
        assert isinstance(paint, Checker)
        i = np.floor((s - paint.origin[0]) / paint.size)
        j = np.floor((t - paint.origin[1]) / paint.size)
        value = np.where((i + j) % 2 == 0, paint.dark, paint.light)
        inside = np.ones(np.shape(s), bool)
        if paint.columns is not None:
            inside &= (i >= 0) & (i < paint.columns)
        if paint.rows is not None:
            inside &= (j >= 0) & (j < paint.rows)
        return np.where(inside, value, paint.ground)

    def dots(s: Array, t: Array) -> Array:
        assert isinstance(paint, Dots)
        u, v = (s - paint.origin[0]) / paint.pitch, (t - paint.origin[1]) / paint.pitch
        i, j = np.round(u), np.round(v)
        square = ((u - i) ** 2 + (v - j) ** 2) * paint.pitch**2
        inside = square < 0.25 * paint.diameter**2
        if paint.columns is not None:
            inside &= (i >= 0) & (i < paint.columns)
        if paint.rows is not None:
            inside &= (j >= 0) & (j < paint.rows)
        return np.where(inside, paint.albedo, paint.ground)

    return checker if isinstance(paint, Checker) else dots


def reference(
    camera: Camera,
    plates: Sequence[Plate],
    background: float = 0.0,
    rows: tuple[int, int] | None = None,
) -> Array:
    """Mean radiance of every pixel of rows ``rows`` (all), (rows, width) float64."""
    T = camera.camera_from_world
    eye = -T[:3, :3].T @ T[:3, 3]
    ray = T[:3, :3].T @ np.linalg.inv(camera.K)
    first, stop = rows or (0, camera.height)
    grid = (np.arange(SAMPLES) + 0.5) / SAMPLES - 0.5
    offset = (np.arange(SAMPLES)[None, :] + SHIFT[:, None]) / SAMPLES - 0.5
    x = np.arange(camera.width)[None, :, None] + offset[:, None, :]
    out = np.zeros((stop - first, camera.width))
    for row in range(first, stop):
        for k in range(0, SAMPLES, _AT_ONCE):
            u = x[k : k + _AT_ONCE].reshape(-1)
            v = np.repeat(row + grid[k : k + _AT_ONCE], camera.width * SAMPLES)
            if camera.lens is not None:
                u, v = camera.undistort(np.stack([u, v], axis=1)).T
            value = _values(ray, eye, plates, background, u, v)
            out[row - first] += value.reshape(-1, camera.width, SAMPLES).sum(axis=(0, 2))
    return out / SAMPLES**2


def _values(
    ray: Array, eye: Array, plates: Sequence[Plate], background: float, u: Array, v: Array
) -> Array:
    """Radiance where rays through pixels (u, v) end; ``ray`` (3,3) is their directions' matrix."""
    value = np.full(len(u), background)
    nearest = np.full(len(u), np.inf)
    for plate in plates:
        normal = np.cross(plate.s_axis, plate.t_axis)
        along = _linear(ray.T @ normal, u, v)
        depth = ((plate.origin - eye) @ normal) / np.where(along != 0.0, along, np.nan)
        relative = eye - plate.origin
        s = depth * _linear(ray.T @ plate.s_axis, u, v) + relative @ plate.s_axis
        t = depth * _linear(ray.T @ plate.t_axis, u, v) + relative @ plate.t_axis
        hit = (depth > 0.0) & (depth < nearest)
        hit &= (s >= 0.0) & (s <= plate.size[0]) & (t >= 0.0) & (t <= plate.size[1])
        at = np.flatnonzero(hit)
        value[at] = plate.value(s[at], t[at])
        nearest[at] = depth[at]
    return value


def _linear(slope: Array, x: Array, y: Array) -> Array:
    result: Array = slope[0] * x + slope[1] * y + slope[2]
    return result


@dataclass(frozen=True)
class Difference:
    """How an image differs from a reference; shifts in px, found by least squares on gradients."""

    rms: float
    worst: float
    shift_rms: float
    bias: tuple[float, float]
    blocks: int


def difference(image: npt.ArrayLike, want: Array, block: int = 48) -> Difference:
    """Compare an image (H, W) with its reference, whole and in blocks of ``block`` px."""
    error = np.asarray(image, np.float64) - want
    shifts = []
    for row in range(0, want.shape[0] - block + 1, block):
        for column in range(0, want.shape[1] - block + 1, block):
            window = np.s_[row : row + block, column : column + block]
            if np.ptp(want[window]) > 0.1:
                shifts.append(shift_between(want[window], want[window] + error[window]))
    found = np.array(shifts)
    bias = found.mean(axis=0)
    return Difference(
        float(np.sqrt(np.mean(error**2))),
        float(np.abs(error).max()),
        float(np.sqrt(np.mean(found**2))),
        (float(bias[0]), float(bias[1])),
        len(found),
    )


def shift_between(first: Array, second: Array) -> Array:
    """Small translation (x, y) px from ``first`` to ``second``: least squares on gradients.

    The gradient is that of the mean of both, which takes out the quadratic term.
    """
    mean = 0.5 * (np.asarray(first, np.float64) + np.asarray(second, np.float64))
    gy, gx = np.gradient(mean)
    matrix = np.stack([gx.ravel(), gy.ravel()], axis=1)
    change = (np.asarray(second, np.float64) - np.asarray(first, np.float64)).ravel()
    result: Array = np.linalg.lstsq(matrix, -change, rcond=None)[0]
    return result
