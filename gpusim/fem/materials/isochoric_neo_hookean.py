"""Neo-Hookean elasticity of distortion and volume apart, as programs for rubber have it."""

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
class IsochoricNeoHookean(IsotropicConstants):
    """Rubber-like elasticity with the energy mu/2 (I1 J^(-2/3) - 3) + K/2 (J - 1)^2.

    I1 is the trace of the right Cauchy-Green tensor and J the ratio of volumes, so that the first
    part knows of distortion alone. Programs whose input has C10 and D1 (Abaqus, CalculiX) mean
    mu = 2 C10 and K = 2 / D1. In any consistent units.

    Parameters
    ----------
    E : Young's modulus at rest, > 0: 9 K mu / (3 K + mu).
    nu : Poisson's ratio at rest, in (-1, 0.5): (3 K - 2 mu) / (6 K + 2 mu).
    density : mass per undeformed volume, >= 0.
    expansion : linear thermal expansion per unit of temperature.

    Examples
    --------
    >>> rubber = gs.fem.IsochoricNeoHookean(E=3e6, nu=0.45)
    >>> stretched = np.array([0.5 * (1.5**2 - 1), 0, 0, 0, 0, 0])
    >>> float(rubber.update(stretched, None, moduli=False).stress[0].round())
    3625725.0
    """

    def update(self, strain: Float, state: Float | None, *, moduli: bool) -> Update:
        """Stress and moduli at a Green-Lagrange strain (…,6); no state."""
        bulk = self.lame + 2.0 / 3.0 * self.shear
        E2 = 2.0 * tensor_components(strain)
        deviator = E2.copy()
        deviator[:3] -= E2[:3].mean(axis=0)
        growth, inverse = growth_and_inverse(E2)
        # J - 1 is growth over 1 + J, without cancellation at small strain
        J = np.sqrt(1.0 + growth)
        shear, pull = self.shear * J ** (-2.0 / 3.0), bulk * J * growth / (1.0 + J)
        product = np.einsum("ijp,jkp->ikp", deviator[FULL], inverse[FULL])
        stress = 0.5 * shear * symmetric_sum(product) + pull * inverse
        stress = components_last(stress, strain.shape[:-1])
        if not moduli:
            return Update(stress, None, None)
        trace = (E2[:3] + 1.0).sum(axis=0)
        weighted = 2.0 * (shear * trace / 3.0 - pull) * inverse
        matrices = sandwich_product(weighted[None], inverse[None])
        # sym(a x C^-1) of what is left, with a = C^-1 and the unit tensor by their weights
        left = (0.5 * (2.0 / 9.0 * shear * trace + pull + bulk * J * J)) * inverse
        left[:3] -= 2.0 / 3.0 * shear
        left, inverse = components_last(left, (-1,)), components_last(inverse, (-1,))
        outer = left[:, :, None] * inverse[:, None]
        matrices += outer + outer.swapaxes(1, 2)
        return Update(stress, matrices.reshape(*strain.shape, 6), None)

    def results(self, strain: Float, state: Float | None) -> dict[str, Float]:
        """The energy (…)."""
        E2 = 2.0 * tensor_components(strain)
        growth, _ = growth_and_inverse(E2)
        # J^(-2/3) - 1 and J - 1, without cancellation at small strain
        less = np.expm1(np.log1p(growth) / -3.0)
        change = growth / (1.0 + np.sqrt(1.0 + growth))
        distortion = (1.0 + less) * E2[:3].sum(axis=0) + 3.0 * less
        bulk = self.lame + 2.0 / 3.0 * self.shear
        energy = 0.5 * (self.shear * distortion + bulk * change**2)
        return {"energy": energy.reshape(strain.shape[:-1])}
