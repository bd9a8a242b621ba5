"""Finite strain at points of elements, written out by components.

A tensor field keeps the cell and the point last, (3,3,M,Q), as in `isoparametric_map`. ``slope`` is
the displacement gradient du_i/dX_j: strains of it keep their digits however small they are.
"""

from __future__ import annotations

from functools import cache

import numpy as np
import numpy.typing as npt

from gpusim.arrays.array_types import Float
from gpusim.fem.elements.isoparametric_map import determinant, times
from gpusim.fem.materials.symmetric_tensors import FULL

PAIRS = ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (2, 0))
"""The axes of a component xx yy zz xy yz zx."""
IDENTITY = np.eye(3)[..., None, None]
_LEAST_STIFFNESS = 1e-3


def green_lagrange(slope: Float) -> Float:
    """(M,Q,6) Green-Lagrange strain, engineering shear."""
    return strain_change(IDENTITY + 0.5 * slope, slope)


def strain_change(gradient: Float, slope: Float) -> Float:
    """(M,Q,6) change of that strain, sym(F^T dH), by a change of slope at a gradient F."""
    result = np.empty((*slope.shape[2:], 6))
    f, h = gradient, slope
    for column, (i, j) in enumerate(PAIRS):
        total = f[0, i] * h[0, j] + f[1, i] * h[1, j] + f[2, i] * h[2, j]
        if i != j:
            total += f[0, j] * h[0, i] + f[1, j] * h[1, i] + f[2, j] * h[2, i]
        result[..., column] = total
    return result


def volume_change(slope: Float) -> Float:
    """(…) determinant of the deformation gradient, less one."""
    h = slope
    minors = sum(h[i, i] * h[j, j] - h[i, j] * h[j, i] for i, j in PAIRS[3:])
    return np.asarray(h[0, 0] + h[1, 1] + h[2, 2] + minors + determinant(h))


def tensor(stress: Float) -> Float:
    """(3,3,…) of symmetric (…,6)."""
    return np.take(np.moveaxis(stress, -1, 0), FULL, axis=0)


def pushed_forward(gradient: Float, stress: Float) -> Float:
    """(…,6) F S F^T of gradients F (3,3,…) and stresses (…,6)."""
    pushed = times(times(gradient, tensor(stress)), gradient.swapaxes(0, 1))
    return np.stack([pushed[i, j] for i, j in PAIRS], axis=-1)


def definite(moduli: Float) -> Float:
    """Moduli (…,6,6) without directions in which they aren't positive: eigenvalues of at least a
    thousandth of the greatest."""
    values, vectors = np.linalg.eigh(moduli)
    if (values[..., 0] > _LEAST_STIFFNESS * values[..., -1]).all():
        return moduli
    values = np.maximum(values, _LEAST_STIFFNESS * values[..., -1:])
    return np.asarray(np.matmul(vectors * values[..., None, :], vectors.swapaxes(-1, -2)))


def point_matrices(matrix: Float) -> Float:
    """(M,Q,a,b), contiguous, of (a,b,M,Q)."""
    return np.ascontiguousarray(np.moveaxis(matrix, (0, 1), (2, 3)))


def strain_rows(gradient: Float, back: Float) -> Float:
    """(6,3,3,M,Q): change of strain s by the change of reference slope du_i/dxi_J, [s,J,i].

    ``gradient`` F[i,I] of the state, ``back`` dxi_J/dX_I.
    """
    count, points = gradient.shape[2:]
    # a stride that isn't a power of two: columns of one don't share their lines of the cache
    padded = np.empty((6, 3, 3, count * points + 8))
    rows = padded[..., :-8].reshape(6, 3, 3, count, points)
    for s, (i, j) in enumerate(PAIRS):
        np.multiply(back[:, None, j], gradient[None, :, i], out=rows[s])
        if i != j:
            rows[s] += back[:, None, i] * gradient[None, :, j]
    return rows


def point_rows(rows: Float) -> Float:
    """(M,Q,6,9), contiguous, of (6,3,3,M,Q)."""
    return np.ascontiguousarray(rows.transpose(3, 4, 0, 1, 2)).reshape(*rows.shape[3:], 6, 9)


def material_part(rows: Float, moduli: Float, volume: Float) -> Float:
    """(M,Q,3,3,3,3) second derivative of energy by slopes, [J,i,k,L], of moduli (6,6) or
    (M,Q,6,6), ``rows`` as of ``strain_rows`` and volumes (M,Q)."""
    stress = np.matmul(moduli, point_rows(rows.swapaxes(1, 2)))
    stress *= volume[..., None, None]
    second = np.matmul(point_rows(rows).swapaxes(2, 3), stress)
    return np.asarray(second.reshape(*volume.shape, 3, 3, 3, 3))


def add_geometric(moduli: Float, flux: Float) -> None:
    """Add stresses (M,Q,3,3), in reference axes and times volume, to [J,i,k,L]."""
    for i in range(3):
        moduli[:, :, :, i, i, :] += flux


def point_sums(left: Float, right: Float) -> Float:
    """(M,a,b,c,d) sum over points of left (a,b,M,Q) times right (c,d,M,Q)."""
    first = left.reshape(9, *left.shape[2:]).transpose(1, 0, 2)
    second = right.reshape(9, *right.shape[2:]).transpose(1, 2, 0)
    return np.asarray(np.matmul(first, second).reshape(-1, 3, 3, 3, 3))


def node_rows(gradient: Float) -> Float:
    """(…,k,3Q) of gradients (…,Q,3,k): what contracts point values [Q,J,…] to nodes."""
    tall = np.moveaxis(gradient, -1, -3)
    return np.ascontiguousarray(tall).reshape(*tall.shape[:-2], -1)


def at_nodes(gradient: Float, flux: Float) -> Float:
    """(M,3k) forces of fluxes (M,Q,J,i), with gradients as of ``stiffness_of``."""
    forces: Float = np.matmul(node_rows(gradient), flux.reshape(len(flux), -1, 3))
    return forces.reshape(len(flux), -1)


def stiffness_of(moduli: Float, gradient: Float) -> Float:
    """(M,3k,3k) of [J,i,k,L] at points, with gradients (Q,3,k) or (M,Q,3,k) of the nodes."""
    count, points = moduli.shape[:2]
    nodes = gradient.shape[-1]
    half = np.matmul(moduli.reshape(count, points, 27, 3), gradient)
    both = np.matmul(node_rows(gradient), half.reshape(count, 3 * points, 9 * nodes))
    by_node = np.take(both.reshape(count, -1), _order(nodes), axis=1)
    return by_node.reshape(count, 3 * nodes, 3 * nodes)


@cache
def _order(nodes: int) -> npt.NDArray[np.intp]:
    """Where the entries (a,i,b,k) are in (a,i,k,b)."""
    return np.arange(9 * nodes * nodes).reshape(nodes, 3, 3, nodes).swapaxes(2, 3).ravel()


def largest_principal_strain(strain: Float) -> Float:
    """(m,) largest size of a principal Biot strain at the points of cells, of Green-Lagrange
    strains (m,Q,6)."""
    values = np.linalg.eigvalsh(tensor(strain * [1.0, 1.0, 1.0, 0.5, 0.5, 0.5]).T)
    # 1 + 2 E is a square: below zero by rounding alone
    biot = np.sqrt(np.maximum(1.0 + 2.0 * values, 0.0)) - 1.0
    return np.asarray(np.abs(biot).max(axis=(0, 2)))
