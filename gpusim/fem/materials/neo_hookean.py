"""Compressible neo-Hookean elasticity."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gpusim.arrays.array_types import Float
from gpusim.fem.materials.cauchy_green import growth_and_inverse, tensor_components
from gpusim.fem.materials.isotropic_constants import IsotropicConstants
from gpusim.fem.materials.law import Update
from gpusim.fem.materials.symmetric_tensors import (
    FULL,
    components_last,
    sandwich_product,
    symmetric_sum,
)


@dataclass(frozen=True)
class NeoHookean(IsotropicConstants):
    """Rubber-like elasticity with the energy mu/2 (I1 - 3) - mu ln J + lambda/2 ln^2 J.

    I1 is the trace of the right Cauchy-Green tensor and J the ratio of volumes; Lamé's constants
    lambda and mu follow from E and nu. In any consistent units.

    Parameters
    ----------
    E : Young's modulus at rest, > 0.
    nu : Poisson's ratio at rest, in (-1, 0.5).
    density : mass per undeformed volume, >= 0.
    expansion : linear thermal expansion per unit of temperature.

    Examples
    --------
    >>> rubber = gs.NeoHookean(E=3e6, nu=0.45)
    >>> stretched = np.array([0.5 * (1.5**2 - 1), 0, 0, 0, 0, 0])
    >>> float(rubber.update(stretched, None, moduli=False).stress[0].round())
    2252499.0
    """

    def update(self, strain: Float, state: Float | None, *, moduli: bool) -> Update:
        """Stress and moduli at a Green-Lagrange strain (…,6); no state."""
        E2 = 2.0 * tensor_components(strain)
        growth, inverse = growth_and_inverse(E2)
        dilatation = 0.5 * self.lame * np.log1p(growth)
        # 1 - 1/C without cancellation at small strain
        product = np.einsum("ijp,jkp->ikp", inverse[FULL], E2[FULL])
        stress = 0.5 * self.shear * symmetric_sum(product) + dilatation * inverse
        stress = components_last(stress, strain.shape[:-1])
        if not moduli:
            return Update(stress, None, None)
        weighted = 2.0 * (self.shear - dilatation) * inverse
        matrices = sandwich_product(weighted[None], inverse[None])
        inverse = components_last(inverse, (-1,))
        matrices += self.lame * inverse[:, :, None] * inverse[:, None]
        return Update(stress, matrices.reshape(*strain.shape, 6), None)

    def results(self, strain: Float, state: Float | None) -> dict[str, Float]:
        """The energy (…)."""
        E2 = 2.0 * tensor_components(strain)
        logarithm = 0.5 * np.log1p(growth_and_inverse(E2)[0])
        energy = self.shear * (0.5 * E2[:3].sum(axis=0) - logarithm)
        return {"energy": (energy + 0.5 * self.lame * logarithm**2).reshape(strain.shape[:-1])}
