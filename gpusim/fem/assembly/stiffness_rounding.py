"""What the rounding of the stiffness itself does to the displacements, and products without it.

K_ij is known to half a unit in its last place. A stiff part that turns as a rigid body on
something soft, or a slender body's end, moves by differences u_j - u_i that strain nothing, yet
K_ij (u_j - u_i) is rounded all the same: forces of about

    eps/2 * sum_j |K_ij| |u_j - u_i|

of random sign act where none should. No residual shows them, because it is rounded alike. Their
displacements do: K^-1 times such forces (Higham, Accuracy and Stability, 2002, section 7.2).

An element matrix in float64 doesn't leave a turned element at rest either: it answers with forces
of its own rounding, in proportion to the turn. Taken off before the product (the idea of
corotational elements, here for small rotations: Felippa & Haugen, Comput. Methods Appl. Mech.
Engrg. 194, 2005), the turn leaves rounding in proportion to the strain alone (``Deformation``). For
that the deformation must be known to more digits than float64 has (see
`gpusim.arrays.error_free_sums`).
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property, partial
from itertools import pairwise

import numpy as np

from gpusim.arrays.array_types import Float, Long
from gpusim.arrays.error_free_sums import high_half, two_sum
from gpusim.arrays.unique import mix
from gpusim.errors import NotConverged
from gpusim.fem.assembly.element_batches import Elements, Group
from gpusim.fem.elements.element import ELEMENTS
from gpusim.fem.elements.isoparametric_map import add_to, determinant, inverse, times
from gpusim.fem.model.model import Model
from gpusim.fem.sparse.block_rows import BlockRows
from gpusim.fem.sparse.stiffness_product import apply_stiffness
from gpusim.mesh import mesh_quality
from gpusim.parallel.threads import shared

# elements that are taken at a time, so that their numbers stay in the cache
_PORTION = 1024
# elements of a kind, on average, from which on each kind is taken by itself
_ALIKE = 32
# of an element of unit size: what rounding makes of a determinant that should vanish
_FLAT = 64.0 * np.finfo(np.float64).eps
# of float64's spacing, times the Jacobian's condition: what the numbers of element matrices are off
# by. Against 80 bits forces are up to 3 times that (flat bricks with incompatible modes: 10 times);
# that all terms of a node add up makes far more of it than solutions feel
_OWN_ROUNDING = 1.0


def check_finite(values: Float, what: str) -> None:
    """Raise NotConverged unless all ``values`` are finite."""
    if not np.isfinite(values).all():
        raise NotConverged(
            f"{what}: got values that aren't finite; expected finite numbers "
            "(is the stiffness of some material or the size of some element extreme?)"
        )


def indefinite(where: str, error: float | None = None) -> NotConverged:
    """What a Cholesky factorisation that broke down means to the user, or one that just didn't:
    ``error`` is what rounding alone may do to its solution, relative to that."""
    seen = "" if error is None else f" (its rounding alone may change the solution by {error:.0%})"
    return NotConverged(
        f"{where}: the stiffness isn't positive definite in float64{seen}; got a body whose "
        "softest motions vanish beside its stiffest (is it extremely slender, nearly free, of "
        "extremely unequal elements or materials, or under-integrated, as single rows of 'reduced' "
        "elements are?); expected better proportions, or full integration"
    )


class Deformation:
    """The elements of a body with nodes at ``points`` (N,3)."""

    def __init__(self, groups: Sequence[Elements], points: Float) -> None:
        self._groups, self._points = groups, points

    def product(self, u: Float) -> Float:
        """K u (L,N,3) of displacements (L,N,3)."""
        return np.stack([self._added(one, absolute=False) for one in u])

    def rounding(self, u: Float) -> Float:
        """As much as the rounding of the element matrices can do to ``product``: (L,N,3), not
        negative."""
        return np.stack([self._added(one, absolute=True) for one in u])

    @cached_property
    def condition(self) -> Float:
        """(N,) the greatest ``condition`` of a node's elements."""
        result = np.ones(len(self._points))
        for group in self._groups:
            if isinstance(group, Group):
                _, first = np.unique(group.matrix_of, return_index=True)
                conditions = condition(group.name, self._points[group.cells[first]])[
                    group.matrix_of
                ]
            else:
                parts = shared(partial(self._of, group), _parts(group))
                conditions = np.concatenate(parts)
            np.maximum.at(result, group.cells, conditions[:, None])
        return result

    def _of(self, group: Elements, which: Long) -> Float:
        return condition(group.name, self._points[group.cells[which]])

    def _added(self, u: Float, absolute: bool) -> Float:
        total = np.zeros_like(u)
        for group in self._groups:
            if isinstance(group, Group):
                group.remember()
            size = 1.0
            if absolute:
                # equal elements are rounded alike: their errors add up and don't average out
                size = _OWN_ROUNDING * np.finfo(np.float64).eps
                size *= np.sqrt(len(group.cells) / group.distinct)
            for which, forces in shared(partial(self._forces, group, u, absolute), _parts(group)):
                add_to(total, group.cells[which], size * forces)
        return total

    def _forces(self, group: Elements, u: Float, absolute: bool, which: Long) -> tuple[Long, Float]:
        """Forces (m,k,3) of some elements, as ``_parts`` gives them."""
        cells = group.cells[which]
        strained = deformation(self._points[cells], u[cells]).reshape(len(cells), -1)
        alike = _alike(group)
        matrices = group.at(which[:1] if alike else which)
        if absolute:
            matrices, strained = np.abs(matrices), np.abs(strained)
            strained = strained * condition(group.name, self._points[cells])[:, None]
        if alike:
            forces = strained @ matrices[0]
        else:
            forces = np.matmul(matrices, strained[..., None])[..., 0]
        return which, forces.reshape(len(cells), -1, 3)


