"""``[[camera]]``, ``[[light]]``: from where a scene is seen, and how it is lit."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, model_validator

from .base import Direction, Length, Name, Pair, PositivePair, Table, Vector, fault, norm, parallel
from .lens import LensTable, ShutterTable

__all__ = ["CameraTable"]

PIXEL_SQUARE = 1e-3


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
    lens: LensTable | None = None
    """Without it a pinhole."""
    shutter: ShutterTable | None = None
    """Without it an instant."""
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
        focus = None if self.lens is None else self.lens.focus_distance_mm
        if focus is not None and not focus > self.focal_mm:
            raise fault("lens.focus_distance_mm", "inside the lens", focus, "more than focal_mm")
        return self
