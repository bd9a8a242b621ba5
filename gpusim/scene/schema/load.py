"""``[[body.load]]``: forces, pressure, weight, rotation and heat."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from .base import Direction, Name, Table, Vector, fault, norm
from .where import WhereTable

__all__ = [
    "Amplitude",
    "CentrifugalTable",
    "ForceTable",
    "GravityTable",
    "LineForceTable",
    "LoadTable",
    "NodalForceTable",
    "PressureTable",
    "ThermalTable",
    "TractionTable",
]

Amplitude = Annotated[list[float], Field(min_length=1, max_length=10_000)]


class _Load(Table):
    name: Name
    amplitude: Amplitude | None = None
    """One factor per frame for this load; without it the analysis' load_factors."""


class ForceTable(_Load):
    """A total force, spread evenly over the area of the faces."""

    type: Literal["force"]
    where: WhereTable
    force_N: Vector


class NodalForceTable(_Load):
    """The same force on every node."""

    type: Literal["nodal_force"]
    where: WhereTable
    force_N: Vector


class LineForceTable(_Load):
    """A total force, spread evenly over the length of a line of element edges."""

    type: Literal["line_force"]
    where: WhereTable
    """The nodes of the line: say two bounds, or a named set."""
    force_N: Vector


class PressureTable(_Load):
    """A pressure on faces; positive pushes into the body."""

    type: Literal["pressure"]
    where: WhereTable
    pressure_MPa: float


class TractionTable(_Load):
    """A force per area on faces."""

    type: Literal["traction"]
    where: WhereTable
    traction_MPa: Vector


class GravityTable(_Load):
    """The body's own weight."""

    type: Literal["gravity"]
    acceleration_m_s2: Vector = [0.0, 0.0, -9.80665]


class CentrifugalTable(_Load):
    """Steady rotation about an axis: the body is pulled outward."""

    type: Literal["centrifugal"]
    axis_point_mm: Vector = [0.0, 0.0, 0.0]
    """A point on the axis."""
    axis: Direction = [0.0, 0.0, 1.0]
    speed_rpm: float
    """Turns per minute; the amplitude scales the force, not the speed."""

    @model_validator(mode="after")
    def _check(self) -> CentrifugalTable:
        if not norm(self.axis) > 0:
            raise fault("axis", "has no direction", self.axis, "a vector that isn't zero")
        return self


class ThermalTable(_Load):
    """A temperature change of the whole body; the material's expansion_per_K says what it does."""

    type: Literal["thermal"]
    temperature_change_K: float


LoadTable = Annotated[
    ForceTable
    | NodalForceTable
    | LineForceTable
    | PressureTable
    | TractionTable
    | GravityTable
    | CentrifugalTable
    | ThermalTable,
    Field(discriminator="type"),
]
