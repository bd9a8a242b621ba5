"""What drives and what damps a vibration beside loads: a ground that moves, damping."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, model_validator

from gpusim.scene.tables.table import Direction, Length, Table, Words, fault


class DampingTable(Table):
    """What takes energy out of a vibration: a share of critical damping, or Rayleigh's kind.

    Example::

        ratio = 0.01
    """

    ratio: Annotated[float, Field(ge=0, lt=1)] | None = None
    """Of critical damping, the same for all modes."""
    rayleigh_mass_per_s: Annotated[float, Field(ge=0)] | None = None
    """Damping per mass; beside it, or without it, rayleigh_stiffness_s."""
    rayleigh_stiffness_s: Annotated[float, Field(ge=0)] | None = None
    """Damping per stiffness."""

    @model_validator(mode="after")
    def _check(self) -> DampingTable:
        kinds = [key.split("_")[0] for key, value in self if value is not None]
        if len(set(kinds)) != 1:
            got = Words(" and ".join(dict.fromkeys(kinds)) or "no kind")
            raise fault("", "not one kind of damping", got,
                        "ratio, or Rayleigh's two, or of harmonic motion loss_factor")  # fmt: skip
        return self


class HarmonicDampingTable(DampingTable):
    """The same of harmonic motion, or a loss factor.

    Example::

        loss_factor = 0.02
    """

    loss_factor: Annotated[float, Field(ge=0)] | None = None
    """Of the stiffness: the same energy is lost in each cycle at any frequency."""


class BaseMotionTable(Table):
    """How the ground moves that supports stand on; cameras don't move with it.

    Example::

        file = "shaker.csv"
        direction = [1.0, 0.0, 0.0]
    """

    path: Annotated[str, Field(alias="file", min_length=1)]
    """A CSV file of two columns: time (s), and acceleration along ``direction`` (m/s2), the ground
    at rest before."""
    direction: Direction
    """In which it is accelerated; its length doesn't matter."""


class ShakerTable(Table):
    """A shaker: how it swings under the supports; cameras don't move with it.

    Example::

        acceleration_m_s2 = 9.81
        direction = [0.0, 0.0, 1.0]
    """

    acceleration_m_s2: Length
    """Its amplitude, the same at each frequency."""
    direction: Direction
    """In which it is accelerated; its length doesn't matter."""
