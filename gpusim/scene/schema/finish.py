"""How a painted surface shines, and its fine relief: keys of every paint."""

from __future__ import annotations

from math import sqrt
from typing import Annotated

from pydantic import Field, model_validator

from .base import Albedo, Direction, Length, Table, Words, fault, norm

__all__ = ["FinishTable"]

_STEEPEST = 0.35


class FinishTable(Table):
    """How the ground shines. Markers, fields, dots and targets on it are matte prints; speckle and
    pictures shine with their ground, as under a varnish."""

    roughness: Albedo = 1.0
    """1: matte. Less: glossy, lacquer at about 0.3, brushed steel (with metallic) at 0.4."""
    metallic: Albedo = 0.0
    """1: bare metal, which mirrors with its albedo and has no colour of its own below."""
    bump_um: Annotated[float, Field(ge=0)] = 0.0
    """RMS height of a fine relief (orange peel, grain, scratches); 0: smooth. It turns normals and
    moves with the material; outlines and shadows stay those of the smooth surface."""
    bump_length_mm: Length = 0.5
    """Over which the relief changes: its correlation is 1/e there."""
    bump_along: Direction | None = None
    """Direction of longer waves, as of brushing, on the unloaded shape."""
    bump_stretch: Annotated[float, Field(ge=1, le=1e4)] = 1.0
    """How many times longer they are in that direction."""
    bump_seed: Annotated[int, Field(ge=0, lt=2**63)] = 0

    @model_validator(mode="after")
    def _check_bump(self) -> FinishTable:
        slope = sqrt(2.0) * self.bump_um * 1e-3 / self.bump_length_mm
        if not slope <= _STEEPEST:
            expected = f"at most {_STEEPEST / sqrt(2.0) * self.bump_length_mm * 1e3:.3g}"
            raise fault("bump_um", "too steep for a fine relief", self.bump_um, expected)
        if self.bump_along is not None and not norm(self.bump_along) > 0:
            raise fault("bump_along", "has no direction", self.bump_along, "a vector not zero")
        if (self.bump_stretch != 1.0) != (self.bump_along is not None):
            got = Words("none") if self.bump_along is None else self.bump_along
            raise fault("bump_along", "goes with bump_stretch", got, "both or neither")
        return self
