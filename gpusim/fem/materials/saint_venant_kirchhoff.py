"""Saint Venant-Kirchhoff elasticity: large displacements, small strains."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from gpusim.arrays.array_types import Float
from gpusim.fem.materials.cauchy_green import tensor_components
from gpusim.fem.materials.isotropic_constants import IsotropicConstants
from gpusim.fem.materials.law import Update
from gpusim.fem.materials.linear_elasticity import LinearElasticity


class GreenLagrangeElasticity(LinearElasticity):
    """Second Piola-Kirchhoff stress linear in the Green-Lagrange strain."""

    finite_strain: ClassVar[bool] = True

    def update(self, strain: Float, state: Float | None, *, moduli: bool) -> Update:
        """Stress linear in the strain (…,6); moduli (6,6), the same everywhere; no state."""
        tensor_components(strain)  # refuses what no body can have
        return super().update(strain, state, moduli=moduli)


@dataclass(frozen=True)
class SaintVenantKirchhoff(IsotropicConstants, GreenLagrangeElasticity):
    """Second Piola-Kirchhoff stress linear in the Green-Lagrange strain, in any consistent units.

    For large displacements and rotations with strains of a few percent: pressed to 0.58 of its
    length, a bar gets softer and softer until it gives way (use `NeoHookean` or `Hencky` there).

    Parameters
    ----------
    E : Young's modulus at rest, > 0.
    nu : Poisson's ratio at rest, in (-1, 0.5).
    density : mass per undeformed volume, >= 0.
    expansion : linear thermal expansion per unit of temperature.

    Examples
    --------
    >>> steel = gs.SaintVenantKirchhoff(E=200e9, nu=0.25)
    >>> strain = np.array([1e-3, 0, 0, 0, 0, 0])
    >>> (steel.update(strain, None, moduli=False).stress / 1e6).round(6)
    array([240.,  80.,  80.,   0.,   0.,   0.])
    """
