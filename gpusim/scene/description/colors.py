"""Colours as a scene file writes them: a grey number, a list of red, green and blue, "#rrggbb"; and
finishes by name: what surfaces of workshops look like.

Numbers are linear. Hexadecimal ones stay as they are written here, and are decoded (by the sRGB
curve) where the scene is built.

Albedo of bare metal is its reflectance at normal incidence, from optical constants (Akenine-Möller
et al., *Real-Time Rendering*, 4th ed., 2018, table 9.2: iron and aluminium, linear red, green and
blue). The relief of brushed metal has the heights of EN 10088-2's 2J (Ra below 1 um), that of paint
is orange peel; what is finer than any pixel is in the roughness.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal, NamedTuple

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


FinishName = Literal[
    "mill-finished steel",
    "brushed steel",
    "mill-finished aluminium",
    "brushed aluminium",
    "painted steel",
]


class NamedFinish(NamedTuple):
    """Values of a paint's keys; ``stretch`` counts where the paint says along what it is brushed.

    ``color``: red, green, blue; `albedo` is their luminance.
    """

    color: tuple[float, float, float]
    roughness: float
    metallic: float
    bump_um: float = 0.0
    bump_length_mm: float = 0.5
    stretch: float = 1.0

    @property
    def albedo(self) -> float:
        """Grey, by the luminance (ITU-R BT.709)."""
        red, green, blue = self.color
        return round(0.2126 * red + 0.7152 * green + 0.0722 * blue, 4)

    def filled(self, given: dict[str, Any]) -> dict[str, Any]:
        """A paint's keys, with this finish's values for those that aren't there."""
        values = {
            "albedo": self.albedo, "roughness": self.roughness, "metallic": self.metallic,
            "bump_um": self.bump_um, "bump_length_mm": self.bump_length_mm,
        }  # fmt: skip
        if self.stretch > 1.0 and "bump_along" in given:
            values["bump_stretch"] = self.stretch
        if "color" in given:
            del values["albedo"]
        return {**values, **given}

    @staticmethod
    def unfilled(given: dict[str, Any]) -> dict[str, Any]:
        """A paint's keys without what its finish, or no finish, gave: before it gets another."""
        matte = NamedFinish((-1.0, -1.0, -1.0), 1.0, 0.0)
        old = FINISHES.get(str(given.get("finish")), matte)
        values = {"bump_stretch": 1.0, **old.filled({"bump_along": None})}
        return {key: value for key, value in given.items() if values.get(key) != value}


IRON, ALUMINIUM = (0.562, 0.565, 0.578), (0.913, 0.922, 0.924)
FINISHES: dict[str, NamedFinish] = {
    "mill-finished steel": NamedFinish(IRON, 0.5, 1.0),
    "brushed steel": NamedFinish(IRON, 0.35, 1.0, 0.6, 0.05, 40.0),
    "mill-finished aluminium": NamedFinish(ALUMINIUM, 0.4, 1.0),
    "brushed aluminium": NamedFinish(ALUMINIUM, 0.3, 1.0, 0.6, 0.05, 40.0),
    "painted steel": NamedFinish((0.35, 0.35, 0.35), 0.3, 0.0, 1.5, 1.2),
}
