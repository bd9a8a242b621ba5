"""Elements at finite strain, in the reference configuration: forces and tangents of many elements.

The plain displacement form, of any cell type and rule; forms that mend its locking derive from it.
Slopes are taken along the reference cell's axes: there the nodes' gradients are the same tables in
every element, so that a tangent is the law's moduli pulled back to these axes, [J,i,k,L] at each
point, between two products with a table.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from gpusim.arrays.array_types import Float, Long
from gpusim.errors import NotConverged
from gpusim.fem.elements.element_response import (
    ElementBlock,
    ElementResponse,
    PointValues,
    Want,
    require_upright,
)
from gpusim.fem.elements.finite_strain import (
    IDENTITY,
    add_geometric,
    at_nodes,
    definite,
    green_lagrange,
    material_part,
    point_matrices,
    pushed_forward,
    stiffness_of,
    strain_change,
    strain_rows,
    tensor,
    volume_change,
)
from gpusim.fem.elements.heated_material import HeatedMaterial
from gpusim.fem.elements.isoparametric_map import determinant, inverse, reference_gradient, times
from gpusim.fem.materials.law import Law, Update, results_of


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


class TotalLagrangian(ElementResponse):
    """Displacement form of the elements of ``block``; an `ElementResponse`.

    Keeps 48 bytes a point for foretold stresses, and the law's states twice.
    """

    by_moduli = False  # whether forces take moduli, too

    def __init__(self, block: ElementBlock) -> None:
        self.rule, self.law = block.rule, block.law
        points, size = (len(block.cells), len(self.rule.weight)), block.law.state_size
        super().__init__(block, (*points, 6), (*points, size) if size else None)
        self.shapes = np.ascontiguousarray(self.rule.gradient.transpose(0, 2, 1))

    def response(self, which: Long, u: Float, want: Want) -> tuple[Float, Float | None]:
        """See `ElementResponse`."""
        motion = self._motion(which, u)
        update = self._try(which, motion.strain, want)
        forces = at_nodes(self.shapes, self._flux(motion, motion.gradient, update.stress))
        if want is Want.FORCES:
            return forces, None
        assert update.moduli is not None
        geometry = motion.geometry
        rows = strain_rows(motion.gradient, geometry.back)
        moduli = material_part(rows, update.moduli, geometry.volume)
        if want is Want.TANGENT:
            stress = self._or_foretold(update.stress, which)
            add_geometric(moduli, self._flux(motion, geometry.back, stress))
        return forces, stiffness_of(moduli, self.shapes)

    def advance(self, which: Long, u: Float, du: Float, foretell: bool) -> None:
        """See `ElementResponse`."""
        self._foretold[which] = np.nan
        if not foretell or self._state is not None:
            return
        # S + dS/dE : dE, by the linear part of the strain
        motion = self._motion(which, u)
        update = self._law(which, motion.strain, True)
        assert update.moduli is not None
        change = self._slope_change(which, motion, self.block.relative(du, which))
        strain = strain_change(motion.gradient, change)
        added = np.matmul(update.moduli, strain[..., None])[..., 0]
        self._foretold[which] = update.stress + added

    def point_values(self, which: Long, u: Float) -> PointValues:
        """See `ElementResponse`."""
        motion = self._motion(which, u)
        stress = self._law(which, motion.strain, False).stress
        ratio = 1.0 + volume_change(motion.slope)
        cauchy = pushed_forward(motion.gradient, stress) / ratio[..., None]
        results = results_of(self._material(which), motion.strain, self._history(which))
        return PointValues(cauchy, stress, motion.strain, motion.geometry.volume, results)

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

    def _material(self, which: Long) -> Law | HeatedMaterial:
        if self.free_strain is None:
            return self.law
        heated = HeatedMaterial(self.law, self.free_strain[which])
        require_upright(f"{self.name}, free to expand", heated.volume)
        return heated

    def _history(self, which: Long) -> Float | None:
        return None if self._state is None else self._state[which]

    def _law(self, which: Long, strain: Float, moduli: bool) -> Update:
        update = self._material(which).update(strain, self._history(which), moduli=moduli)
        if not np.isfinite(update.stress).all():
            raise NotConverged(
                f"{type(self.law).__name__}: got a stress that isn't finite, of strains up to "
                f"{np.abs(strain).max():.3g}; expected finite numbers"
            )
        return update

    def _try(self, which: Long, strain: Float, want: Want) -> Update:
        """The law's answer, whose states are those of the step if it is the last; with definite
        moduli for the material part."""
        update = self._law(which, strain, self.by_moduli or want is not Want.FORCES)
        if want is Want.MATERIAL and update.moduli is not None:
            update = replace(update, moduli=definite(update.moduli))
        if self._trial is not None:
            self._trial[which] = update.state
        return update

    def _flux(self, motion: PointMotion, left: Float, stress: Float) -> Float:
        """(m,Q,J,i) of left_iM S_ML dxi_J/dX_L times volume: stress across the reference cell's
        surfaces, first Piola-Kirchhoff with the deformation gradient on the left."""
        weighted = tensor(stress) * motion.geometry.volume
        return point_matrices(times(motion.geometry.back, times(weighted, left.swapaxes(0, 1))))
