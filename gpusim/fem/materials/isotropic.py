"""Linear isotropic elasticity."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from gpusim.fem.materials.isotropic_constants import IsotropicConstants
from gpusim.fem.materials.linear_elasticity import LinearElasticity


@dataclass(frozen=True)
class Isotropic(IsotropicConstants, LinearElasticity):
    """Linear isotropic elasticity, in any consistent units.

    ``E`` Young's modulus > 0, ``nu`` Poisson's ratio in (-1, 0.5), ``density`` >= 0 (needed for
    gravity, rotation and mass), ``expansion`` linear thermal expansion per unit of temperature.
    Raises InputError outside these ranges.

    Examples
    --------
    >>> steel = gs.Isotropic(E=210e9, nu=0.3, density=7850.0)
    >>> steel.stiffness().shape
    (6, 6)
    """

    finite_strain: ClassVar[bool] = False
