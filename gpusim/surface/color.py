"""Colour: a grey number, or the three linear numbers red, green and blue.

What has a colour is described by its values in three bands of the spectrum, those of the primaries
of sRGB (ITU-R BT.709): for albedo the share of each band that is reflected, for light its radiance
in each, relative to what grey light of the same strength has there. A picture of something coloured
is three pictures, one a band.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import fields, replace
from functools import cached_property
from inspect import getattr_static
from typing import Any, Self, TypeVar, overload

import numpy as np

from gpusim.arrays.srgb import decoded
from gpusim.errors import InputError
from gpusim.validation import is_number, require

Color = float | tuple[float, float, float]
"""A grey value, or red, green and blue, linear."""

BANDS = range(3)
"""Red, green, blue."""

T = TypeVar("T")


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
    if isinstance(value, str) and re.fullmatch("#[0-9a-fA-F]{6}", value):
        given = decoded(np.array([int(value[k : k + 2], 16) for k in (1, 3, 5)]) / 255.0).tolist()
    elif isinstance(value, np.ndarray):
        given = value.tolist()
    if is_number(given) and np.isfinite(given):
        return float(given)
    numbers = given if isinstance(given, list | tuple) else ()
    fits = len(numbers) == 3 and all(is_number(v) and np.isfinite(v) for v in numbers)
    require(fits, "colour", repr(value), "'#rrggbb', a number, or three numbers")
    red, green, blue = map(float, numbers)
    return red if red == green == blue else (red, green, blue)


def is_colored(value: object) -> bool:
    """Whether a `Color`, a paint or a light isn't grey. What has no ``colored`` is grey."""
    return isinstance(value, tuple) or bool(getattr(value, "colored", False))


@overload
def in_band(value: Color, band: int) -> float: ...


@overload
def in_band(value: T, band: int) -> T: ...


def in_band(value: Any, band: int) -> Any:
    """What a `Color`, a paint or a light is in one of `BANDS`; it itself where it is grey."""
    if isinstance(value, tuple):
        return value[band]
    return value.in_band(band) if is_colored(value) else value


def grey(value: Color) -> float:
    """The number of a grey value.

    Raises
    ------
    InputError
        It has a colour.
    """
    if isinstance(value, tuple):
        raise InputError(f"colour; got {value}; expected grey: the paint's in_band(0), (1) or (2)")
    return value


class Albedo:
    """A field of a paint: the share of light that is reflected, from 0 to 1, a `Color`.

    It takes whatever `color` does. (A descriptor, as dataclasses have them for fields.)
    """

    def __init__(self, default: Color) -> None:
        self.default = default

    def __set_name__(self, owner: type, name: str) -> None:
        self.name = name

    def __get__(self, paint: object | None, owner: type | None = None) -> Color:
        value: Color = self.default if paint is None else paint.__dict__[self.name]
        return value

    def __set__(self, paint: object, value: float | str | Sequence[float]) -> None:
        try:
            found = color(value)
        except InputError:
            found = -1.0
        fits = all(0.0 <= in_band(found, band) <= 1.0 for band in BANDS)
        expected = "an albedo from 0 to 1: a number, three (red, green, blue), or '#rrggbb'"
        require(fits, f"{type(paint).__name__} {self.name}", value, expected)
        paint.__dict__[self.name] = found


class Colored:
    """Base of frozen dataclasses with colours: what they are in each of the three `BANDS`.

    That of a paint is in its fields of the kind `Albedo`.
    """

    @property
    def colored(self) -> bool:
        """Whether it isn't grey."""
        return any(map(is_colored, self._albedos().values()))

    def in_band(self, band: int) -> Self:
        """The same without colour, as it is in one of `BANDS`; made once. A grey one is itself."""
        return self._bands[band] if self.colored else self

    @cached_property
    def _bands(self) -> tuple[Self, ...]:
        return tuple(self._of_band(band) for band in BANDS)

    def _of_band(self, band: int) -> Self:
        paint: Any = self
        own = {name: in_band(value, band) for name, value in self._albedos().items()}
        result: Self = replace(paint, **own)
        return result

    def _albedos(self) -> dict[str, Color]:
        paint: Any = self
        names = [field.name for field in fields(paint)]
        return {
            name: getattr(self, name)
            for name in names
            if isinstance(getattr_static(type(self), name, None), Albedo)
        }
