"""The linear element turned with its cell: forces and tangents of large motion with small strain.

W(x) = d.K d / 2 with d_a = R^T x_a - X_a, R the polar rotation of the deformation gradient
sum x_a (x) G_a at the cell's centre, and K the linear matrix, whatever its formulation. At rest
it is that matrix. d is small where strain is, whatever the rotation, and no stress acts on
internal modes: none buckles. (Moita & Crisfield, IJNME 39 (1996) 3775; projectors as Nour-Omid &
Rankin 1991, Felippa & Haugen 2005, here with the exact spin of the polar rotation.)
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from gpusim.arrays.array_types import Float, Long
from gpusim.fem.elements.element import ELEMENTS
from gpusim.fem.elements.element_response import (
    ElementBlock,
    ForetoldStress,
    Internal,
    PointValues,
    Want,
    centre_slope,
    require_upright,
)
from gpusim.fem.elements.finite_strain import (
    largest_principal_strain,
    pushed_forward,
    strain_change,
)
from gpusim.fem.elements.isoparametric_map import determinant, inverse, reference_gradient, times
from gpusim.fem.elements.polar_rotation import polar_rotation
from gpusim.fem.elements.strain import internal_force, point_stress

_CHUNK = 512


class LinearMatrices(Protocol):
    """Matrices of elements, in their order."""

    def at(self, which: Long) -> Float:
        """(m,3k,3k) of the elements ``which``."""
        ...


@dataclass(frozen=True, eq=False)
class CellFrame:
    """Chosen cells and the rotation of each.

    gradient : (m,k,3) G of the nodes at the centre.
    rotation : (m,3,3) R, and ``turn`` R - 1.
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


