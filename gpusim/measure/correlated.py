"""How uncertain fits are where the noise of neighbouring pixels is alike.

Colour filters, sharpening and compression correlate noise. A fit whose parameter is p = sum h_i n_i
of the noise n then varies by s^2 sum_ij h_i h_j r(j - i), where independent noise gives
s^2 sum_i h_i^2. The correlation r is taken from what all fits of an image leave.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

__all__ = ["widening"]

FloatArray = npt.NDArray[np.float64]

REACH = 3  # px: noise further apart counts as independent
SURE = 4.0  # standard deviations by which a correlation must stand out


def widening(residual: FloatArray, weight: FloatArray, influence: FloatArray) -> FloatArray:
    """Standard uncertainty over that for independent noise, at least 1, of C fits (C,).

    ``residual``, ``weight`` (C, S, S): what the fits leave of their pixels, and 0 for those that
    they don't use; ``influence`` (C, Q, S, S): h of the parameters whose variances are added.
    """
    used = weight > 0
    count = np.maximum(used.sum(axis=(1, 2)), 1)
    left = np.where(used, residual, 0.0)
    scale = np.sqrt((left * left).sum(axis=(1, 2)) / count)
    left = left / np.where(scale > 0, scale, 1.0)[:, None, None]
    own = np.where(used[:, None], influence, 0.0)
    alone = (own * own).sum(axis=(1, 2, 3))
    together = alone.copy()
    for down in range(REACH + 1):
        for across in range(-REACH, REACH + 1):
            if down == 0 and across <= 0:
                continue
            one, other = _shifted(used, down, across)
            pairs = int((one & other).sum())
            if not pairs:
                continue
            one, other = _shifted(left, down, across)
            alike = float((one * other).sum()) / pairs
            if abs(alike) * np.sqrt(pairs) > SURE:
                one, other = _shifted(own, down, across)
                together += 2.0 * alike * (one * other).sum(axis=(1, 2, 3))
    ratio = together / np.where(alone > 0, alone, 1.0)
    return np.asarray(np.sqrt(np.maximum(ratio, 1.0)))


def _shifted(
    values: npt.NDArray[Any], down: int, across: int
) -> tuple[npt.NDArray[Any], npt.NDArray[Any]]:
    """The values (…, S, S) of all pixels that have one ``down`` rows and ``across`` columns on,
    and those of the latter."""
    size = values.shape[-1]
    left, right = max(-across, 0), size - max(across, 0)
    return (
        values[..., : size - down, left:right],
        values[..., down:, left + across : right + across],
    )
