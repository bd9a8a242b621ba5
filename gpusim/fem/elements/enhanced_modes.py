"""The incompatible hexahedron at finite strain: its modes transposed behind the centre's motion.

F = F_u + F_0 sum_c h_c (x) a_c with the modes' gradients h_c of the linear element (Taylor,
Beresford & Wilson 1976) and F_0 at the cell's centre (Glaser & Armero, Eng. Comput. 14 (1997)
759). It is the linear element where motion is small, and pressure softens no mode. (It does with
F_u + sum_c a_c (x) h_c: cells a times as long as thick buckle at a strain of 1/a^2.)

Modes are eliminated from the tangent and move with each global step. Solving for them inside each
element is far less robust.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from gpusim.arrays.array_types import Float, Long
from gpusim.errors import NotConverged
from gpusim.fem.elements.element import mode_gradient
from gpusim.fem.elements.element_response import ElementBlock, Internal, Want, nodal_slope
from gpusim.fem.elements.finite_strain import (
    IDENTITY,
    add_geometric,
    at_nodes,
    material_part,
    node_rows,
    point_matrices,
    point_rows,
    point_sums,
    stiffness_of,
    strain_rows,
    tensor,
)
from gpusim.fem.elements.isoparametric_map import times
from gpusim.fem.elements.total_lagrangian import PointMotion, TotalLagrangian


@dataclass(frozen=True, eq=False)
class ModeMotion(PointMotion):
    """With what the modes add.

    mode_slope : (3,3,m,Q) H with F = F_u + F_0 H. ``mode_gradients`` (3,3,m,Q) of the modes, [k,c];
        ``moved`` F_0 times these.
    centre_gradient : (m,k,3) of the nodes at the centre, at rest.
    """

    mode_slope: Float
    mode_gradients: Float
    moved: Float
    centre_gradient: Float


class EnhancedModes(TotalLagrangian):
    """hex8 "incompatible"; an `ElementResponse`.

    Keeps 72 bytes an element for the modes and 1,800 for their elimination, beside what
    `TotalLagrangian` keeps.
    """

    by_moduli = True

    def __init__(self, block: ElementBlock) -> None:
        super().__init__(block)
        count, width = len(block.cells), 3 * block.cells.shape[1]
        self._modes = np.zeros((count, 9))
        # their last step, and the forces on them where it has led to
        self._mode_step = np.zeros((count, 9))
        self._forces = np.zeros((count, 9))
        # motion of modes, with the sign changed, by their own forces and by unit motions of nodes
        self._elimination = np.zeros((count, 9, width + 1))

    def response(self, which: Long, u: Float, want: Want) -> tuple[Float, Float | None]:
        """See `ElementResponse`. Forces that come with the material part are those left after
        condensation with it; a step after forces alone moves the modes by the last tangent's
        elimination."""
        motion = self._motion(which, u)
        geometry, count = motion.geometry, len(which)
        update = self._try(which, motion.strain, want)
        assert update.moduli is not None
        rows, shapes = strain_rows(motion.gradient, geometry.back), self._moved_shapes(motion)
        inner, mixed = self._mode_moduli(motion, rows, update.moduli)
        outer = np.matmul(node_rows(shapes), mixed).reshape(count, -1, 9)
        if want is not Want.MATERIAL:
            stress = self._or_foretold(update.stress, which)
            added = self._mode_geometric(motion, shapes, stress)
            inner, outer = inner + added[0], outer + added[1]
        self._forces[which] = self._mode_forces(motion, update.stress)
        right = self._forces[which, :, None]
        if want is not Want.FORCES:
            right = np.concatenate([right, outer.swapaxes(1, 2)], axis=2)
        solved = self._solved(inner, right)
        if want is not Want.MATERIAL:
            self._elimination[which, :, : right.shape[2]] = solved
        forces = at_nodes(shapes, self._flux(motion, motion.gradient, update.stress))
        forces -= np.matmul(outer, solved[..., :1])[..., 0]
        if want is Want.FORCES:
            return forces, None
        moduli = material_part(rows, update.moduli, geometry.volume)
        if want is Want.TANGENT:
            add_geometric(moduli, self._flux(motion, geometry.back, stress))
        return forces, stiffness_of(moduli, shapes) - np.matmul(outer, solved[..., 1:])

    def advance(self, which: Long, u: Float, du: Float, foretell: bool) -> None:
        """See `ElementResponse`."""
        super().advance(which, u, du, foretell)
        self._mode_step[which] = self._mode_change(which, self.block.relative(du, which))
        self._modes[which] += self._mode_step[which]

    def work_of_modes(self, du: Float) -> float:
        """See `ElementResponse`."""
        nodal = self.block.relative(du, np.arange(len(self.cells)))
        by_nodes = np.matmul(self._elimination[..., 1:], nodal.reshape(len(nodal), -1, 1))[..., 0]
        return float(np.vdot(self._forces, self._mode_step + by_nodes))

    def shorten(self, share: float) -> None:
        """See `ElementResponse`."""
        self._modes -= (1.0 - share) * self._mode_step
        self._mode_step *= share

    def snapshot(self) -> Internal:
        """See `ElementResponse`."""
        return replace(super().snapshot(), modes=self._modes.copy())

    def restore(self, internal: Internal) -> None:
        """See `ElementResponse`."""
        super().restore(internal)
        assert internal.modes is not None
        self._modes = internal.modes.copy()

    def _motion(self, which: Long, u: Float) -> ModeMotion:
        geometry, block = self._geometry(which), self.block
        gradient, back, det = block.centre(which)
        nodal = block.relative(u, which)
        of_centre = IDENTITY + nodal_slope(nodal, gradient)[..., None]
        amplitude = mode_gradient(self.rule)[:, range(3), range(3)].T[None, :, None]
        modes = back.swapaxes(0, 1)[..., None] * amplitude * (det[:, None] / geometry.det)
        mode_slope = times(modes, _by_component(self._modes[which]))
        slope = self._slope(geometry, nodal) + times(of_centre, mode_slope)
        plain = vars(self._moved(geometry, slope))
        return ModeMotion(**plain, mode_slope=mode_slope, mode_gradients=modes,
                          moved=times(of_centre, modes), centre_gradient=gradient)  # fmt: skip

    def _moved_shapes(self, motion: ModeMotion) -> Float:
        """(m,Q,3,k) slopes by motion of the nodes, which moves F_0 too."""
        turned = times(motion.mode_slope, motion.geometry.jacobian).swapaxes(0, 1)
        by_centre = motion.centre_gradient.swapaxes(1, 2)[:, None]
        return np.asarray(self.shapes + np.matmul(point_matrices(turned), by_centre))

    def _mode_forces(self, motion: ModeMotion, stress: Float) -> Float:
        """(m,9) of the modes, [J,c]."""
        piola = times(motion.gradient, tensor(stress) * motion.geometry.volume)
        total: Float = times(piola.swapaxes(0, 1), motion.moved).sum(axis=3)
        return total.reshape(9, -1).T

    def _mode_moduli(self, motion: ModeMotion, rows: Float, moduli: Float) -> tuple[Float, Float]:
        """Second derivatives of energy by the modes (m,9,9), and by slopes and modes (m,3Q,27),
        [J] and [i,L,c]: the material part."""
        volume = motion.geometry.volume
        count = len(volume)
        pulled = times(motion.gradient.swapaxes(0, 1), motion.moved)
        mode_rows = point_rows(strain_rows(pulled.swapaxes(0, 1), IDENTITY))
        by_modes = np.matmul(moduli, mode_rows)
        by_modes *= volume[..., None, None]
        flat = mode_rows.reshape(count, -1, 9)
        inner = np.matmul(flat.swapaxes(1, 2), by_modes.reshape(count, -1, 9))
        mixed = np.matmul(point_rows(rows).swapaxes(2, 3), by_modes)
        return inner, mixed.reshape(count, -1, 27)

    def _mode_geometric(
        self, motion: ModeMotion, shapes: Float, stress: Float
    ) -> tuple[Float, Float]:
        """What stress adds to the second derivatives by the modes (m,9,9), and by the nodes and
        the modes (m,3k,9): their gradients change together, and motion of nodes turns the modes."""
        weighted = tensor(stress) * motion.geometry.volume
        metric = times(motion.moved.swapaxes(0, 1), motion.moved)
        inner = point_sums(weighted, metric).transpose(0, 1, 3, 2, 4)
        count, points, _, nodes = shapes.shape
        across = np.matmul(shapes.swapaxes(2, 3), self._flux(motion, IDENTITY, stress))
        moved = point_matrices(motion.moved).reshape(count, points, 9)
        sums = np.matmul(across.reshape(count, points, -1).swapaxes(1, 2), moved)
        outer = sums.reshape(count, nodes, 3, 3, 3).swapaxes(2, 3)
        turned = point_sums(times(motion.gradient, weighted), motion.mode_gradients)
        turned = turned.transpose(0, 3, 1, 2, 4).reshape(count, 3, 27)
        turning = np.matmul(motion.centre_gradient, turned).reshape(count, -1, 9)
        return inner.reshape(count, 9, 9), turning + outer.reshape(turning.shape)

    def _solved(self, inner: Float, right: Float) -> Float:
        """The modes' motion, with the sign changed, by the columns of ``right``."""
        try:
            return np.asarray(np.linalg.solve(inner, right))
        except np.linalg.LinAlgError:
            raise NotConverged(
                f"{self.name}: the internal modes of a cell have lost their stiffness; got a "
                "singular matrix; expected a smaller step"
            ) from None

    def _mode_change(self, which: Long, step: Float) -> Float:
        """(m,9) by a step (m,k,3) of the nodes."""
        solved = self._elimination[which]
        by_nodes = np.matmul(solved[..., 1:], step.reshape(len(step), -1, 1))[..., 0]
        return np.asarray(-solved[..., 0] - by_nodes)

    def _slope_change(self, which: Long, motion: PointMotion, step: Float) -> Float:
        assert isinstance(motion, ModeMotion)
        turning = nodal_slope(step, motion.centre_gradient)[..., None]
        change = super()._slope_change(which, motion, step) + times(turning, motion.mode_slope)
        return change + times(motion.moved, _by_component(self._mode_change(which, step)))


def _by_component(modes: Float) -> Float:
    """(3,3,m,1), [c,J], of modes (m,9)."""
    return modes.reshape(-1, 3, 3).transpose(2, 1, 0)[..., None]
