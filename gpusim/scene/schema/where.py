"""``where``: the part of a body that a support, a load or a paint is about."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, model_validator

from .base import SignedAxis, Table, Words, fault

__all__ = ["WhereTable"]


class WhereTable(Table):
    """All given conditions hold together; positions are those of the unloaded shape."""

    set: Annotated[str, Field(min_length=1, max_length=200)] | None = None
    """A named set of the mesh."""
    x_min_mm: float | None = None
    x_max_mm: float | None = None
    y_min_mm: float | None = None
    y_max_mm: float | None = None
    z_min_mm: float | None = None
    z_max_mm: float | None = None
    normal: SignedAxis | None = None
    """Faces that look this way; for nodes: the nodes of such faces."""
    tolerance_mm: Annotated[float, Field(ge=0)] = 0.001
    """How far outside the bounds still counts as inside."""

    @property
    def is_everything(self) -> bool:
        """Whether no condition is given at all."""
        return not self.model_fields_set - {"tolerance_mm"}

    @model_validator(mode="after")
    def _check(self) -> WhereTable:
        for axis in "xyz":
            low, high = getattr(self, f"{axis}_min_mm"), getattr(self, f"{axis}_max_mm")
            if low is not None and high is not None and not low <= high:
                raise fault(
                    f"{axis}_min_mm", "empty range", Words(f"{low} to {high}"), "min <= max"
                )
        return self
