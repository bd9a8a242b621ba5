"""Colour: a grey number, or the three linear numbers red, green and blue.

What has a colour is described by its values in three bands of the spectrum, those of the primaries
of sRGB (ITU-R BT.709): for albedo the share of each band that is reflected, for light its radiance
in each, relative to what grey light of the same strength has there. A picture of something coloured
is three pictures, one a band.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from gpusim.errors import InputError

__all__ = ["BANDS", "Color", "color", "in_band", "is_colored"]

Color = float | tuple[float, float, float]
"""A grey value, or red, green and blue, linear."""

BANDS = range(3)
"""Red, green, blue."""


def color(value: float | str | Sequence[float]) -> Color:
    """A colour from what people write: a grey number, three linear numbers, or ``"#rrggbb"``.

    The last is decoded by the sRGB curve (IEC 61966-2-1). Three equal numbers are a grey one.

    Raises
    ------
    InputError
        Anything else.

    Examples
    --------
    >>> from gpusim.surface.color import color
    >>> color([0.2, 0.2, 0.2])
    0.2
    >>> [round(c, 4) for c in color("#c0a080")]
    [0.5271, 0.3515, 0.2159]
    """
    given: Any = value
    if isinstance(value, str):
        digits = value.removeprefix("#")
        try:
            if not (value.startswith("#") and len(digits) == 6):
                raise ValueError
            given = [_decoded(int(digits[k : k + 2], 16) / 255.0) for k in (0, 2, 4)]
        except ValueError:
            raise InputError(
                f"colour; got {value!r}; expected '#rrggbb', a number, or three numbers"
            ) from None
    if isinstance(given, int | float | np.integer | np.floating):
        return float(given)
    try:
        numbers = tuple(float(v) for v in given)
    except (TypeError, ValueError):
        numbers = ()
    if len(numbers) != 3 or not np.isfinite(numbers).all():
        raise InputError(f"colour; got {value!r}; expected '#rrggbb', a number, or three numbers")
    red, green, blue = numbers
    return red if red == green == blue else (red, green, blue)


def _decoded(value: float) -> float:
    """The linear value of an encoded one of sRGB."""
    return value / 12.92 if value <= 0.04045 else ((value + 0.055) / 1.055) ** 2.4


def is_colored(value: object) -> bool:
    """Whether a `Color`, a paint or a light isn't grey. What has no ``colored`` is grey."""
    return isinstance(value, tuple) or bool(getattr(value, "colored", False))


def in_band(value: Any, band: int) -> Any:
    """What a `Color`, a paint or a light is in one of `BANDS`; itself if it is grey."""
    if isinstance(value, tuple):
        return value[band]
    return value.in_band(band) if is_colored(value) else value
