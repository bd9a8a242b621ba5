"""``[body.field]``: a displacement field that another program computed."""

from __future__ import annotations

from pathlib import PurePath
from typing import Annotated, Literal

from pydantic import Field, model_validator

from .base import Length, Table, fault

__all__ = ["FIELD_SUFFIXES", "FieldTable"]

# The endings that the readers know; said here too, because a plan loads no numerics.
FIELD_SUFFIXES = (".vtu", ".pvd", ".series", ".e", ".ex2", ".exo", ".exodus", ".frd", ".npz")


class FieldTable(Table):
    """Mesh and nodal displacements of a result file; nothing is solved.

    Frames between its times are interpolated linearly; a file whose first time is above 0 is taken
    to start undeformed at time 0.
    """

    file: Annotated[str, Field(min_length=1)]
    """Relative to the scene file: .vtu (one state, time 1), .pvd or .vtu.series (one .vtu per
    time), .e/.exo (Exodus), .frd (CalculiX, text), .npz."""
    unit: Literal["m", "cm", "mm", "um", "in"] = "mm"
    """Of coordinates and displacements in the file."""
    displacement: Annotated[str, Field(min_length=1, max_length=200)] | None = None
    """Name of the nodal variable; where it is one per axis, what the three names begin with.
    Without it one with a usual name: displacement, disp, U, DISP."""
    scale: Length = 1.0
    """Factor on the displacements, to show them larger than they are."""

    @model_validator(mode="after")
    def _check(self) -> FieldTable:
        if PurePath(self.file).suffix.lower() not in FIELD_SUFFIXES:
            expected = "one of " + ", ".join(FIELD_SUFFIXES)
            raise fault("file", "unknown kind of result file", self.file, expected)
        return self
