"""Colours as a scene file writes them: a grey number, a list of red, green and blue, "#rrggbb".

Numbers are linear. Hexadecimal ones stay as they are written here, and are decoded (by the sRGB
curve) where the scene is built.
"""

from __future__ import annotations

import re
from typing import Annotated, Any

from pydantic import Field, PlainValidator, WithJsonSchema, model_validator

from .table import Table, Vec3, Words, fault

SceneColor = float | Vec3 | str

_HEX = "^#[0-9A-Fa-f]{6}$"


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _checked(most: float, numbers: str) -> PlainValidator:
    """A grey number or a list of three, from 0 to ``most``, or a text of `_HEX`."""
    expected = f'{numbers}, a list of 3 of them (red, green, blue), or "#rrggbb"'

    def check(value: Any) -> SceneColor:
        if isinstance(value, str):
            if not re.fullmatch(_HEX, value):
                raise fault("", "no colour", value, expected)
            return value
        items = value if isinstance(value, list) else [value]
        if not all(map(_is_number, items)):
            raise fault("", "wrong type", value, expected)
        if len(items) != 3 and items is value:
            raise fault("", "wrong length", Words(f"{len(items)} items"), expected)
        if not all(0.0 <= item <= most for item in items):
            raise fault("", "out of range", value, expected)
        numbers = tuple(map(float, items))
        return (numbers[0], numbers[1], numbers[2]) if items is value else numbers[0]

    return PlainValidator(check)


def _schema(**limits: float) -> WithJsonSchema:
    number = {"type": "number", "minimum": 0, **limits}
    three = {"type": "array", "items": number, "minItems": 3, "maxItems": 3}
    text = {"type": "string", "pattern": _HEX, "examples": ["#c0a080"]}
    return WithJsonSchema({"anyOf": [number, three, text]})


Shade = Annotated[Any, _checked(1.0, "a number from 0 to 1"), _schema(maximum=1)]
"""Albedo: the share of light that is reflected."""
Tint = Annotated[Any, _checked(1e30, "a number >= 0"), _schema()]
"""Radiance, or a share of it."""


def is_chromatic(value: object) -> bool:
    """Whether a `SceneColor` isn't grey; None is no colour."""
    text = value.lower() if isinstance(value, str) else ""
    parts = [text[k : k + 2] for k in (1, 3, 5)] if text else value
    return isinstance(parts, list | tuple) and len(set(parts)) > 1


class TintedTable(Table):
    """Light, which has the colour of a temperature, or any other."""

    temperature_K: Annotated[float, Field(ge=800, le=40_000)] | None = None
    """Its colour is that of a black body: 2700 to 3000 are incandescent lamps, 6500 is daylight."""
    color: Tint | None = None
    """Its colour, of any brightness: how strong the light is, the other keys say. Without both it
    is grey."""

    @model_validator(mode="after")
    def _check_color(self) -> TintedTable:
        if self.color is None:
            return self
        if self.temperature_K is not None:
            raise fault("color", "beside temperature_K", self.color, "one of them")
        if self.color in (0.0, (0.0, 0.0, 0.0), "#000000"):
            raise fault("color", "no light at all", self.color, "a colour that isn't black")
        return self
