"""``[[body]]``: what stands there and how it is held."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from .base import Axis, Name, Table, Vector, Words, fault
from .field import FieldTable
from .load import Amplitude, LoadTable
from .mesh import MeshTable, NotchTable
from .paint import PaintTable
from .where import WhereTable

__all__ = ["BodyTable", "PartTable", "SupportTable"]


class SupportTable(Table):
    """Nodes that are held, or moved by a given amount."""

    name: Name
    type: Literal["fixed", "symmetry"] = "fixed"
    """"symmetry": flat faces don't move along their normal, which is x, y or z."""
    where: WhereTable
    fix: Annotated[list[Axis], Field(min_length=1, max_length=3)] = ["x", "y", "z"]
    """The directions in which the nodes are held."""
    displacement_mm: Vector = [0.0, 0.0, 0.0]
    """Where they are held, relative to the unloaded shape; scaled by the load factor."""
    amplitude: Amplitude | None = None
    """One factor per frame for displacement_mm; without it the analysis' load_factors."""

    @model_validator(mode="after")
    def _check(self) -> SupportTable:
        if len(set(self.fix)) != len(self.fix):
            raise fault("fix", "a direction twice", self.fix, "each of x, y, z at most once")
        if self.where.is_everything:
            raise fault(
                "where", "selects the whole body", Words("{}"), "a set, a bound or a normal"
            )
        if self.amplitude is not None and not any(self.displacement_mm):
            raise fault("amplitude", "of a support that doesn't move", self.amplitude,
                        "a displacement_mm that isn't zero")  # fmt: skip
        if self.type == "symmetry":
            for key in ("fix", "displacement_mm"):
                if getattr(self, key) != type(self).model_fields[key].default:
                    raise fault(key, "given for a symmetry support", getattr(self, key),
                                "none: the faces say the direction")  # fmt: skip
            return self
        if "fix" not in self.model_fields_set and "displacement_mm" not in self.model_fields_set:
            raise fault(
                "fix", "missing", Words("neither fix nor displacement_mm"), 'fix = ["x", "y", "z"]'
            )
        for axis, value in zip("xyz", self.displacement_mm, strict=True):
            if value != 0 and axis not in self.fix:
                raise fault(
                    "displacement_mm", f"moves along {axis}, which fix leaves free", self.fix,
                    f'fix with "{axis}" in it',
                )  # fmt: skip
        return self


class PartTable(Table):
    """Elements of a body that are of another material."""

    material: Name
    """The name of a [[material]]."""
    where: WhereTable
    """The elements whose middle is there; ``set`` is a named set of elements."""

    @model_validator(mode="after")
    def _check(self) -> PartTable:
        if self.where.normal is not None:
            raise fault("where.normal", "of elements, which look nowhere", self.where.normal,
                        "a set of elements or bounds")  # fmt: skip
        if self.where.is_everything:
            raise fault("where", "selects the whole body", Words("{}"), "a set or a bound")
        return self


class BodyTable(Table):
    """A deformable body: a mesh of a material to be solved, or a field that is given."""

    name: Name
    material: Name | None = None
    """The name of a [[material]]."""
    field: FieldTable | None = None
    """Mesh and displacements from a result file of another program, in place of material, mesh,
    supports and loads; ``analysis.type`` is "field" then."""
    part: list[PartTable] = []
    """Elements of other materials; an element belongs to the last entry that matches it."""
    formulation: Literal["incompatible", "full", "bbar", "reduced", "exact"] = "incompatible"
    """Of 8-node bricks "incompatible" (bends without locking), "full", or "bbar" (for rubber-like
    bodies); of 20-node bricks "full" or "reduced"; of 6-node wedges "full" or "exact". An element
    type that doesn't have it takes its own default."""
    mesh: MeshTable | None = None
    notch: list[NotchTable] = []
    """Slots in a box or a beam."""
    support: list[SupportTable] = []
    load: list[LoadTable] = []
    paint: Annotated[list[PaintTable], Field(min_length=1)]
    """A face belongs to the last entry that matches it."""

    @model_validator(mode="after")
    def _check(self) -> BodyTable:
        if self.field is None:
            for key, what in (("material", "the name of a [[material]]"), ("mesh", "a mesh")):
                if getattr(self, key) is None:
                    raise fault(
                        key, "missing", Words(f"neither {key} nor field"), f"{what}, or a field"
                    )
            return self
        for key in ("material", "mesh", "part", "formulation", "notch", "support", "load"):
            if getattr(self, key) not in (None, [], type(self).model_fields[key].default):
                raise fault(key, "beside field, which gives mesh and displacements",
                            Words("both"), "one of them")  # fmt: skip
        return self
