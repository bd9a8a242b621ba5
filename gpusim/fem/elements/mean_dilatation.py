"""Mean dilatation at finite strain, from an energy: forces are its derivative, tangents symmetric.

The volume ratio J of every point is replaced by the element's mean: the law's energy is taken at
(J_mean / J)^(1/3) F. It is B-bar (Hughes 1980) where motion is small. (F-bar of de Souza Neto et
al. 1996 has no energy, so its tangent isn't symmetric.)
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gpusim.arrays.array_types import Float, Long
from gpusim.fem.elements.element_response import Want, require_upright
from gpusim.fem.elements.finite_strain import (
    IDENTITY,
    add_geometric,
    at_nodes,
    green_lagrange,
    material_part,
    point_matrices,
    point_rows,
    stiffness_of,
    strain_rows,
    volume_change,
)
from gpusim.fem.elements.isoparametric_map import inverse, reference_gradient, times
from gpusim.fem.elements.total_lagrangian import PointMotion, TotalLagrangian


@dataclass(frozen=True, eq=False)
class MeanMotion(PointMotion):
    """With what takes the mean; slope, gradient and strain are those after that.

    stretch : (m,Q) by which the gradient is enlarged, ``share`` (m,Q) of a point in the deformed
        volume, ``spatial`` (3,3,m,Q) dxi_J/dx_i.
    """

    stretch: Float
    share: Float
    spatial: Float


class MeanDilatation(TotalLagrangian):
    """Formulation "bbar" of any cell type; an `ElementResponse`."""

    def response(self, which: Long, u: Float, want: Want) -> tuple[Float, Float | None]:
        """See `ElementResponse`."""
        motion = self._motion(which, u)
        update = self._try(which, motion.strain, want)
        spatial = point_matrices(motion.spatial)
        flux, pressure, excess = self._volumetric(motion, update.stress)
        forces = at_nodes(self.shapes, flux + (excess / 3.0)[..., None, None] * spatial)
        if want is Want.FORCES:
            return forces, None
        assert update.moduli is not None
        # change of strain by slopes, and by the logarithm of the mean volume ratio
        by_mean = _metric(motion.strain) / 3.0
        rows = strain_rows(motion.gradient, motion.geometry.back)
        rows *= motion.stretch
        rows -= by_mean.transpose(2, 0, 1)[:, None, None] * motion.spatial
        volume = motion.geometry.volume[..., None, None]
        moduli = material_part(rows, update.moduli, motion.geometry.volume)
        stress = np.matmul(update.moduli, by_mean[..., None]) * volume
        mixed = np.matmul(point_rows(rows).swapaxes(2, 3), stress).reshape(spatial.shape)
        twice = (by_mean[..., None] * stress).sum(axis=(1, 2, 3))
        crossed: Float | float = 0.0
        if want is Want.TANGENT:
            foretold = self._or_foretold(update.stress, which)
            flux, pressure, excess = self._volumetric(motion, foretold)
            crossed = self._geometric(moduli, motion, foretold)
            mixed += (2.0 / 3.0) * flux - (2.0 / 9.0) * pressure[..., None, None] * spatial
            twice -= pressure.sum(axis=1) / 9.0
        mean = at_nodes(self.shapes, motion.share[..., None, None] * spatial)
        half = at_nodes(self.shapes, mixed) + 0.5 * twice[:, None] * mean
        outer = half[:, :, None] * mean[:, None]
        tangent = stiffness_of(moduli, self.shapes) + crossed
        tangent += outer + outer.swapaxes(1, 2)
        return forces, tangent

    def _motion(self, which: Long, u: Float) -> MeanMotion:
        geometry = self._geometry(which)
        slope = self._slope(geometry, self.block.relative(u, which))
        change = volume_change(slope)
        require_upright(self.name, 1.0 + change)
        volume = geometry.volume
        mean = (volume * change).sum(axis=1, keepdims=True) / volume.sum(axis=1, keepdims=True)
        log = (np.log1p(mean) - np.log1p(change)) / 3.0
        deformed = volume * (1.0 + change)
        share = deformed / deformed.sum(axis=1, keepdims=True)
        spatial = times(slope + IDENTITY, geometry.jacobian)
        spatial = inverse(spatial, geometry.det * (1.0 + change))
        stretch = np.exp(log)
        barred = slope * stretch + np.expm1(log) * IDENTITY
        strain = green_lagrange(barred)
        return MeanMotion(geometry, barred, barred + IDENTITY, strain, stretch, share, spatial)

    def _volumetric(self, motion: MeanMotion, stress: Float) -> tuple[Float, Float, Float]:
        """First Piola-Kirchhoff stress (m,Q,J,i) as of ``_flux``, before it takes the mean of the
        pressure; three times that pressure times deformed volume (m,Q); what the mean adds."""
        flux = self._flux(motion, motion.gradient, stress) * motion.stretch[..., None, None]
        pressure = (stress * _metric(motion.strain)).sum(axis=2) * motion.geometry.volume
        excess = pressure.sum(axis=1, keepdims=True) * motion.share - pressure
        return flux, pressure, excess

    def _geometric(self, moduli: Float, motion: MeanMotion, stress: Float) -> Float:
        """Add to [J,i,k,L] what stress does as slopes change at a given mean volume ratio, and as
        that ratio changes a second time; (m,3k,3k) the part of it that is cheaper by nodes."""
        flux, pressure, excess = self._volumetric(motion, stress)
        square = (motion.stretch**2)[..., None, None]
        add_geometric(moduli, square * self._flux(motion, motion.geometry.back, stress))
        spatial, half = point_matrices(motion.spatial), flux * (-2.0 / 3.0)
        factor = (excess / 3.0 + pressure * (5.0 / 9.0))[..., None, None]
        # products of two of [J,i] with [k,L]
        left = np.stack([spatial, half], axis=-1).reshape(*pressure.shape, 9, 2)
        right = np.stack([half + factor * spatial, spatial], axis=2).swapaxes(3, 4)
        moduli += np.matmul(left, right.reshape(*pressure.shape, 2, 9)).reshape(moduli.shape)
        # the ratio's derivatives by one slope and another's transpose: nodes a, b by axes k, i
        by_node = np.matmul(self.shapes.swapaxes(1, 2), spatial).reshape(*pressure.shape, -1)
        product = np.matmul((by_node * (excess / -3.0)[..., None]).swapaxes(1, 2), by_node)
        count, width = product.shape[:2]
        axes = product.reshape(count, width // 3, 3, width // 3, 3).swapaxes(2, 4)
        return np.asarray(axes.reshape(product.shape))

    def _slope_change(self, which: Long, motion: PointMotion, step: Float) -> Float:
        assert isinstance(motion, MeanMotion)
        slope = reference_gradient(step, self.rule)
        change = (motion.spatial.swapaxes(0, 1) * slope).sum(axis=(0, 1))
        mean = (motion.share * change).sum(axis=1, keepdims=True)
        stretched = motion.stretch * times(slope, motion.geometry.back)
        return np.asarray(stretched + (mean - change) / 3.0 * motion.gradient)


def _metric(strain: Float) -> Float:
    """(…,6) C of the strain (C - 1) / 2, shear doubled: strain by an even stretch."""
    result = 2.0 * strain
    result[..., :3] += 1.0
    return result
