"""Colours as a scene file writes them: a grey number, a list of red, green and blue, "#rrggbb".

Numbers are linear. Hexadecimal ones stay as they are written here, and are decoded (by the sRGB
curve) where the scene is built.
"""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, model_validator

from .table import Listed, Share, Table, Vec3, fault

SceneColor = float | Vec3 | str
_Radiance = Annotated[float, Field(ge=0)]
_Hex = Annotated[str, Field(pattern="^#[0-9A-Fa-f]{6}$", examples=["#c0a080"])]
_Bands = Field(title="red, green, blue")
Shade = Share | Annotated[tuple[Share, Share, Share], Listed(), _Bands] | _Hex
"""Albedo: the share of light that is reflected."""
Tint = _Radiance | Annotated[tuple[_Radiance, _Radiance, _Radiance], Listed(), _Bands] | _Hex
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
