"""How far linear statics is off where a body turns: an estimate from the linear solution.

For a slender body under forces that keep their direction, the potential of an inextensible bar to
fourth order in its rotation w gives displacements that are less than the linear ones by the share
2 <w^2>, the mean of w^2 weighted by the strain energy: a quarter because the bar keeps its length,
three because the forces' arms get shorter (of a cantilever with a force F at its tip, that is
(4/35) (F L^2 / E I)^2, as for the elastica). Without forces (heat, given displacements) the arms
don't matter, and a bar of constant curvature has <w^2> / 4, weighted by volume. What stress along
the bar does beside, pressing or pulling, is of first order: the work of the stress on the
rotations over that of the forces. 1 / sqrt(1 + 2 x) goes on from the first order x as the elastica
does: within 9 % of its error up to F L^2 / E I = 3, where linear theory is 66 % too far.

A bar that turns by w is also drawn longer by w^2 / 2, which an exact solution isn't.

Bodies held at both ends also stiffen because they are stretched; that isn't in the estimate:
`stretching` bounds it, and `gpusim.fem.procedures.expansion` finds it.
"""

from __future__ import annotations

import numpy as np

from gpusim.arrays.array_types import Float
from gpusim.fem.elements.polar_rotation import polar_rotation
from gpusim.fem.model.model import Model
from gpusim.fem.recovery.stress import Stress, stress
from gpusim.mesh import CELL_TYPES, Mesh
from gpusim.mesh.shape_functions import reference_nodes, shape_gradients


def second_order(
    model: Model,
    u: Float,
    formulation: str,
    *,
    forced: bool = True,
    temperature: float | None = None,
) -> tuple[float, float]:
    """What an exact solution has of the linear displacements ``u`` (N, 3), about (above 0), and
    the mean strain by which they make the body too long.

    ``forced``: forces act, not heat or given displacements alone.
    """
    turn = cell_rotations(model.mesh, u)
    square = np.einsum("mi,mi->m", turn, turn)
    found = stress(model, u, formulation, temperature=temperature)
    weight = found.energy if forced else found.volume
    total = float(weight.sum())
    if not total > 0.0:
        return 1.0, 0.0
    loss = (2.0 if forced else 0.25) * float(square @ weight) / total
    pressed = _pressed(found, turn, square) if forced else 0.0
    bent = 1.0 / np.sqrt(1.0 + 2.0 * loss)
    longer = 0.5 * bent**2 * float(square @ found.volume) / float(found.volume.sum())
    return float(bent / max(1.0 - pressed, 0.1)), float(longer)


def _pressed(found: Stress, turn: Float, square: Float) -> float:
    """Share that displacements grow by, to first order, where the stress presses along the body."""
    xx, yy, zz, xy, yz, zx = found.cell.T
    x, y, z = turn.T
    own = xx * x * x + yy * y * y + zz * z * z + 2.0 * (xy * x * y + yz * y * z + zx * z * x)
    work = (square * (xx + yy + zz) - own) @ found.volume
    return float(-work / (2.0 * found.energy.sum()))


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
