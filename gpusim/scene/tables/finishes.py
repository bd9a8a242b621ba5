"""Finishes by name: what surfaces of workshops look like.

Albedo of bare metal is its reflectance at normal incidence, from optical constants (Akenine-Möller
et al., *Real-Time Rendering*, 4th ed., 2018, table 9.2: iron and aluminium, linear red, green and
blue). The relief of brushed metal has the heights of EN 10088-2's 2J (Ra below 1 um), that of paint
is orange peel; what is finer than any pixel is in the roughness.
"""

from __future__ import annotations

from typing import Any, Literal, NamedTuple

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
