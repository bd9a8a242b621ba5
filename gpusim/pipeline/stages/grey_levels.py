"""Pictures that are too dark or too bright to measure in."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from gpusim.optics.sensor.sensor import Sensor

__all__ = ["level_warnings"]

MOST_CLIPPED = 1e-3
"""Share of the pixels; a highlight has fewer."""
LEAST_LEVEL = 0.1
"""Of full scale: rounding to whole grey values then is more than 1 % of the contrast in 8 bit."""


def level_warnings(image: npt.NDArray[Any], sensor: Sensor) -> list[str]:
    """Sentences on the grey values of a picture that ``sensor`` took; none for one that is well
    exposed."""
    full, black, most = 2**sensor.bits - 1, sensor.black_level, sensor.saturation
    low, high = int(image.min()), int(image.max())
    if low == high:
        word = "black" if high <= black else "white" if high >= most else "grey"
        return [f"shows nothing: every pixel is {word}, {high} of {full}"]
    if high >= most:
        share = float(np.count_nonzero(image >= most)) / image.size
        if share > MOST_CLIPPED:
            well = f" (at {most} of {full}: the full well)" if most < full else ""
            return [
                f"has {100 * share:.2g} % of its pixels saturated{well}: lower [sensor] exposure "
                "or the lamps' power"
            ]
    elif high - black < LEAST_LEVEL * (full - black):
        return [
            f"is too dark: grey values reach {high} of {full}; raise [sensor] exposure or the "
            "lamps' power"
        ]
    return []
