"""The linear element turned with its cell: forces and tangents of large motion with small strain.

W(x) = d.K d / 2 with d_a = R^T x_a - X_a, R the polar rotation of the cell's mean deformation
gradient sum x_a (x) G_a, and K the linear matrix, whatever its formulation. At rest it is that
matrix. d is small where strain is, whatever the rotation, and no stress acts on internal modes:
none buckles. With the gradient at the centre instead, distorted cells would miss the patch test
where stress and strain have different axes. (Moita & Crisfield, IJNME 39 (1996) 3775; projectors
as Nour-Omid & Rankin 1991, Felippa & Haugen 2005, here with the exact spin of the polar rotation.)
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from gpusim.arrays.array_types import Float, Long
from gpusim.fem.elements.element_response import (
    ElementBlock,
    ElementResponse,
    PointValues,
    Want,
    nodal_slope,
    require_upright,
)
from gpusim.fem.elements.finite_strain import (
    green_lagrange,
    pushed_forward,
    tensor,
)
from gpusim.fem.elements.isoparametric_map import (
    cross_matrices,
    determinant,
    inverse,
    times,
    volumes,
)
from gpusim.fem.elements.polar_rotation import polar_rotation
from gpusim.fem.elements.strain import internal_force, point_stress

_CHUNK = 512


class LinearMatrices(Protocol):
    """Matrices of elements, in their order."""

    def at(self, which: Long) -> Float:
        """(m,3k,3k) of the elements ``which``."""


@dataclass(frozen=True, eq=False)
class CellFrame:
    """Chosen cells and the rotation of each.

    gradient : (m,k,3) mean gradients G of the nodes.
    rotation : (m,3,3) R.
    position : (m,k,3) y = R^T x, relative to the first node; ``strained`` d of it (m,3k).
    spin : (m,3,3k) of the cell by turned motion of the nodes; ``resistance`` (m,3,3) what maps
        moments to it, the inverse of (tr U - U).
    """

    gradient: Float
    rotation: Float
    position: Float
    strained: Float
    spin: Float
    resistance: Float


class Corotational(ElementResponse):
    """Elements of ``block`` whose linear matrices are ``matrices``; an `ElementResponse`.

    Free strain acts in the turned cell: heat follows the material. Keeps 48 bytes a node: mean
    gradients, and foretold forces.
    """

    def __init__(self, block: ElementBlock, matrices: LinearMatrices) -> None:
        super().__init__(block, (len(block.cells), 3 * block.cells.shape[1]), None)
        self.matrices = matrices
        numbers = np.arange(len(block.cells))
        chunks = np.split(numbers, numbers[_CHUNK::_CHUNK])
        self._gradient = np.concatenate([self._mean_gradient(which) for which in chunks])

    def response(self, which: Long, u: Float, want: Want) -> tuple[Float, Float | None]:
        """See `ElementResponse`."""
        frame = self._frame(which, u)
        matrices = self.matrices.at(which)
        local = self._local_force(which, matrices, frame.strained)
        balanced, _ = _balanced(frame, local)
        forces = np.matmul(balanced, frame.rotation.swapaxes(1, 2)).reshape(local.shape)
        if want is Want.FORCES:
            return forces, None
        # d moves by (1 + S w) v, with spin w v: a matrix of rank 3 and its transpose beside K
        by_spin = _skew(frame.position)
        turned = np.matmul(matrices, by_spin)
        stiffness = np.matmul(by_spin.swapaxes(1, 2), turned)
        if want is Want.TANGENT:
            stress = self._or_foretold(local, which)
            geometric, inner = _geometric(frame, stress, by_spin)
            turned += geometric
            stiffness += inner
        turned += 0.5 * np.matmul(frame.spin.swapaxes(1, 2), stiffness)
        rank = np.matmul(turned, frame.spin)
        tangent = matrices + rank
        tangent += rank.swapaxes(1, 2)
        return forces, _turned(tangent, frame.rotation)

    def advance(self, which: Long, u: Float, du: Float, foretell: bool) -> None:
        """See `ElementResponse`."""
        self._foretold[which] = np.nan
        if not foretell:
            return
        frame = self._frame(which, u)
        motion = np.matmul(self.block.relative(du, which), frame.rotation)
        spin = np.matmul(frame.spin, motion.reshape(len(which), -1, 1))
        motion += np.matmul(_skew(frame.position), spin).reshape(motion.shape)
        strained = frame.strained + motion.reshape(frame.strained.shape)
        self._foretold[which] = self._local_force(which, self.matrices.at(which), strained)

    def point_values(self, which: Long, u: Float) -> PointValues:
        """See `ElementResponse`. Stress in the cell's frame is taken for second Piola-Kirchhoff
        stress; the strain is that of the stretch that belongs to it."""
        frame, block = self._frame(which, u), self.block
        stress, volume = self._point_stress(which, frame.strained)
        strain = stress @ np.linalg.inv(block.law.stiffness())
        results = {"energy": 0.5 * (stress * strain).sum(axis=2)}
        if self.free_strain is not None:
            strain += self.free_strain[which]
        strain = green_lagrange(tensor(strain * [1.0, 1.0, 1.0, 0.5, 0.5, 0.5]))
        rotation = frame.rotation.transpose(1, 2, 0)[..., None]
        return PointValues(pushed_forward(rotation, stress), stress, strain, volume, results)

    def _point_stress(self, which: Long, strained: Float) -> tuple[Float, Float]:
        """Stress (m,Q,6) in the cell's frame and volume (m,Q)."""
        block = self.block
        nodes = block.relative(block.points, which)
        free = None if self.free_strain is None else self.free_strain[which]
        moved, moduli = strained.reshape(nodes.shape), block.law.stiffness()
        return point_stress(self.name, block.formulation, nodes, moved, moduli, free)

    def _local_force(self, which: Long, matrices: Float, strained: Float) -> Float:
        """(m,3k) in the cell's frame."""
        if self.free_strain is None:
            return np.asarray(np.matmul(matrices, strained[..., None])[..., 0])
        block = self.block
        nodes = block.relative(block.points, which)
        stress, _ = self._point_stress(which, strained)
        force = internal_force(self.name, block.formulation, nodes, stress)
        return force.reshape(strained.shape)

    def _mean_gradient(self, which: Long) -> Float:
        """(m,k,3) of the nodes: the forces of an even pressure, over the volume."""
        nodes = self.block.relative(self.block.points, which)
        volume = volumes(nodes, self.block.rule)
        stress = np.ones((*volume.shape, 1)) * [1.0, 1.0, 1.0, 0.0, 0.0, 0.0]
        force = internal_force(self.name, self.block.formulation, nodes, stress)
        return np.asarray(force / volume.sum(axis=1)[:, None, None])

    def _frame(self, which: Long, u: Float) -> CellFrame:
        block = self.block
        nodes, motion = block.relative(block.points, which), block.relative(u, which)
        gradient = self._gradient[which]
        slope = nodal_slope(motion, gradient)
        deformation = slope + np.eye(3)[..., None]
        require_upright(self.name, determinant(deformation))
        turn = polar_rotation(slope)
        rotation = turn + np.eye(3)[..., None]
        stretch = times(rotation.swapaxes(0, 1), deformation)
        stretch = 0.5 * (stretch + stretch.swapaxes(0, 1))
        # spin of R^T dR by the turned motion v of the nodes: (tr U - U) w = sum G_a x v_a
        moment = np.trace(stretch) * np.eye(3)[..., None] - stretch
        resistance = np.ascontiguousarray(inverse(moment, determinant(moment)).transpose(2, 0, 1))
        by_turn = np.ascontiguousarray(turn.transpose(2, 0, 1))
        # R^T x - X is u + (R - 1)^T x: as exact as u is
        strained = motion + np.matmul(nodes + motion, by_turn)
        crossed = _skew(gradient).reshape(*gradient.shape, 3).transpose(0, 2, 1, 3)
        spin = np.matmul(resistance, crossed.reshape(len(nodes), 3, -1))
        position, flat = nodes + strained, strained.reshape(len(nodes), -1)
        return CellFrame(gradient, by_turn + np.eye(3), position, flat, spin, resistance)


