"""Strain and stress of many cells at the quadrature points of their formulation, and back.

``point_stress`` is what the stiffness matrix implies: with K_e the matrix of ``element_stiffness``,
``internal_force`` of the stress that belongs to u is K_e u. Gradients are taken of the fields
instead of forming strain matrices, so 300,000 hexahedra take about two seconds.
"""

from __future__ import annotations

import numpy as np

from gpusim.arrays.array_types import Float
from gpusim.fem.elements.element import ELEMENTS, Rule, mode_gradient
from gpusim.fem.elements.finite_strain import PAIRS, tensor
from gpusim.fem.elements.isoparametric_map import (
    determinant,
    inverse,
    reference_gradient,
    solve_definite,
    times,
)


def point_stress(
    kind: str, formulation: str, nodes: Float, u: Float, moduli: Float, free: Float | None = None
) -> tuple[Float, Float]:
    """Stress (M,Q,6) and volume (M,Q) at the quadrature points of M cells of one type.

    Parameters
    ----------
    kind, formulation : a key of ``ELEMENTS`` and one of its formulations. Internal modes of
        "incompatible" are recovered from the condition that their forces vanish; "bbar" uses the
        mean volume change.
    nodes, u : (M,k,3) coordinates and displacements.
    moduli : (6,6), or (M,6,6) one per cell.
    free : (M,Q,6) strain that causes no stress (thermal), engineering shear; None: none.
    """
    rule = ELEMENTS[kind].rule(formulation)
    local = nodes - nodes[:, :1]
    jacobian = reference_gradient(local, rule)
    det = determinant(jacobian)
    volume = det * rule.weight
    # differences first: a rigid translation doesn't cost digits
    slope = times(reference_gradient(u - u[:, :1], rule), inverse(jacobian, det))
    strain = np.empty((*det.shape, 6))
    for column, (i, j) in enumerate(PAIRS):
        strain[..., column] = slope[i, i] if i == j else slope[i, j] + slope[j, i]
    if formulation == "bbar":
        change = strain[..., :3].sum(axis=2)
        mean = (change * volume).sum(axis=1) / volume.sum(axis=1)
        strain[..., :3] += ((mean[:, None] - change) / 3.0)[..., None]
    if free is not None:
        strain -= free
    # moduli are symmetric
    stress = np.matmul(strain, moduli)
    if formulation == "incompatible":
        stress += _mode_stress(local, rule, det, stress, moduli)
    return stress, volume


def internal_force(kind: str, formulation: str, nodes: Float, stress: Float) -> Float:
    """(M,k,3) nodal forces that hold the stress (M,Q,6) of ``point_stress``: B^T s dV."""
    rule = ELEMENTS[kind].rule(formulation)
    jacobian = reference_gradient(nodes - nodes[:, :1], rule)
    det = determinant(jacobian)
    volume = det * rule.weight
    turned = inverse(jacobian, det)
    if formulation == "bbar":
        mean = stress[..., :3].sum(axis=2) / 3.0
        average = (mean * volume).sum(axis=1) / volume.sum(axis=1)
        stress = stress.copy()
        stress[..., :3] += (average[:, None] - mean)[..., None]
    count, points = det.shape
    # forces[m,k,i] = sum over q, l of (s J^-T)[i,l] dN_k / d xi_l, as one matrix product
    flux = times(tensor(stress) * volume, turned.transpose(1, 0, 2, 3))
    table = rule.gradient.transpose(0, 2, 1).reshape(3 * points, -1)
    flat = flux.transpose(0, 2, 3, 1).reshape(3 * count, 3 * points) @ table
    return np.ascontiguousarray(flat.reshape(3, count, -1).transpose(1, 2, 0))


def _mode_stress(nodes: Float, rule: Rule, det: Float, stress: Float, moduli: Float) -> Float:
    """(M,Q,6) stress of the internal modes of hexahedra, given that of the nodes.

    Mode c has the gradient -2 xi_c d(xi_c)/dx at the centre, times detJ0/detJ. Its amplitude
    follows from zero forces: the integral of B_c^T (s + C sum_d B_d a_d) is zero.
    """
    centre = ELEMENTS["hex8"].centre_gradient
    jacobian = np.einsum("mki,kj->ijm", nodes, centre)
    at_centre = determinant(jacobian)
    turned = inverse(jacobian, at_centre)
    amplitude = mode_gradient(rule)[:, np.arange(3), np.arange(3)]  # (Q,3): -2 xi_c
    count = len(nodes)
    # B_c without its amplitude: (M,6,3,3) strain, mode, component
    operator = np.zeros((count, 6, 3, 3))
    for row, (i, j) in enumerate(PAIRS):
        operator[:, row, :, i] += turned[:, j].T
        if i != j:
            operator[:, row, :, j] += turned[:, i].T
    flat = operator.reshape(count, 6, 9)
    # detJ0/detJ times the volume is detJ0 times the weight
    load = np.matmul((amplitude * rule.weight[:, None]).T, stress) * at_centre[:, None, None]
    force = np.einsum("mrci,mcr->mci", operator, load).reshape(count, 9)
    product = np.einsum("qc,qd->qcd", amplitude, amplitude).reshape(-1, 9)
    scale = (rule.weight / det) @ product * at_centre[:, None] ** 2
    mode_stiffness = np.matmul(flat.transpose(0, 2, 1), np.matmul(moduli, flat))
    mode_stiffness = mode_stiffness.reshape(count, 3, 3, 3, 3) * scale.reshape(count, 3, 1, 3, 1)
    matrix = np.ascontiguousarray(mode_stiffness.reshape(count, 9, 9).transpose(1, 2, 0))
    modes = -solve_definite(matrix, force.T.copy()).T.reshape(count, 3, 3)
    strain = np.einsum("mrci,mci->mcr", operator, modes)
    extra = np.matmul(amplitude, np.matmul(strain, moduli))
    return np.asarray(extra * (at_centre[:, None] / det)[..., None])
