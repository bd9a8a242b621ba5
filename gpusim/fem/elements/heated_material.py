"""Heat at finite strain: F = F_e U, with U the stretch of a body that is free to expand.

The law sees the strain E_e = U^-1 (E - E_U) U^-1, E_U = (U^2 - 1) / 2, from the body that has
expanded, and its energy is per volume of that body, det U times the volume at rest (Lu & Pister,
Int. J. Solids Struct. 11 (1975) 927). So heat alone makes nothing stiffer or softer: Young's
modulus is force per area over strain, both of the expanded body.
"""

from __future__ import annotations

import numpy as np

from gpusim.arrays.array_types import Float
from gpusim.fem.elements.finite_strain import IDENTITY, green_lagrange, tensor, volume_change
from gpusim.fem.elements.isoparametric_map import inverse
from gpusim.fem.materials.law import Law, Update, results_of
from gpusim.fem.materials.symmetric_tensors import ENGINEERING, strain_congruence


class HeatedMaterial:
    """``law`` at points of elements. ``free_strain`` (M,Q,6) with engineering shear is U less one,
    ``volume`` (M,Q) det U.
    """

    def __init__(self, law: Law, free_strain: Float) -> None:
        slope = tensor(free_strain / ENGINEERING)
        self.law, self.volume = law, 1.0 + volume_change(slope)
        self._strain = green_lagrange(slope)
        back = inverse(slope + IDENTITY, self.volume)
        self._pull = strain_congruence(back.transpose(2, 3, 0, 1))

    def update(self, strain: Float, state: Float | None, *, moduli: bool) -> Update:
        """As the law's own, of the strain (M,Q,6) and per volume at rest."""
        update = self.law.update(self._elastic(strain), state, moduli=moduli)
        push = self._pull.swapaxes(2, 3) * self.volume[..., None, None]
        stress = np.matmul(push, update.stress[..., None])[..., 0]
        matrices = None if update.moduli is None else push @ update.moduli @ self._pull
        return Update(stress, matrices, update.state)

    def results(self, strain: Float, state: Float | None) -> dict[str, Float]:
        """As the law's own, energy per volume at rest."""
        results = results_of(self.law, self._elastic(strain), state)
        return results | {"energy": results["energy"] * self.volume}

    def _elastic(self, strain: Float) -> Float:
        return np.asarray(np.matmul(self._pull, (strain - self._strain)[..., None])[..., 0])
