"""Geometric stiffness: what stress adds to the stiffness of a body, by turning with it.

The integral of s_ij N_a,i N_b,j (initial stress), the same for the three directions. What the
motion before buckling changes beside the stress isn't in it: linear buckling.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy.sparse import csr_matrix

from gpusim.arrays.array_types import Float, Int, Long
from gpusim.fem.elements.element import ELEMENTS
from gpusim.fem.elements.finite_strain import tensor
from gpusim.fem.elements.isoparametric_map import determinant, inverse, reference_gradient
from gpusim.fem.elements.strain import point_stress
from gpusim.fem.model.mass import scalar_matrix
from gpusim.fem.model.model import Model
from gpusim.fem.model.thermal_loads import linear_temperature, point_temperature


def geometric_stiffness(model: Model, formulation: Mapping[str, str], u: Float) -> csr_matrix:
    """(N,N) of the stress that displacements ``u`` (N,3) and the first load case's heat cause by
    linear theory."""
    warm = None if model.temperature is None else model.temperature[0]
    change = None if warm is None else linear_temperature("buckling", model.mesh, warm)
    moduli = np.stack([one.stiffness() for one in model.materials])
    expansion = np.stack([one.expansion_strain() for one in model.materials])
    material_of_cell = model.material_of_cell
    assert material_of_cell is not None

    def matrices(kind: str, cells: Int, numbers: Long) -> Float:
        rule, law = ELEMENTS[kind].rule(formulation[kind]), material_of_cell[numbers]
        nodes, free = model.mesh.points[cells], None
        if change is not None:
            free = point_temperature(kind, rule, change[cells])[..., None]
            free = free * expansion[law][:, None]
        stress, volume = point_stress(kind, formulation[kind], nodes, u[cells], moduli[law], free)
        jacobian = reference_gradient(nodes - nodes[:, :1], rule)
        back = inverse(jacobian, determinant(jacobian))
        # dN_a / dx_i at the points: (3,M,Q,k)
        slope = np.einsum("jimq,qaj->imqa", back, rule.gradient, optimize=True)
        flux = np.einsum("ijmq,jmqa->imqa", tensor(stress) * volume, slope, optimize=True)
        return np.asarray(np.einsum("imqa,imqb->mab", slope, flux, optimize=True))

    return scalar_matrix(model.mesh, matrices)
