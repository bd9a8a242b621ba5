"""Whether a picture is well exposed, and the exposure that was chosen for a camera."""

from __future__ import annotations

import json
from typing import Any

import numpy.typing as npt

from gpusim.errors import InputError
from gpusim.files.input_file import InputFile
from gpusim.optics.sensor.sensor import Sensor

MOST_CLIPPED = 1e-3
"""Share of the pixels; a highlight has fewer."""
COLORS = ("red", "green", "blue")
LEAST_LEVEL = 0.1
"""Of full scale: rounding to whole grey values then is more than 1 % of the contrast in 8 bit."""


def level_warnings(image: npt.NDArray[Any], sensor: Sensor) -> list[str]:
    """Sentences on the grey values of a picture that ``sensor`` took; none for one that is well
    exposed."""
    full, black, most = 2**sensor.bits - 1, sensor.black_level, sensor.saturation
    channels = [image] if image.ndim == 2 else [image[..., k] for k in range(3)]
    lows = [int(channel.min()) for channel in channels]
    highs = [int(channel.max()) for channel in channels]
    high = max(highs)
    if lows == highs:
        word = "black" if high <= black else "white" if min(lows) >= most else "grey"
        if len(set(lows)) > 1:
            word = "of one colour"
        return [f"shows nothing: every pixel is {word}, {high} of {full}"]
    saturated = sensor.saturated(image)
    if saturated.any():
        shares = saturated.reshape(-1, len(channels)).mean(axis=0)
        if shares.max() > MOST_CLIPPED:
            color = " " if len(channels) == 1 else f" {COLORS[shares.argmax()]} "
            well = f" (at {most} of {full}: the full well)" if most < full else ""
            return [
                f"has {100 * shares.max():.2g} % of its{color}pixels saturated{well}: lower "
                "[sensor] exposure or, where that is a number, the lamps' power"
            ]
    elif high - black < LEAST_LEVEL * (full - black):
        return [
            f"is too dark: grey values reach {high} of {full}; raise [sensor] exposure or the "
            "lamps' power"
        ]
    return []


def chosen_exposure(file: InputFile) -> float:
    """The exposure that was chosen for a camera, as ``[sensor] exposure``. Raises InputError."""
    try:
        value = float(json.loads(file.data)["exposure"])
    except (ValueError, KeyError, TypeError, RecursionError):
        value = 0.0
    if not 0.0 < value < float("inf"):
        raise InputError(f"{file.path}: no exposure; expected exposure > 0")
    return value
