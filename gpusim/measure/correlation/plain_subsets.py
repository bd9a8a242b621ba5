"""Subsets that show nothing but noise: no start is worth a try there.

Noise of a sensor is white: neighbouring grey values differ by as much as those two pixels apart,
however the light changes over the subset. What a lens has drawn goes on from pixel to pixel. A
pattern as
fine as noise is told from it by its strength: what matches leave is noise, too.
"""

from __future__ import annotations

import numpy as np

from gpusim.arrays.array_types import Bool, Float, Single
from gpusim.measure.correlation.pixel_mask import box_means
from gpusim.measure.images import Image

# squared differences over one pixel by those over two; noise scatters by 0.05 around 1
WHITE = 0.85
STRONGER = 2.0  # variance of noise over that of matched places: it grows with brightness


def neighbour_differences(image: Image, points: Float, half: int) -> tuple[Float, Float]:
    """Mean squares by which neighbouring pixels differ, and those two pixels apart, (M,), in
    subsets around ``points`` (M, 2), all inside the image."""
    grey = image.astype(np.float32)
    x, y = np.rint(points).astype(np.int64).T
    once, twice = (box_means(_differences(grey, apart), x, y, half) for apart in (1, 2))
    return once, twice


def plain_subsets(differences: tuple[Float, Float], noise: float = np.inf) -> Bool:
    """Subsets without a pattern, of which the `neighbour_differences` are known, (M,) bool.

    ``noise`` : variance of the image's noise, squares of grey levels, where it was measured.
    """
    once, twice = differences
    # along two axes, of two pixels each
    return np.asarray((once <= 4.0 * STRONGER * noise) & (once >= WHITE * twice))


def _differences(grey: Single, apart: int) -> Single:
    """Sum of the squared differences from the pixels so far to the right and below, (H, W)."""
    squares = np.zeros_like(grey)
    squares[:, :-apart] = np.square(grey[:, apart:] - grey[:, :-apart])
    squares[:-apart] += np.square(grey[apart:] - grey[:-apart])
    return squares
