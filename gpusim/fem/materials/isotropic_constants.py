"""Constants of isotropic materials: two of elasticity, density, thermal expansion."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from gpusim.arrays.array_types import Float
from gpusim.fem.materials.constants import ANY, FROM_ZERO, POISSON, POSITIVE, constant
from gpusim.fem.materials.symmetric_tensors import ENGINEERING

_RULES = {"E": POSITIVE, "nu": POISSON, "density": FROM_ZERO, "expansion": ANY}


@dataclass(frozen=True)
class IsotropicConstants:
    """What every isotropic law is at rest, and an elastic one of finite strain at any.

    Raises InputError for constants out of range.
    """

    E: float
    nu: float
    density: float = 0.0
    expansion: float = 0.0
    state_size: ClassVar[int] = 0
    finite_strain: ClassVar[bool] = True

    def __post_init__(self) -> None:
        for name, rule in _RULES.items():
            value = constant(getattr(self, name), f"{type(self).__name__}: {name}", rule)
            object.__setattr__(self, name, value)

    @property
    def lame(self) -> float:
        """Lamé's first constant lambda."""
        return self.E * self.nu / ((1.0 + self.nu) * (1.0 - 2.0 * self.nu))

    @property
    def shear(self) -> float:
        """Shear modulus mu."""
        return 0.5 * self.E / (1.0 + self.nu)

    def stiffness(self) -> Float:
        """(6,6) stress over strain, order xx yy zz xy yz zx, engineering shear strains."""
        matrix = np.zeros((6, 6))
        matrix[:3, :3] = self.lame
        matrix[np.arange(3), np.arange(3)] += 2.0 * self.shear
        matrix[np.arange(3, 6), np.arange(3, 6)] = self.shear
        return matrix

    def quadratic_energy(self, components: Float) -> Float:
        """(P,) half of stress times strain, of tensors (6,P)."""
        stress = (self.stiffness() * ENGINEERING) @ components
        return np.asarray(0.5 * ENGINEERING @ (stress * components))

    def expansion_strain(self) -> Float:
        """(6,) free strain per unit of temperature change: ``expansion`` in xx, yy, zz."""
        return np.array([self.expansion] * 3 + [0.0] * 3)
