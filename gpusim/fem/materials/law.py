"""What an element asks of a material: stress, moduli and new state of strain and old state."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from gpusim.arrays.array_types import Float


@dataclass(frozen=True, eq=False)
class Update:
    """What a law answers at many points.

    stress : (…,6) second Piola-Kirchhoff, order xx yy zz xy yz zx.
    moduli : (…,6,6), or (6,6) where they are the same everywhere: dS/dE, symmetric, engineering
        shear; None where not asked for.
    state : (…,n) new state, None where the law has none (n = 0).
    """

    stress: Float
    moduli: Float | None
    state: Float | None


class Law(Protocol):
    """A material as elements see it.

    state_size : n doubles a point; 0: without history.
    finite_strain : False: linear elastic, answered by the corotational element; True: total
        Lagrangian.
    """

    density: float
    state_size: int
    finite_strain: bool

    def stiffness(self) -> Float:
        """(6,6) stress over strain at rest."""

    def expansion_strain(self) -> Float:
        """(6,) free strain per unit of temperature change."""

    def update(self, strain: Float, state: Float | None, *, moduli: bool) -> Update:
        """Answer to Green-Lagrange strain (…,6), engineering shear."""
