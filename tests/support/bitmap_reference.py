"""The B-spline surface of a bitmap by SciPy, sampled densely: nothing of gpusim's is used."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy import ndimage

Array = npt.NDArray[np.float64]


def surface(pixels: Array, x: Array, y: Array) -> Array:
    """The quintic spline through (H, W) at columns x and rows y from the upper left corner."""
    coefficients = ndimage.spline_filter(pixels, order=5, mode="reflect", output=np.float64)
    places = np.stack([np.ravel(y) - 0.5, np.ravel(x) - 0.5])
    values = ndimage.map_coordinates(coefficients, places, order=5, mode="reflect", prefilter=False)
    result: Array = values.reshape(np.shape(x))
    return result


def mean_of_pixels(pixels: Array, at: Array, ex: Array, ey: Array, q: Array, n: int) -> Array:
    """Mean (m,) over footprints at (m, 2), by n x n samples each."""
    grid = (np.arange(n) + 0.5) / n - 0.5
    i, j = (a.ravel() for a in np.meshgrid(grid, grid))
    w = 1.0 / (1.0 + q[:, :1] * i + q[:, 1:] * j)
    x = at[:, :1] + (ex[:, :1] * i + ey[:, :1] * j) * w
    y = at[:, 1:] + (ex[:, 1:] * i + ey[:, 1:] * j) * w
    result: Array = surface(pixels, x, y).mean(axis=1)
    return result


def speckle(rows: int, columns: int, diameter: float, blur: float, seed: int = 3) -> Array:
    """Dark discs on light ground, 0.1 to 0.9, averaged over 4 x 4 samples and blurred (px)."""
    rng = np.random.default_rng(seed)
    n = 4
    y, x = np.ogrid[: rows * n, : columns * n]
    covered = np.zeros((rows * n, columns * n), bool)
    for _ in range(int(0.7 * rows * columns / (0.25 * np.pi * diameter**2))):
        cx, cy = rng.random(2) * [columns * n, rows * n]
        r = 0.5 * n * diameter * rng.uniform(0.8, 1.2)
        span = np.s_[max(int(cy - r), 0) : int(cy + r) + 2, max(int(cx - r), 0) : int(cx + r) + 2]
        covered[span] |= (x[:, span[1]] - cx) ** 2 + (y[span[0]] - cy) ** 2 < r * r
    light = 1.0 - covered.reshape(rows, n, columns, n).mean(axis=(1, 3))
    result: Array = 0.1 + 0.8 * ndimage.gaussian_filter(light, blur)
    return result
