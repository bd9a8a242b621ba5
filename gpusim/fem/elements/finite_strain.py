"""Finite strain at points of elements, written out by components.

A tensor field keeps the cell and the point last, (3,3,M,Q), as in `isoparametric_map`. ``slope`` is
the displacement gradient du_i/dX_j: strains of it keep their digits however small they are.
"""

from __future__ import annotations

from functools import cache

import numpy as np
import numpy.typing as npt

from gpusim.arrays.array_types import Float
from gpusim.fem.elements.element import Rule
from gpusim.fem.elements.isoparametric_map import times

PAIRS = ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (2, 0))
"""The axes of a component xx yy zz xy yz zx."""
IDENTITY = np.eye(3)[..., None, None]


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
    a = slope
    minors = a[0, 0] * a[1, 1] - a[0, 1] * a[1, 0]
    change = a[0, 0] + a[1, 1] + a[2, 2] + minors
    change += a[1, 1] * a[2, 2] - a[1, 2] * a[2, 1] + a[0, 0] * a[2, 2] - a[0, 2] * a[2, 0]
    change += minors * a[2, 2] + a[0, 1] * a[1, 2] * a[2, 0] + a[0, 2] * a[1, 0] * a[2, 1]
    change -= a[0, 0] * a[1, 2] * a[2, 1] + a[0, 2] * a[1, 1] * a[2, 0]
    return np.asarray(change)


def tensor(stress: Float) -> Float:
    """(3,3,…) of symmetric (…,6)."""
    result = np.empty((3, 3, *stress.shape[:-1]))
    for column, (i, j) in enumerate(PAIRS):
        result[i, j] = result[j, i] = stress[..., column]
    return result


def components(matrix: Float) -> Float:
    """(…,6) of symmetric (3,3,…)."""
    return np.stack([matrix[i, j] for i, j in PAIRS], axis=-1)


def pushed_forward(gradient: Float, stress: Float) -> Float:
    """(…,6) F S F^T of gradients F (3,3,…) and stresses (…,6)."""
    return components(times(times(gradient, tensor(stress)), gradient.swapaxes(0, 1)))


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


def reference_shapes(rule: Rule) -> Float:
    """(Q,3,k) gradients of a rule's shape functions, contiguous."""
    return np.ascontiguousarray(rule.gradient.transpose(0, 2, 1))


def largest_principal_strain(strain: Float) -> Float:
    """(m,) largest size of a principal Biot strain at the points of cells, of Green-Lagrange
    strains (m,Q,6)."""
    axial, shear = strain[..., :3], 0.5 * strain[..., 3:]
    mean = axial.mean(axis=-1)
    a, b, c = np.moveaxis(axial - mean[..., None], -1, 0)
    xy, yz, zx = np.moveaxis(shear, -1, 0)
    size = np.sqrt((a * a + b * b + c * c + 2.0 * (xy * xy + yz * yz + zx * zx)) / 6.0)
    scale = np.where(size > 0.0, size, 1.0)
    a, b, c, xy, yz, zx = (one / scale for one in (a, b, c, xy, yz, zx))
    det = a * (b * c - yz * yz) - xy * (xy * c - yz * zx) + zx * (xy * yz - b * zx)
    angle = np.arccos(np.clip(0.5 * det, -1.0, 1.0)) / 3.0
    ends = [mean + 2.0 * size * np.cos(angle + turn) for turn in (0.0, 2.0 * np.pi / 3.0)]
    # 1 + 2 E is a square: below zero by rounding alone
    biot = [2.0 * e / (1.0 + np.sqrt(np.maximum(1.0 + 2.0 * e, 0.0))) for e in ends]
    return np.asarray(np.abs(biot).max(axis=(0, 2)))
