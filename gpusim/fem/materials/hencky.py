"""Hencky elasticity: the law of small strain in logarithmic strain."""

from __future__ import annotations

from dataclasses import dataclass

from gpusim.arrays.array_types import Float
from gpusim.fem.materials.isotropic_constants import IsotropicConstants
from gpusim.fem.materials.law import Update
from gpusim.fem.materials.logarithmic_strain import LogarithmicStrain
from gpusim.fem.materials.symmetric_tensors import ENGINEERING


@dataclass(frozen=True)
class Hencky(IsotropicConstants):
    """Kirchhoff stress linear in the logarithmic strain H = ln(C) / 2, in any consistent units.

    The elastic part of `J2`; fits metals and many polymers to moderate strains.

    Parameters
    ----------
    E : Young's modulus at rest, > 0.
    nu : Poisson's ratio at rest, in (-1, 0.5).
    density : mass per undeformed volume, >= 0.
    expansion : linear thermal expansion per unit of temperature.

    Examples
    --------
    >>> steel = gs.Hencky(E=200e9, nu=0.0)
    >>> stretched = np.array([0.5 * (1.01**2 - 1), 0, 0, 0, 0, 0])
    >>> stress = steel.update(stretched, None, moduli=False).stress[0]
    >>> bool(np.isclose(stress, 200e9 * np.log(1.01) / 1.01**2, rtol=1e-13))
    True
    """

    def update(self, strain: Float, state: Float | None, *, moduli: bool) -> Update:
        """Stress and moduli at a Green-Lagrange strain (…,6); no state."""
        logarithmic = LogarithmicStrain(strain)
        elastic = self.stiffness()
        stress = (elastic * ENGINEERING) @ logarithmic.components
        return Update(*logarithmic.pulled_back(stress, elastic if moduli else None), None)

    def results(self, strain: Float, state: Float | None) -> dict[str, Float]:
        """The energy (…)."""
        energy = self.quadratic_energy(LogarithmicStrain(strain).components)
        return {"energy": energy.reshape(strain.shape[:-1])}