def condition(name: str, points: Float) -> Float:
    """(M,) how many times the rounding of their nodes' coordinates (M,k,3) cells feel in their
    Jacobian's inverse: 1 of bricks along the axes, of turned and flat ones their aspect.

    The greatest number of |J^-1| (sum of |x_k| |grad N_k|) at the centre (the componentwise
    condition of Higham, Accuracy and Stability, 2002, section 7.2).
    """
    gradient = ELEMENTS[name].centre_gradient
    arm = (points - points[:, :1]).transpose(2, 0, 1)
    jacobian = (arm @ gradient).transpose(0, 2, 1)
    terms = (np.abs(arm) @ np.abs(gradient)).transpose(0, 2, 1)
    size = determinant(jacobian)
    back = np.abs(inverse(jacobian, np.where(size > 0.0, size, 1.0)))
    return np.asarray(np.maximum(1.0, times(back, terms).max(axis=(0, 1))))


def _alike(group: Elements) -> bool:
    """Whether parts of it are of one kind each."""
    return isinstance(group, Group) and len(group.cells) >= _ALIKE * group.distinct


def _parts(group: Elements) -> list[Long]:
    """A group's elements, some at a time; of one kind where many are."""
    order = np.arange(len(group.cells))
    bounds = [0, len(order)]
    if isinstance(group, Group) and _alike(group):
        order = np.argsort(group.matrix_of, kind="stable")
        ends = np.cumsum(np.bincount(group.matrix_of, minlength=group.distinct))
        bounds = [0, *ends.tolist()]
    return [
        order[start : min(start + _PORTION, last)]
        for first, last in pairwise(bounds)
        for start in range(first, last, _PORTION)
    ]


