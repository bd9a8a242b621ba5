"""Slanted edges and what is measured from them (ISO 12233), with the edge's place known exactly."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

import gpusim as gs

Array = npt.NDArray[np.float64]
WIDTH, HEIGHT = 96, 150
K = np.array([[900.0, 0.0, 46.3], [0.0, 900.0, 76.1], [0.0, 0.0, 1.0]])
ANGLE = np.arctan(0.1234)
BINS = 8  # a pixel


def camera() -> gs.Camera:
    """A camera whose image the edge crosses from top to bottom."""
    return gs.Camera(WIDTH, HEIGHT, K)


def half_plane(depth: float = 2.0, shift: float = 0.0) -> gs.Surface:
    """A bright plate whose left border crosses (46.3, 76.1) px + (shift, 0), turned by ANGLE."""
    along = np.array([np.sin(ANGLE), np.cos(ANGLE), 0.0])
    across = np.array([np.cos(ANGLE), -np.sin(ANGLE), 0.0])
    origin = np.array([shift / 900.0 * depth, 0.0, depth])
    size = 0.3 * depth
    points = np.stack(
        [origin - size * along, origin - size * along + size * across,
         origin + size * along + size * across, origin + size * along]
    )  # fmt: skip
    return gs.Surface(points, np.array([[0, 3, 2, 1]]), paint=gs.paint.Plain(0.8))


def distance(shift: float = 0.0) -> Array:
    """Distance (H, W) px of every pixel's centre from the edge, positive on the bright side."""
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    return np.asarray((x - K[0, 2] - shift) * np.cos(ANGLE) - (y - K[1, 2]) * np.sin(ANGLE))


def transfer(image: npt.ArrayLike, frequency: Array, reach: float = 14.0) -> Array:
    """Modulation transfer at frequencies (cycles/px) across the edge, as ISO 12233 measures it.

    Pixels are sorted by their distance from the edge into bins of 1/8 px; the differences of
    neighbouring bins are the line spread, whose transform is corrected for the binning and the
    difference.
    """
    d, values = distance().ravel(), np.asarray(image, np.float64).ravel()
    count = int(2 * reach * BINS)
    index = np.floor((d + reach) * BINS).astype(int)
    inside = (index >= 0) & (index < count)
    total = np.bincount(index[inside], values[inside], count)
    number = np.bincount(index[inside], minlength=count)
    assert number.min() > 4
    spread = np.diff(total / number)
    at = (np.arange(count - 1) + 1.0) / BINS - reach
    wave = np.exp(-2j * np.pi * np.outer(frequency, at)) @ spread
    return np.asarray(np.abs(wave) / spread.sum() / np.sinc(frequency / BINS) ** 2)


def pixel_transfer(frequency: Array) -> Array:
    """That of a square pixel, across the edge."""
    return np.asarray(np.sinc(frequency * np.cos(ANGLE)) * np.sinc(frequency * np.sin(ANGLE)))
