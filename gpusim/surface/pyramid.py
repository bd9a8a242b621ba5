"""A bitmap as a smooth surface: quintic B-spline coefficients, and coarser levels of area means.

Level 0 passes through the pixel values at the pixels' centres. Level L has cells of 2^L x 2^L
pixels; its spline has the exact mean of the level-0 surface over every cell (a histospline), so
that integrating it over whole cells loses nothing. Beyond its border the bitmap is mirrored about
the outer sides of its pixels, for which the discrete cosine transform inverts the B-spline filters
exactly (Unser, "Splines: a perfect fit for signal and image processing", 1999).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

__all__ = ["MARGIN", "Level", "pyramid"]

Array = npt.NDArray[np.float64]

MARGIN = 8
"""Coefficients that every level has beyond each of its four sides."""

# the quintic B-spline at 0, 1, 2, and the one of degree six (the mean of the quintic over a cell)
AT_CENTRES = (66 / 120, 26 / 120, 1 / 120)
OVER_CELLS = (23548 / 46080, 10543 / 46080, 722 / 46080, 1 / 46080)
# the mean of the quintic over two cells, seen from their common border: at 1/2, 3/2, 5/2, 7/2
OVER_PAIRS = (34091 / 92160, 11265 / 92160, 723 / 92160, 1 / 92160)


@dataclass(frozen=True, eq=False)
class Level:
    """A surface of rows x columns cells; ``coefficients`` reach MARGIN beyond each of its sides."""

    rows: int
    columns: int
    coefficients: Array


def pyramid(values: Array) -> tuple[Level, ...]:
    """Levels of a bitmap (H, W), down to a single cell."""
    rows, columns = values.shape
    coefficients = _solve(values, AT_CENTRES)
    levels = [_level(coefficients)]
    means = _means_over_pairs(coefficients)
    while max(rows, columns) > 1:
        rows, columns = -(-rows // 2), -(-columns // 2)
        levels.append(_level(_solve(means, OVER_CELLS)))
        even = np.pad(means, [(0, n % 2) for n in means.shape], mode="symmetric")
        means = 0.25 * (even[::2, ::2] + even[1::2, ::2] + even[::2, 1::2] + even[1::2, 1::2])
    return tuple(levels)


def _level(coefficients: Array) -> Level:
    rows, columns = coefficients.shape
    # "symmetric" goes on mirroring where the bitmap is smaller than the margin
    return Level(rows, columns, np.pad(coefficients, MARGIN, mode="symmetric"))


def _solve(values: Array, taps: tuple[float, ...]) -> Array:
    """Coefficients whose symmetric filter with ``taps`` along both axes gives ``values``."""
    from scipy import fft  # not without a bitmap

    spectrum = fft.dctn(values, type=2)
    for axis, n in enumerate(values.shape):
        angle = np.pi * np.arange(n) / n
        response = taps[0] + 2.0 * sum(w * np.cos(k * angle) for k, w in enumerate(taps) if k)
        spectrum /= response[:, None] if axis == 0 else response
    result: Array = fft.idctn(spectrum, type=2)
    return result


def _means_over_pairs(coefficients: Array) -> Array:
    """Means of the level-0 surface over 2 x 2 pixels; the last cell of an odd side is mirrored."""
    for axis in (0, 1):
        n = coefficients.shape[axis]
        pad = [(0, 0), (0, 0)]
        pad[axis] = (4, 4 + n % 2)
        wide = np.moveaxis(np.pad(coefficients, pad, mode="symmetric"), axis, 0)
        cells = -(-n // 2)
        total = np.zeros((cells, *wide.shape[1:]))
        for k, weight in enumerate(OVER_PAIRS):
            left, right = wide[4 - k :: 2][:cells], wide[5 + k :: 2][:cells]
            total += weight * (left + right)
        coefficients = np.moveaxis(total, 0, axis)
    return coefficients
