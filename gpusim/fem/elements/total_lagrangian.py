"""Elements at finite strain, in the reference configuration: forces and tangents of many elements.

The plain displacement form, of any cell type and rule; forms that mend its locking derive from it.
Slopes are taken along the reference cell's axes: there the nodes' gradients are the same tables in
every element, so that a tangent is the law's moduli pulled back to these axes, [J,i,k,L] at each
point, between two products with a table.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gpusim.arrays.array_types import Float, Long
from gpusim.fem.elements.element_response import (
    ElementBlock,
    ForetoldStress,
    Internal,
    PointValues,
    Want,
    require_upright,
)
from gpusim.fem.elements.finite_strain import (
    IDENTITY,
    add_geometric,
    green_lagrange,
    largest_principal_strain,
    material_part,
    node_rows,
    point_matrices,
    pushed_forward,
    reference_shapes,
    stiffness_of,
    strain_change,
    strain_rows,
    tensor,
    volume_change,
)
from gpusim.fem.elements.isoparametric_map import determinant, inverse, reference_gradient, times
from gpusim.fem.materials.law import Law, Update


@dataclass(frozen=True, eq=False)
class PointGeometry:
    """Cells at rest: ``jacobian`` dX_I/dxi_J, its inverse ``back`` dxi_J/dX_I (3,3,m,Q), its
    determinant and the points' volumes (m,Q)."""

    jacobian: Float
    back: Float
    det: Float
    volume: Float


@dataclass(frozen=True, eq=False)
class PointMotion:
    """Deformation at the points of chosen elements.

    slope : (3,3,m,Q) du_i/dX_j as the law sees it; ``gradient`` is one more.
    strain : (m,Q,6) Green-Lagrange strain of it.
    """

    geometry: PointGeometry
    slope: Float
    gradient: Float
    strain: Float


class TotalLagrangian:
    """Displacement form of the elements of ``block``; an `ElementResponse`.

    Keeps 48 bytes a point for foretold stresses once these are asked for, and the law's states
    twice. Raises InputError for elements inverted at a quadrature point.
    """

    def __init__(self, block: ElementBlock) -> None:
        self.block, self.name, self.cells = block, block.name, block.cells
        assert isinstance(block.law, Law)
        self.rule, self.law = block.rule, block.law
        self.shapes = reference_shapes(self.rule)
        count, points = len(block.cells), len(self.rule.weight)
        self._foretold = ForetoldStress((count, points, 6))
        size = self.law.state_size
        self._state = np.zeros((count, points, size)) if size else None
        self._trial = None if self._state is None else self._state.copy()
        self._free_strain = block.free_strain

    def response(self, which: Long, u: Float, want: Want) -> tuple[Float, Float | None]:
        """See `ElementResponse`."""
        motion = self._motion(which, u)
        update = self._update(which, motion.strain, want is not Want.FORCES)
        flux = self._flux(motion, motion.gradient, update.stress)
        forces = np.matmul(node_rows(self.shapes), flux.reshape(len(which), -1, 3))
        forces = forces.reshape(len(which), -1)
        if want is Want.FORCES:
            return forces, None
        assert update.moduli is not None
        geometry = motion.geometry
        rows = strain_rows(motion.gradient, geometry.back)
        moduli = material_part(rows, update.moduli, geometry.volume)
        if want is Want.TANGENT:
            stress = self._foretold.instead_of(update.stress, which)
            add_geometric(moduli, self._flux(motion, geometry.back, stress))
        return forces, stiffness_of(moduli, self.shapes)

    def advance(self, which: Long, u: Float, du: Float, foretell: bool) -> None:
        """See `ElementResponse`; laws with a history foretell nothing."""
        if not foretell or self._state is not None:
            self._foretold.valid[which] = False
            return
        # S + dS/dE : dE, by the linear part of the strain
        motion = self._motion(which, u)
        update = self._law(which, motion.strain, True)
        assert update.moduli is not None
        change = self._slope_change(which, motion, self.block.relative(du, which))
        strain = strain_change(motion.gradient, change)
        added = np.matmul(update.moduli, strain[..., None])[..., 0]
        self._foretold.put(which, update.stress + added)

    def forget_foretold(self) -> None:
        """See `ElementResponse`."""
        self._foretold.forget()

    def snapshot(self) -> Internal:
        """See `ElementResponse`."""
        # states aren't written to: a commit puts others in their place
        return Internal(None, self._foretold.copy(), self._state)

    def restore(self, internal: Internal) -> None:
        """See `ElementResponse`."""
        self._foretold = internal.foretold.copy()
        self._state = internal.state
        self._trial = None if self._state is None else self._state.copy()

    def commit(self, u: Float) -> None:
        """See `ElementResponse`."""
        self._state = self._trial
        self._trial = None if self._state is None else self._state.copy()

    def set_free_strain(self, free_strain: Float | None) -> None:
        """See `ElementResponse`."""
        self._free_strain = free_strain

    def strain_extent(self, which: Long, u: Float) -> Float:
        """See `ElementResponse`."""
        return largest_principal_strain(self._motion(which, u).strain)

    def point_values(self, which: Long, u: Float) -> PointValues:
        """See `ElementResponse`; of the committed state."""
        motion = self._motion(which, u)
        stress = self._law(which, motion.strain, False).stress
        ratio = 1.0 + volume_change(motion.slope)
        cauchy = pushed_forward(motion.gradient, stress) / ratio[..., None]
        return PointValues(cauchy, stress, motion.strain, motion.geometry.volume)

    def _geometry(self, which: Long) -> PointGeometry:
        jacobian = reference_gradient(self.block.relative(self.block.points, which), self.rule)
        det = determinant(jacobian)
        return PointGeometry(jacobian, inverse(jacobian, det), det, det * self.rule.weight)

    def _slope(self, geometry: PointGeometry, nodal: Float) -> Float:
        return times(reference_gradient(nodal, self.rule), geometry.back)

    def _motion(self, which: Long, u: Float) -> PointMotion:
        geometry = self._geometry(which)
        return self._moved(geometry, self._slope(geometry, self.block.relative(u, which)))

    def _moved(self, geometry: PointGeometry, slope: Float) -> PointMotion:
        require_upright(self.name, 1.0 + volume_change(slope))
        return PointMotion(geometry, slope, slope + IDENTITY, green_lagrange(slope))

    def _slope_change(self, which: Long, motion: PointMotion, step: Float) -> Float:
        """(3,3,m,Q) linear change of the law's slope by a step (m,k,3) of the nodes."""
        return self._slope(motion.geometry, step)

    def _law(self, which: Long, strain: Float, moduli: bool) -> Update:
        if self._free_strain is not None:
            strain = strain - self._free_strain[which]
        state = None if self._state is None else self._state[which]
        return self.law.update(strain, state, moduli=moduli)

    def _update(self, which: Long, strain: Float, moduli: bool) -> Update:
        update = self._law(which, strain, moduli)
        if self._trial is not None:
            self._trial[which] = update.state
        return update

    def _flux(self, motion: PointMotion, left: Float, stress: Float) -> Float:
        """(m,Q,J,i) of left_iM S_ML dxi_J/dX_L times volume: stress across the reference cell's
        surfaces, first Piola-Kirchhoff with the deformation gradient on the left."""
        weighted = tensor(stress) * motion.geometry.volume
        return point_matrices(times(motion.geometry.back, times(weighted, left.swapaxes(0, 1))))
