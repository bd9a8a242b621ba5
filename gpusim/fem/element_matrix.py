"""Element stiffness matrices in float64, many elements at a time."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from gpusim.errors import InputError
from gpusim.fem.element import ELEMENTS

__all__ = ["element_stiffness", "strain_matrix"]

Float = npt.NDArray[np.float64]

_CHUNK = 4096


def strain_matrix(gradient: Float) -> Float:
    """(…,k,3) shape gradients -> (…,6,3k): strain (xx yy zz xy yz zx, engineering shear)."""
    nodes = gradient.shape[-2]
    matrix = np.zeros((*gradient.shape[:-2], 6, nodes, 3))
    x, y, z = gradient[..., 0], gradient[..., 1], gradient[..., 2]
    matrix[..., 0, :, 0] = x
    matrix[..., 1, :, 1] = y
    matrix[..., 2, :, 2] = z
    matrix[..., 3, :, 0], matrix[..., 3, :, 1] = y, x
    matrix[..., 4, :, 1], matrix[..., 4, :, 2] = z, y
    matrix[..., 5, :, 0], matrix[..., 5, :, 2] = z, x
    return matrix.reshape(*gradient.shape[:-2], 6, 3 * nodes)


def element_stiffness(
    kind: str, nodes: Float, elasticity: Float, formulation: str = "incompatible"
) -> Float:
    """Stiffness matrices of M elements of one type.

    Parameters
    ----------
    kind : "hex8" or "tet4".
    nodes : (M,k,3) float64 coordinates.
    elasticity : (M,6,6) or (6,6) float64, from ``Isotropic.stiffness``.
    formulation : "incompatible" (hex8: nine internal modes, Taylor, Beresford & Wilson, IJNME 10
        (1976) 1211, gradients with the Jacobian at the centre scaled by detJ0/detJ so that the
        patch test holds on distorted elements), "full" (2x2x2 Gauss points; tet4: one point),
        "bbar" (mean dilatation, Hughes, IJNME 15 (1980) 1413).

    Returns (M,3k,3k) float64, exactly symmetric.
    """
    element = ELEMENTS[kind]
    if formulation not in element.formulations:
        raise InputError(
            f"formulation: not available for {kind}; got {formulation!r}; "
            f"expected one of {', '.join(element.formulations)}"
        )
    count, width = len(nodes), 3 * nodes.shape[1]
    result = np.empty((count, width, width))
    for start in range(0, count, _CHUNK):
        part = slice(start, start + _CHUNK)
        moduli = elasticity if elasticity.ndim == 2 else elasticity[part]
        # coordinates relative to the first node: large offsets don't cost digits
        local = nodes[part] - nodes[part, :1]
        result[part] = _chunk_stiffness(kind, local, moduli, formulation)
    return result


def _chunk_stiffness(kind: str, nodes: Float, elasticity: Float, formulation: str) -> Float:
    element = ELEMENTS[kind]
    # jacobian[m,q,i,j] = d x_i / d xi_j
    jacobian = np.einsum("mki,qkj->mqij", nodes, element.gradient)
    determinant = np.linalg.det(jacobian)
    _refuse_inverted(kind, determinant)
    gradient = np.matmul(element.gradient[None], np.linalg.inv(jacobian))
    volume = determinant * element.weight
    strain = strain_matrix(gradient)
    if formulation == "bbar":
        mean = np.einsum("mqki,mq->mki", gradient, volume) / volume.sum(axis=1)[:, None, None]
        change = ((mean[:, None] - gradient) / 3.0).reshape(*gradient.shape[:2], 1, -1)
        strain[:, :, :3, :] += change
    moduli = elasticity if elasticity.ndim == 2 else elasticity[:, None]
    stress = np.matmul(moduli, strain) * volume[..., None, None]
    matrix = _integral(strain, stress)
    if formulation == "incompatible":
        centre = np.einsum("mki,kj->mij", nodes, element.centre_gradient)
        scale = np.linalg.det(centre)[:, None] / determinant
        modes = np.matmul(element.mode_gradient[None], np.linalg.inv(centre)[:, None])
        inner = strain_matrix(modes * scale[..., None, None])
        coupling = _integral(inner, stress)
        inner_stress = np.matmul(moduli, inner) * volume[..., None, None]
        own = _integral(inner, inner_stress)
        matrix -= np.matmul(coupling.transpose(0, 2, 1), np.linalg.solve(own, coupling))
    return np.asarray(0.5 * (matrix + matrix.transpose(0, 2, 1)))


def _integral(left: Float, right: Float) -> Float:
    """Sum over quadrature points of left^T right, as one matrix product."""
    count, points, rows, width = left.shape
    a = left.reshape(count, points * rows, width)
    b = right.reshape(count, points * rows, right.shape[3])
    return np.asarray(np.matmul(a.transpose(0, 2, 1), b))


def _refuse_inverted(kind: str, determinant: Float) -> None:
    bad = np.flatnonzero(~(determinant > 0.0).all(axis=1))
    if bad.size:
        raise InputError(
            f"{kind}: {bad.size} elements are inverted at a quadrature point; got a Jacobian of "
            f"{determinant[bad].min():.3g}; expected positive volume (see mesh_quality)"
        )
