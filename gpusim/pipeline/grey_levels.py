"""Pictures that are too dark or too bright to measure in."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

__all__ = ["level_warnings"]

MOST_CLIPPED = 1e-3
"""Share of the pixels; a highlight has fewer."""
LEAST_LEVEL = 0.1
"""Of full scale: rounding to whole grey values then is more than 1 % of the contrast in 8 bit."""


def level_warnings(image: npt.NDArray[Any], bits: int, black: float = 0.0) -> list[str]:
    """Sentences on the grey values of a picture; none for one that is well exposed."""
    full = 2**bits - 1
    low, high = int(image.min()), int(image.max())
    if low == high:
        word = "black" if high <= black else "white" if high == full else "grey"
        return [f"shows nothing: every pixel is {word}, {high} of {full}"]
    if high == full:
        share = float(np.count_nonzero(image == full)) / image.size
        if share > MOST_CLIPPED:
            return [
                f"has {100 * share:.2g} % of its pixels saturated: lower [sensor] exposure or the "
                "lamps' power"
            ]
    elif high - black < LEAST_LEVEL * (full - black):
        return [
            f"is too dark: grey values reach {high} of {full}; raise [sensor] exposure or the "
            "lamps' power"
        ]
    return []