def deformation(points: Float, u: Float) -> Float:
    """Displacements ``u`` (M,k,3) of elements with nodes at ``points`` (M,k,3), less a rigid motion
    that is near to theirs: by their first node's displacement and the rotation w that fits the
    others best (least squares).

    Each number is right to float64's digits of itself, or to 1e-32 of ``u``: w is rounded to 26
    bits, and (u_j - u_0) - w x (x_j - x_0) is formed with the errors of its terms.
    """
    # components first, elements last: (3,k,M)
    place, moved = (np.ascontiguousarray(one.transpose(2, 1, 0)) for one in (points, u))
    arm, arm_rest = two_sum(place, -place[:, :1])
    step, step_rest = two_sum(moved, -moved[:, :1])
    turn = high_half(_rotation(arm, step))[:, None]
    high = high_half(arm)
    low = arm - high
    result = np.empty_like(step)
    for c in range(3):
        a, b = (c + 1) % 3, (c + 2) % 3
        total, rest = step[c], step_rest[c] - (turn[a] * arm_rest[b] - turn[b] * arm_rest[a])
        for part in (high, low):
            for term in (-turn[a] * part[b], turn[b] * part[a]):
                total, lost = two_sum(total, term)
                rest += lost
        result[c] = total + rest
    return np.ascontiguousarray(result.transpose(2, 1, 0))


def _rotation(arm: Float, step: Float) -> Float:
    """(3,M) rotation vectors of elements whose nodes at ``arm`` (3,k,M) move by ``step``."""
    arm = arm - arm.mean(axis=1, keepdims=True)
    # in units of the element, so that no product leaves the range of numbers
    size = np.abs(arm).max(axis=(0, 1))
    arm /= np.where(size > 0.0, size, 1.0)
    square = np.einsum("ikm,jkm->ijm", arm, arm)
    inertia = -square
    for axis in range(3):
        inertia[axis, axis] += np.einsum("iim->m", square)
    moment = np.cross(arm, step - step.mean(axis=1, keepdims=True), axis=0).sum(axis=1)
    det = determinant(inertia)
    # nodes on a line have no rotation about it
    solid = det > _FLAT
    turned = np.einsum("ijm,jm->im", inverse(inertia, np.where(solid, det, 1.0)), moment)
    return np.asarray(np.where(solid, turned / np.where(solid, size, 1.0), 0.0))


def rounding_forces(rows: BlockRows, u: Float) -> Float:
    """Forces (L,N,3) as large as the rounding in K u, of fixed pseudo-random sign."""
    # equal rows are rounded alike: along a uniform beam their errors add up and don't average out
    together = np.sqrt(rows.node_count / rows.class_count)
    size = apply_stiffness(rows, u, absolute=True) * (0.5 * np.finfo(np.float64).eps * together)
    return signed(size)


def signed(size: Float) -> Float:
    """Forces of these sizes (L,N,3), of fixed pseudo-random sign."""
    shape = size.shape[1:]
    sign = (mix(np.arange(size[0].size), 9) >> np.uint64(63)).astype(np.float64).reshape(shape)
    return np.asarray(size * (2.0 * sign - 1.0))


def extremes(model: Model) -> str:
    """What makes a model hard to solve in float64, in words; "" where nothing stands out."""
    causes = []
    points = model.mesh.points
    centred = points - points.mean(axis=0)
    spread = np.sqrt(np.maximum(np.linalg.eigvalsh(centred.T @ centred), 0.0))
    if not spread[2] <= 50.0 * spread[0]:
        causes.append(f"a slenderness of {spread[2] / max(spread[0], 1e-300):.2g}")
    aspect = float(mesh_quality(model.mesh).aspect.max())
    if not aspect <= 20.0:
        causes.append(f"elements of aspect {aspect:.2g}")
    stiffness = [float(np.linalg.eigvalsh(m.stiffness()).max()) for m in model.materials]
    if not max(stiffness) <= 1e3 * min(stiffness):
        causes.append(f"stiffnesses in the ratio {max(stiffness) / min(stiffness):.2g}")
    values = [np.linalg.eigvalsh(m.stiffness()) for m in model.materials]
    softest = max(float(one.max() / one.min()) for one in values)
    if not softest <= 100.0:
        causes.append(f"a nearly incompressible material (moduli in the ratio {softest:.2g})")
    extent = [
        np.linalg.norm(np.ptp(points[block], axis=1), axis=1)
        for block in model.mesh.cells.values()
        if len(block)
    ]
    largest, smallest = max(float(e.max()) for e in extent), min(float(e.min()) for e in extent)
    if not largest <= 100.0 * smallest:
        causes.append(f"element sizes in the ratio {largest / smallest:.2g}")
    return ", ".join(causes)
