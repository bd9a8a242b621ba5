"""A speckled plate as the picture that other programs wrap around it."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from gpusim.surface.paint import Speckle

__all__ = ["disc_texture"]


def disc_texture(
    paint: Speckle, size: tuple[float, float], texel: float, n: int = 8
) -> npt.NDArray[np.uint8]:
    """A plate of this ``size`` as an 8 bit image, each texel the mean of n x n samples; row 0 is
    t = 0."""
    columns, rows = (round(length / texel) for length in size)
    step = np.array(size) / [columns * n, rows * n]
    centres, radii = paint.discs((0.0, 0.0), size)
    fine = np.zeros((rows * n, columns * n), bool)
    for (u, v), radius in zip(centres, radii, strict=True):
        j0, j1 = (max(0, int((u + sign * radius) / step[0])) for sign in (-1, 1))
        i0, i1 = (max(0, int((v + sign * radius) / step[1])) for sign in (-1, 1))
        x = (np.arange(j0, min(j1 + 1, columns * n)) + 0.5) * step[0] - u
        y = (np.arange(i0, min(i1 + 1, rows * n)) + 0.5) * step[1] - v
        fine[i0 : i0 + len(y), j0 : j0 + len(x)] |= x**2 + y[:, None] ** 2 <= radius * radius
    covered = fine.reshape(rows, n, columns, n).mean(axis=(1, 3))
    albedo = paint.ground + covered * (paint.dot - paint.ground)
    return np.asarray(np.rint(255.0 * albedo), np.uint8)
