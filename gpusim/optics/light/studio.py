"""A photographer's studio as surroundings: soft boxes, a light ceiling, a pale floor, a horizon.

What bare metal looks like is what it mirrors. In a room of two even halves flat steel is one tone;
here each of its sides finds a gradient. Nothing in it is sharper than the maps that gloss mirrors.
"""

from __future__ import annotations

import numpy as np

from gpusim.arrays.array_types import Float

ROWS = 96

CEILING, HORIZON, FLOOR = 0.75, 0.95, 0.45
"""Radiances over head, at the horizon and under foot, before the mean is made 1."""

BOXES = (
    (-130.0, 30.0, 36.0, 30.0, 1.8),
    (120.0, 24.0, 26.0, 34.0, 1.2),
    (38.0, 6.0, 32.0, 42.0, 2.4),
    (-62.0, 18.0, 20.0, 40.0, 1.3),
    (0.0, 80.0, 70.0, 14.0, 1.4),
)
"""Soft boxes: azimuth (from the middle to the right) and height over the horizon, half widths, all
in degrees, and radiance. A camera that looks at the middle has two of them behind it, and two
ahead to the sides, which flat faces along the line of sight mirror."""


def studio() -> Float:
    """Radiances (H, W) in all directions, equirectangular, of mean 1 over the sphere.

    Examples
    --------
    >>> from gpusim.optics.light.studio import studio
    >>> studio().shape
    (96, 192)
    """
    height = 90.0 - (np.arange(ROWS) + 0.5) / ROWS * 180.0
    azimuth = (np.arange(2 * ROWS) + 0.5) / (2 * ROWS) * 360.0 - 180.0
    up = np.sin(np.radians(height))
    sky = HORIZON + (CEILING - HORIZON) * _step(up / 0.9)
    ground = FLOOR + (HORIZON - FLOOR) * np.exp(5.0 * np.minimum(up, 0.0))
    result = np.repeat(np.where(up > 0.0, sky, ground)[:, None], 2 * ROWS, axis=1)
    for middle, over, wide, tall, radiance in BOXES:
        across = (azimuth - middle + 180.0) % 360.0 - 180.0
        a, b = _edge(np.abs(across) / wide), _edge(np.abs(height - over) / tall)
        result += radiance * b[:, None] * a[None]
    weight = np.cos(np.radians(height))[:, None]
    mean: Float = result / float((result * weight).sum() / (weight.sum() * 2 * ROWS))
    return mean


def _step(x: Float) -> Float:
    x = np.clip(x, 0.0, 1.0)
    result: Float = x * x * (3.0 - 2.0 * x)
    return result


def _edge(x: Float) -> Float:
    """1 within, 0 from a third beyond the border on."""
    return 1.0 - _step((x - 2.0 / 3.0) * 1.5)
