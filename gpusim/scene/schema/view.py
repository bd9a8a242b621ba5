"""``[[prop]]``, ``[[camera]]``, ``[[light]]``: what else is seen, from where, and how it is lit."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from .base import Direction, Length, Name, Pair, PositivePair, Table, Vector, fault, norm, parallel
from .paint import MarkersTable, PaintTable

__all__ = ["CameraTable", "LightTable", "PropTable"]

PIXEL_SQUARE = 1e-3


class PropTable(Table):
    """A rigid rectangular plate that doesn't move: a wall, a target. Only its front is seen."""

    name: Name
    type: Literal["plate"] = "plate"
    center_mm: Vector
    normal: Direction
    """Out of its front."""
    up: Direction = [0.0, 0.0, 1.0]
    size_mm: PositivePair
    """Width (across ``up``) and height."""
    paint: Annotated[list[PaintTable], Field(min_length=1, max_length=1)]
    """One paint: a plate has one face."""

    @model_validator(mode="after")
    def _check(self) -> PropTable:
        if parallel(self.normal, self.up):
            raise fault("up", "is along the normal, or one is zero", self.up, "a vector across it")
        paint = self.paint[0]
        if not paint.where.is_everything:
            raise fault("paint.0.where", "a plate has one face", "a selection", "no where")
        if isinstance(paint, MarkersTable):
            self._check_markers(paint)
        return self

    def _check_markers(self, paint: MarkersTable) -> None:
        n = [value / norm(self.normal) for value in self.normal]
        along = sum(a * b for a, b in zip(self.up, n, strict=True))
        up = [a - along * b for a, b in zip(self.up, n, strict=True)]
        up = [value / norm(up) for value in up]
        right = [up[1] * n[2] - up[2] * n[1], up[2] * n[0] - up[0] * n[2],
                 up[0] * n[1] - up[1] * n[0]]  # fmt: skip
        for index, centre in enumerate(paint.centres_mm()):
            arm = [a - b for a, b in zip(centre, self.center_mm, strict=True)]
            x, y, z = (
                sum(a * b for a, b in zip(arm, axis, strict=True)) for axis in (right, up, n)
            )
            key = "line" if paint.positions_mm is None else f"positions_mm.{index}"
            half = paint.size_mm / 2
            if not abs(z) <= 1e-3:
                raise fault(f"paint.0.{key}", f"{abs(z):g} mm off the plate", centre, "on its face")
            if not (abs(x) <= self.size_mm[0] / 2 - half and abs(y) <= self.size_mm[1] / 2 - half):
                raise fault(f"paint.0.{key}", "reaches over the plate's edge", centre, "inside")


class CameraTable(Table):
    """A pinhole camera, described as a photographer would."""

    name: Name
    sensor_mm: PositivePair
    """Width and height of the sensor."""
    resolution_px: Annotated[
        list[Annotated[int, Field(ge=1, le=65535)]], Field(min_length=2, max_length=2)
    ]
    focal_mm: Length
    position_mm: Vector
    """The centre of projection."""
    target_mm: Vector
    """A point on the optical axis."""
    up: Direction = [0.0, 0.0, 1.0]
    """Roughly up in the image."""
    principal_point_offset_mm: Pair = [0.0, 0.0]
    """Where the optical axis meets the sensor: right and down from the image's centre."""
    square_pixels: bool = True
    """Set to false to say that pixels of unequal sides are meant."""

    @model_validator(mode="after")
    def _check(self) -> CameraTable:
        (width, height), (columns, rows) = self.sensor_mm, self.resolution_px
        ratio = (width / columns) / (height / rows)
        if self.square_pixels and not abs(ratio - 1) <= PIXEL_SQUARE:
            raise fault(
                "resolution_px", "sensor_mm and resolution_px make pixels that aren't square",
                f"{1000 * width / columns:.4g} x {1000 * height / rows:.4g} um",
                "equal sides within 0.1 %, or square_pixels = false",
            )  # fmt: skip
        view = [b - a for a, b in zip(self.position_mm, self.target_mm, strict=True)]
        if not norm(view) > 0:
            raise fault("target_mm", "is where the camera is", self.target_mm, "another point")
        if parallel(view, self.up):
            raise fault("up", "is along the view, or zero", self.up, "a vector across it")
        return self


class PointLightTable(Table):
    """A small lamp that shines evenly in all directions."""

    name: Name
    type: Literal["point"]
    position_mm: Vector
    power_W: Length
    """Radiant flux."""


class AreaLightTable(Table):
    """A rectangular lamp that faces its target and radiates as a diffuse surface does."""

    name: Name
    type: Literal["area"]
    position_mm: Vector
    """Its centre."""
    target_mm: Vector
    size_mm: PositivePair
    """Width (level) and height."""
    power_W: Length
    """Radiant flux."""

    @model_validator(mode="after")
    def _check(self) -> AreaLightTable:
        view = [b - a for a, b in zip(self.position_mm, self.target_mm, strict=True)]
        if not norm(view) > 0:
            raise fault("target_mm", "is where the lamp is", self.target_mm, "another point")
        return self


class AmbientLightTable(Table):
    """What the surroundings send back, equally from every direction; nothing hides it."""

    name: Name
    type: Literal["ambient"]
    radiance_W_m2_sr: Length
    """Radiance of the surroundings."""


LightTable = Annotated[
    PointLightTable | AreaLightTable | AmbientLightTable, Field(discriminator="type")
]
