"""Geometric stiffness: what stress adds to the stiffness of a body, by turning with it.

The integral of s_ij N_a,i N_b,j (initial stress), the same for the three directions. What the
motion before buckling changes beside the stress isn't in it: linear buckling.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from gpusim.arrays.array_types import Float, Int, Long
from gpusim.fem.elements.element import ELEMENTS
from gpusim.fem.elements.finite_strain import tensor
from gpusim.fem.elements.isoparametric_map import determinant, inverse, reference_gradient
from gpusim.fem.elements.strain import point_stress
from gpusim.fem.model.model import Model
from gpusim.fem.model.thermal_loads import linear_temperature, point_temperature


@dataclass(frozen=True, eq=False)
class GeometricStiffness:
    """Of the stress that displacements ``u`` (N,3) and the heat of the load cases, by ``factors``
    (L,), cause in a ``model`` by linear theory; ``formulation`` per cell type."""

    model: Model
    formulation: Mapping[str, str]
    u: Float
    factors: Float

    def at(self, name: str, cells: Int, numbers: Long) -> Float:
        """(m,k,k), the same for the three directions, of cells with nodes ``cells`` (m,k), the
        ``numbers`` (m,) of the mesh."""
        model, rule = self.model, ELEMENTS[name].rule(self.formulation[name])
        assert model.material_of_cell is not None
        law, nodes, free = model.material_of_cell[numbers], model.mesh.points[cells], None
        moduli = np.stack([one.stiffness() for one in model.materials])[law]
        if model.temperature is not None:
            warm = linear_temperature("stress", model.mesh, self.factors @ model.temperature)
            expansion = np.stack([one.expansion_strain() for one in model.materials])[law]
            free = point_temperature(name, rule, warm[cells])[..., None] * expansion[:, None]
        moved = self.u[cells]
        stress, volume = point_stress(name, self.formulation[name], nodes, moved, moduli, free)
        jacobian = reference_gradient(nodes - nodes[:, :1], rule)
        back = inverse(jacobian, determinant(jacobian))
        # dN_a / dx_i at the points: (3,M,Q,k)
        slope = np.einsum("jimq,qaj->imqa", back, rule.gradient, optimize=True)
        flux = np.einsum("ijmq,jmqa->imqa", tensor(stress) * volume, slope, optimize=True)
        return np.asarray(np.einsum("imqa,imqb->mab", slope, flux, optimize=True))