def _skew(vectors: Float) -> Float:
    """(m,3k,3) matrices of the products with vectors (m,k,3), one below the other."""
    return cross_matrices(vectors).reshape(len(vectors), -1, 3)


def _balanced(frame: CellFrame, force: Float) -> tuple[Float, Float]:
    """Forces (m,3k) less what turns the cell, (m,k,3), and the spin (m,3) of their moment, which is
    of second order: stress times strain."""
    by_node = force.reshape(frame.position.shape)
    moment = np.matmul(force[:, None], _skew(frame.position))
    couple = np.matmul(frame.resistance, -moment.swapaxes(1, 2))[..., 0]
    crossed: Float = np.matmul(_skew(frame.gradient), couple[..., None])
    return by_node + crossed.reshape(by_node.shape), couple


def _geometric(frame: CellFrame, force: Float, by_spin: Float) -> tuple[Float, Float]:
    """What forces (m,3k) add to the tangent, before it meets the spin: forces that turn, the change
    of their moment (m,3k,3), and what spin makes of them (m,3,3)."""
    balanced, couple = _balanced(frame, force)
    of_force = _skew(force.reshape(balanced.shape))
    crossed = np.matmul(of_force.swapaxes(1, 2), by_spin)
    change = frame.gradient[..., None] * couple[:, None, None]
    along = np.matmul(frame.gradient, couple[..., None])
    change -= along[..., None] * np.eye(3)
    both = 0.5 * (change.reshape(by_spin.shape) - of_force - _skew(balanced))
    return both, -0.5 * (crossed + crossed.swapaxes(1, 2))


def _turned(tangent: Float, rotation: Float) -> Float:
    """R K_ab R^T for each pair of nodes."""
    count, width = tangent.shape[:2]
    nodes = width // 3
    right = np.matmul(tangent.reshape(count, nodes * width, 3), rotation.swapaxes(1, 2))
    turned = np.matmul(rotation[:, None], right.reshape(count, nodes, 3, width))
    return np.asarray(turned.reshape(count, width, width))
