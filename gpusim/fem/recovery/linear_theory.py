"""How far bodies turn by linear theory, and what strain that leaves out: where both are small, it
is right. Where they aren't, `gpusim.fem.procedures.expansion` finds what it is off by.
"""

from __future__ import annotations

import numpy as np

from gpusim.arrays.array_types import Float
from gpusim.fem.elements.polar_rotation import polar_rotation
from gpusim.mesh import CELL_TYPES, Mesh
from gpusim.mesh.shape_functions import reference_nodes, shape_gradients


def cell_rotations(mesh: Mesh, u: Float) -> Float:
    """Rotation vectors (M, 3) in rad at the middle of each cell: half the curl of ``u`` (N, 3)."""
    gradient, _ = _middle_gradients(mesh, u)
    skew = 0.5 * (gradient - gradient.transpose(0, 2, 1))
    return np.asarray(skew[:, [2, 0, 1], [1, 2, 0]])


def turns_over(mesh: Mesh, before: Float, after: Float) -> bool:
    """Whether the middle of a cell turns by more than 120 degrees between displacements ``before``
    and ``after`` (N, 3); one that is pushed through itself along two axes turns by 180."""
    one, other = (np.eye(3) + _middle_gradients(mesh, u)[0] for u in (before, after))
    slope = other @ np.linalg.inv(one) - np.eye(3)
    # the trace of a rotation is 1 + 2 cos
    return bool((np.trace(polar_rotation(slope.transpose(1, 2, 0))) < -3.0).any())


def stretching(mesh: Mesh, u: Float) -> float:
    """How large the strain is that linear theory leaves out, over the one that it has: squares
    summed over the body. Where it is small, linear theory is right, however the body is held."""
    gradient, size = _middle_gradients(mesh, u)
    strain = 0.5 * (gradient + gradient.transpose(0, 2, 1))
    quadratic = 0.5 * np.matmul(gradient.transpose(0, 2, 1), gradient)
    whole, left = (size @ (one**2).sum(axis=(1, 2)) for one in (strain, quadratic))
    return float(left / whole) if whole > 0.0 else 0.0


def _middle_gradients(mesh: Mesh, u: Float) -> tuple[Float, Float]:
    """Of ``u`` at the middle of each cell (M, 3, 3), and what the cells' volumes are like (M,)."""
    gradient, size = np.empty((mesh.cell_count, 3, 3)), np.empty(mesh.cell_count)
    for kind, first, block in mesh.blocks():
        middle = reference_nodes(CELL_TYPES[kind].linear).mean(axis=0)[None]
        slope = shape_gradients(kind, middle)[0]
        jacobian = np.einsum("mki,kj->mij", mesh.points[block], slope)
        own = slice(first, first + len(block))
        gradient[own] = np.einsum("mki,kj->mij", u[block], slope) @ np.linalg.inv(jacobian)
        size[own] = np.linalg.det(jacobian)
    return gradient, size
