"""``[body.mesh]``: the builders that make a body's elements."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from .base import Length, Table, Vector, fault

__all__ = ["SETS", "BoxTable", "CraneTable", "MeshTable"]

# What `where = { set = … }` may name, by builder; checked before a mesh is built.
SETS = {
    "box": ("x_min", "x_max", "y_min", "y_max", "z_min", "z_max"),
    "crane": ("foot", "load", "front", "back", "tip"),
}

Count = Annotated[int, Field(ge=1, le=10_000)]


class BoxTable(Table):
    """A block of 8-node bricks along the axes. Its sides are the sets "x_min" … "z_max"."""

    builder: Literal["box"]
    size_mm: Annotated[list[Length], Field(min_length=3, max_length=3)]
    divisions: Annotated[list[Count], Field(min_length=3, max_length=3)]
    """Elements along x, y, z."""
    origin_mm: Vector = [0.0, 0.0, 0.0]
    """The corner with the smallest x, y, z."""


class CraneTable(Table):
    """A column with a beam welded on top, of flat bars, in 8-node bricks.

    The column's outer face is x = 0 and its clamped foot ends at z = 0; the beam reaches along +x
    and lies on top of the column; both are centred on y = 0. Named sets: "foot" (z <= 0), "load"
    (top of the last ``load_length_mm``), "front" (-y), "back" (+y), "tip" (the free end).
    """

    builder: Literal["crane"]
    height_mm: Length = 562.0
    """Of the column above its foot."""
    foot_mm: Length = 70.0
    """Length of the clamped foot below z = 0."""
    length_mm: Length = 597.0
    """Of the beam, from the column's outer face."""
    column_thickness_mm: Length = 6.0
    beam_thickness_mm: Length = 4.0
    width_mm: Length = 40.0
    """Of both members, along y."""
    load_length_mm: Length = 108.0
    """An element edge lies this far from the beam's free end."""
    element_mm: Length = 3.0
    """About the length of an element along the members."""
    through: Count = 2
    """Elements through the thickness of each member."""
    across: Count = 6
    """Elements across the width."""

    @model_validator(mode="after")
    def _check(self) -> CraneTable:
        if not self.column_thickness_mm + self.load_length_mm < self.length_mm:
            raise fault(
                "length_mm", "the beam is too short", self.length_mm,
                "more than column_thickness_mm + load_length_mm",
            )  # fmt: skip
        return self


MeshTable = Annotated[BoxTable | CraneTable, Field(discriminator="builder")]
