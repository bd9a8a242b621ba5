"""``[[material]]`` and ``[[body]]``: what stands there, how it is held and loaded."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from .base import Axis, Name, Table, Vector, fault
from .mesh import MeshTable
from .paint import PaintTable
from .where import WhereTable

__all__ = ["BodyTable", "LoadTable", "MaterialTable", "SupportTable"]


class MaterialTable(Table):
    """A linear elastic, isotropic material."""

    name: Name
    youngs_modulus_GPa: Annotated[float, Field(gt=0)]
    poissons_ratio: Annotated[float, Field(gt=-1, lt=0.5)]
    density_kg_m3: Annotated[float, Field(ge=0)] = 0.0
    """Only gravity needs it."""


class SupportTable(Table):
    """Nodes that are held, or moved by a given amount."""

    name: Name
    where: WhereTable
    fix: Annotated[list[Axis], Field(min_length=1, max_length=3)] = ["x", "y", "z"]
    """The directions in which the nodes are held."""
    displacement_mm: Vector = [0.0, 0.0, 0.0]
    """Where they are held, relative to the unloaded shape; scaled by the load factor."""

    @model_validator(mode="after")
    def _check(self) -> SupportTable:
        if len(set(self.fix)) != len(self.fix):
            raise fault("fix", "a direction twice", self.fix, "each of x, y, z at most once")
        if "fix" not in self.model_fields_set and "displacement_mm" not in self.model_fields_set:
            raise fault(
                "fix", "missing", "neither fix nor displacement_mm", 'fix = ["x", "y", "z"]'
            )
        for axis, value in zip("xyz", self.displacement_mm, strict=True):
            if value != 0 and axis not in self.fix:
                raise fault(
                    "displacement_mm", f"moves along {axis}, which fix leaves free", self.fix,
                    f'fix with "{axis}" in it',
                )  # fmt: skip
        if self.where.is_everything:
            raise fault("where", "selects the whole body", "{}", "a set, a bound or a normal")
        return self


class _Load(Table):
    name: Name


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


LoadTable = Annotated[
    ForceTable | NodalForceTable | PressureTable | TractionTable | GravityTable,
    Field(discriminator="type"),
]


class BodyTable(Table):
    """A deformable body."""

    name: Name
    material: Name
    """The name of a [[material]]."""
    formulation: Literal["incompatible", "full", "bbar"] = "incompatible"
    """Of 8-node bricks: "incompatible" bends without locking, "bbar" is for rubber-like bodies."""
    mesh: MeshTable
    support: list[SupportTable] = []
    load: list[LoadTable] = []
    paint: Annotated[list[PaintTable], Field(min_length=1)]
    """A face belongs to the last entry that matches it."""