class Corotational:
    """Elements of ``block`` whose linear matrices are ``matrices``; an `ElementResponse`.

    Free strain acts in the turned cell: heat follows the material. Keeps 24 bytes a node for
    foretold forces once these are asked for.
    """

    def __init__(self, block: ElementBlock, matrices: LinearMatrices) -> None:
        self.block, self.matrices = block, matrices
        self.name, self.cells = block.name, block.cells
        count, nodes = block.cells.shape
        self._foretold = ForetoldStress((count, 3 * nodes))
        self.set_free_strain(block.free_strain)

    def response(self, which: Long, u: Float, want: Want) -> tuple[Float, Float | None]:
        """See `ElementResponse`."""
        frame = self._frame(which, u)
        matrices = self.matrices.at(which)
        local = self._local_force(which, matrices, frame.strained)
        balanced, _ = _balanced(frame, local)
        forces = np.matmul(balanced, frame.rotation.swapaxes(1, 2)).reshape(local.shape)
        if want is Want.FORCES:
            return forces, None
        by_spin = _skew(frame.position)
        turned = np.matmul(matrices, by_spin)
        stiffness = np.matmul(by_spin.swapaxes(1, 2), turned)
        if want is Want.TANGENT:
            stress = self._foretold.instead_of(local, which)
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
        if not foretell:
            self._foretold.valid[which] = False
            return
        frame = self._frame(which, u)
        motion = np.matmul(self.block.relative(du, which), frame.rotation)
        spin = np.matmul(frame.spin, motion.reshape(len(which), -1, 1))
        motion += np.matmul(_skew(frame.position), spin).reshape(motion.shape)
        strained = frame.strained + motion.reshape(frame.strained.shape)
        self._foretold.put(which, self._local_force(which, self.matrices.at(which), strained))

    def forget_foretold(self) -> None:
        """See `ElementResponse`."""
        self._foretold.forget()

    def snapshot(self) -> Internal:
        """See `ElementResponse`."""
        return Internal(None, self._foretold.copy(), None)

    def restore(self, internal: Internal) -> None:
        """See `ElementResponse`."""
        self._foretold = internal.foretold.copy()

    def commit(self, u: Float) -> None:
        """See `ElementResponse`; there is nothing to keep."""

    def set_free_strain(self, free_strain: Float | None) -> None:
        """See `ElementResponse`."""
        self._free_strain, self._free_force = free_strain, None
        if free_strain is not None:
            count = len(self.cells)
            chunks = range(0, count, _CHUNK)
            parts = [np.arange(start, min(start + _CHUNK, count)) for start in chunks]
            self._free_force = np.concatenate([self._held_force(which) for which in parts])

    def strain_extent(self, which: Long, u: Float) -> Float:
        """See `ElementResponse`."""
        return largest_principal_strain(self.point_values(which, u).strain)

    def point_values(self, which: Long, u: Float) -> PointValues:
        """See `ElementResponse`. Stress in the cell's frame is taken for second Piola-Kirchhoff
        stress; the strain is what belongs to it, with the quadratic part of the nodes' motion."""
        frame, block = self._frame(which, u), self.block
        nodes = block.relative(block.points, which)
        strained = frame.strained.reshape(nodes.shape)
        moduli = block.law.stiffness()
        free = None if self._free_strain is None else self._free_strain[which]
        stress, volume = point_stress(self.name, block.formulation, nodes, strained, moduli, free)
        jacobian = reference_gradient(nodes, block.rule)
        slope = reference_gradient(strained, block.rule)
        slope = times(slope, inverse(jacobian, determinant(jacobian)))
        strain = stress @ np.linalg.inv(moduli)
        strain += 0.5 * strain_change(slope, slope)
        if free is not None:
            strain += free
        rotation = frame.rotation.transpose(1, 2, 0)[..., None]
        return PointValues(pushed_forward(rotation, stress), stress, strain, volume)

    def _held_force(self, which: Long) -> Float:
        """(m,3k) linear nodal forces of the free strain, in the cell's frame: those of cells whose
        nodes are held, with the sign changed."""
        block = self.block
        nodes = block.relative(block.points, which)
        kind = self.name, block.formulation, nodes
        moduli = block.law.stiffness()
        assert self._free_strain is not None
        held, _ = point_stress(*kind, np.zeros_like(nodes), moduli, self._free_strain[which])
        return -internal_force(*kind, held).reshape(len(nodes), -1)

    def _local_force(self, which: Long, matrices: Float, strained: Float) -> Float:
        force: Float = np.matmul(matrices, strained[..., None])[..., 0]
        return force if self._free_force is None else force - self._free_force[which]

    def _frame(self, which: Long, u: Float) -> CellFrame:
        block = self.block
        nodes, motion = block.relative(block.points, which), block.relative(u, which)
        centre = ELEMENTS[self.name].centre_gradient
        jacobian = centre_slope(nodes, centre)
        back = inverse(jacobian, determinant(jacobian))
        gradient = np.matmul(centre, back.transpose(2, 0, 1))
        slope = centre_slope(motion, gradient)
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
        return CellFrame(
            gradient,
            by_turn + np.eye(3),
            nodes + strained,
            strained.reshape(len(nodes), -1),
            spin,
            resistance,
        )


def _skew(vectors: Float) -> Float:
    """(m,3k,3) matrices of the products with vectors (m,k,3), one below the other."""
    count, nodes, _ = vectors.shape
    return np.asarray((vectors.reshape(-1, 3) @ _CROSS).reshape(count, 3 * nodes, 3))


_CROSS = np.array([[0.0, 0, 0, 0, 0, -1, 0, 1, 0], [0, 0, 1, 0, 0, 0, -1, 0, 0],
                   [0, -1, 0, 1, 0, 0, 0, 0, 0]])  # fmt: skip
"""(3,9) of v: the matrix of v x w."""


def _balanced(frame: CellFrame, force: Float) -> tuple[Float, Float]:
    """Forces (m,3k) less what turns the cell, (m,k,3), and the spin (m,3) of their moment, which is
    of second order: stress times strain."""
    by_node = force.reshape(frame.position.shape)
    moment = np.matmul(force[:, None], _skew(frame.position))
    couple = np.matmul(frame.resistance, -moment.swapaxes(1, 2))[..., 0]
    # G_a x n
    return by_node + np.matmul(_skew(frame.gradient), couple[..., None]).reshape(
        by_node.shape
    ), couple


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
