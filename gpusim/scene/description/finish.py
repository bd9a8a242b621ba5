"""How a painted surface shines, and its fine relief; in SI."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from .loads import Vec3

__all__ = ["MATTE", "Bump", "Finish"]


@dataclass(frozen=True)
class Bump:
    """A fine relief of RMS ``height`` and correlation ``length`` (m), ``stretch`` times longer
    ``along`` a direction."""

    height: float
    length: float
    along: Vec3 | None
    stretch: float
    seed: int


class Finish(NamedTuple):
    """Roughness, metallic share and relief."""

    roughness: float = 1.0
    metallic: float = 0.0
    bump: Bump | None = None


MATTE = Finish()
