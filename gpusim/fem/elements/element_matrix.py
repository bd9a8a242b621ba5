"""Element stiffness matrices in float64, many elements at a time.

A gradient G_a of node a's shape function gives the block of nodes a and b

    K_ij = integral of C_ikjl G_ak G_bl = C_ikjl H_kl,    H_kl = integral of G_ak G_bl,

so that only H is summed over the quadrature points and the moduli C enter once, afterwards. That
is several times less work than B^T D B with its six strain rows per point.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

import numpy as np
import numpy.typing as npt

from gpusim.arrays.array_types import Float
from gpusim.fem.elements.element import ELEMENTS, Rule, mode_gradient
from gpusim.fem.elements.isoparametric_map import (
    determinant,
    inverse,
    reference_gradient,
    require_positive,
)
from gpusim.fem.materials.symmetric_tensors import FULL

# Numbers in the largest temporary of a chunk: it should stay in the cache.
_CHUNK_NUMBERS = 1 << 17
# Where the modulus C_ikjl of (kl, ij) stands in the 6x6 matrix.
_K, _L, _I, _J = np.indices((3, 3, 3, 3)).reshape(4, 9, 9)
_MODULUS = 6 * FULL[_I, _K] + FULL[_J, _L]


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
    kind: str, nodes: Float, elasticity: Float, formulation: str | None = None
) -> Float:
    """Stiffness matrices of M elements of one type.

    Parameters
    ----------
    kind : cell type, a key of ``ELEMENTS``.
    nodes : (M,k,3) float64 coordinates.
    elasticity : (M,6,6) or (6,6) float64, from a material's ``stiffness()``.
    formulation : one of ``ELEMENTS[kind].formulations``, None: the first. "incompatible" (hex8:
        nine internal modes, Taylor, Beresford & Wilson, IJNME 10 (1976) 1211, gradients with the
        Jacobian at the centre scaled by detJ0/detJ so that the patch test holds on distorted
        elements), "full", "reduced", "exact" (see ``gpusim.fem.elements.element``), "bbar" (hex8,
        tet10: mean dilatation, Hughes, IJNME 15 (1980) 1413).

    Returns (M,3k,3k) float64, exactly symmetric. Raises InputError for an unknown formulation, or
    elements inverted at a quadrature point.
    """
    element = ELEMENTS[kind]
    name = element.formulations[0] if formulation is None else formulation
    rule = element.rule(name)
    count, width = len(nodes), 3 * nodes.shape[1]
    result = np.empty((count, width, width))
    size = max(width * width, 6 * len(rule.weight) * width if name == "bbar" else 0)
    step = max(16, _CHUNK_NUMBERS // size)
    for start in range(0, count, step):
        part = slice(start, start + step)
        moduli = elasticity if elasticity.ndim == 2 else elasticity[part]
        # coordinates relative to the first node: large offsets don't cost digits
        local = nodes[part] - nodes[part, :1]
        gradient, volume, det = _gradients(kind, local, rule)
        if name == "bbar":
            result[part] = _mean_dilatation(gradient, volume, moduli)
            continue
        parts = [gradient]
        if name == "incompatible":
            parts.append(_mode_gradients(local, rule, det))
        matrix = _contract(_products(parts, volume), moduli)
        if name == "incompatible":
            matrix = _condensed(matrix, width)
        np.add(matrix, matrix.transpose(0, 2, 1), out=result[part])
        result[part] *= 0.5
    return result


def volume_gradients(nodes: Float) -> Float:
    """(M,8,3) integrals of the shape gradients of hex8 with nodes (M,8,3): what each displacement
    adds to the volume."""
    rule = ELEMENTS["hex8"].rule("bbar")
    step = _CHUNK_NUMBERS // (24 * len(rule.weight))
    parts = []
    for start in range(0, len(nodes), step):
        part = nodes[start : start + step]
        gradient, volume, _ = _gradients("hex8", part - part[:, :1], rule)
        parts.append(np.einsum("mqik,mq->mki", gradient, volume))
    return np.concatenate(parts)


def _gradients(kind: str, nodes: Float, rule: Rule) -> tuple[Float, Float, Float]:
    """Shape gradients (M,Q,3,k), volumes and Jacobian determinants (M,Q)."""
    count, width = nodes.shape[:2]
    jacobian = reference_gradient(nodes, rule)
    det = determinant(jacobian)
    require_positive(kind, det)
    # back[j,i] = d xi_j / d x_i
    back = inverse(jacobian, det)
    gradient = np.empty((count, len(rule.weight), 3, width))
    for q in range(len(rule.weight)):
        turned = back[:, :, :, q].transpose(2, 1, 0).reshape(3 * count, 3)
        gradient[:, q] = (turned @ rule.gradient[q].T).reshape(count, 3, width)
    return gradient, det * rule.weight, det


def _mode_gradients(nodes: Float, rule: Rule, det: Float) -> Float:
    """(M,Q,3,3) gradients of the internal modes: derivative, then mode."""
    centre = np.tensordot(nodes, ELEMENTS["hex8"].centre_gradient, axes=(1, 0)).transpose(1, 2, 0)
    at_centre = determinant(centre)
    # each mode varies along its own axis alone
    slope = np.einsum("qcc->qc", mode_gradient(rule))
    back = inverse(centre, at_centre).transpose(2, 1, 0)
    modes = back[:, None] * slope[:, None]
    modes *= (at_centre[:, None] / det)[:, :, None, None]
    return np.asarray(modes)


def _products(gradients: Sequence[Float], volume: Float) -> Float:
    """H (M,3k,3k): integral of the products of any two of the gradients (M,Q,3,…), k in all."""
    count, points = volume.shape
    factor = np.sqrt(volume)[:, :, None, None]
    root = np.concatenate([one * factor for one in gradients], axis=3)
    root = root.reshape(count, points, -1)
    return np.asarray(np.matmul(root.transpose(0, 2, 1), root))


def _contract(products: Float, moduli: Float) -> Float:
    """K (M,3k,3k), components of a node together, with K_ij = C_ikjl H_kl."""
    count, size = products.shape[:2]
    inward, outward = _orders(size // 3)
    tensor = modulus_tensor(moduli)
    pairs = np.take(products.reshape(count, -1), inward, axis=1).reshape(count, -1, 9)
    blocks = np.matmul(pairs, tensor).reshape(count, -1)
    return np.take(blocks, outward, axis=1).reshape(products.shape)


def modulus_tensor(moduli: Float) -> Float:
    """(…,9,9) C_ikjl in row kl and column ij, of (…,6,6) moduli."""
    return np.asarray(np.take(moduli.reshape(*moduli.shape[:-2], 36), _MODULUS, axis=-1))


@cache
def _orders(nodes: int) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]:
    """Where the entries (a,b,k,l) are in H, and where the entries (a,i,b,j) of K then are."""
    inside = np.arange(9 * nodes * nodes).reshape(3, nodes, 3, nodes)
    outside = np.arange(9 * nodes * nodes).reshape(nodes, nodes, 3, 3)
    return inside.transpose(1, 3, 0, 2).ravel(), outside.transpose(0, 2, 1, 3).ravel()


def _condensed(matrix: Float, size: int) -> Float:
    """Eliminate the internal modes, which follow the first ``size`` unknowns."""
    inner = matrix[:, size:, :size]
    solved = np.linalg.solve(matrix[:, size:, size:], inner)
    return np.asarray(matrix[:, :size, :size] - np.matmul(inner.transpose(0, 2, 1), solved))


def _mean_dilatation(gradient: Float, volume: Float, moduli: Float) -> Float:
    """B-bar: the volume change of every point is replaced by its mean over the element."""
    nodal = gradient.transpose(0, 1, 3, 2)
    strain = strain_matrix(nodal)
    mean = np.einsum("mqki,mq->mki", nodal, volume) / volume.sum(axis=1)[:, None, None]
    change = ((mean[:, None] - nodal) / 3.0).reshape(*nodal.shape[:2], 1, -1)
    strain[:, :, :3, :] += change
    elastic = moduli if moduli.ndim == 2 else moduli[:, None]
    stress = np.matmul(elastic, strain) * volume[..., None, None]
    count, points, rows, width = strain.shape
    strains = strain.reshape(count, points * rows, width)
    matrix = np.matmul(strains.transpose(0, 2, 1), stress.reshape(count, points * rows, width))
    return np.asarray(0.5 * (matrix + matrix.transpose(0, 2, 1)))
