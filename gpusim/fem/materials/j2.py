"""J2 plasticity (von Mises) with isotropic hardening, in logarithmic strain."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np

from gpusim.arrays.array_types import Float, Long
from gpusim.fem.materials.constants import POSITIVE, constant
from gpusim.fem.materials.hardening import FlowCurve, Hardening, Voce, flow_curve
from gpusim.fem.materials.isotropic import Isotropic
from gpusim.fem.materials.law import Update
from gpusim.fem.materials.logarithmic_strain import LogarithmicStrain
from gpusim.fem.materials.symmetric_tensors import ENGINEERING, components_last
from gpusim.validation import is_number, require, unmasked

# of the yield stress: a state within it has flowed to where it is, and goes on flowing
_ON_SURFACE = 1e-10
# formulations of cells that can flow at constant volume, of cell types of which not all can
_FIT: dict[str, tuple[str, ...]] = {
    "hex8": ("incompatible", "bbar"), "hex20": ("reduced",), "tet10": ("bbar",), "tet4": (),
    "wedge6": (),
}  # fmt: skip


def fit_for_flow(kind: str, formulation: str) -> bool:
    """Whether cells can flow at constant volume; others are far too stiff where metal yields."""
    return formulation in _FIT.get(kind, (formulation,))


@unmasked()
@dataclass(frozen=True)
class J2:
    """Plasticity of metals: von Mises' yield condition, associated flow, isotropic hardening.

    The logarithmic strain is the sum of an elastic and a plastic part (Miehe, Apel & Lambrecht
    2002), so that the return mapping of small strain holds for any; the stress that flows is the
    one that belongs to the logarithmic strain, Kirchhoff's where axes don't turn. Each step is
    integrated by the implicit Euler method, with its own consistent moduli.

    State of a point: plastic logarithmic strain xx yy zz xy yz zx (engineering shear), and the
    accumulated plastic strain, which never falls.

    Parameters
    ----------
    elastic : elasticity, density and thermal expansion.
    yield_stress : true stress at which a bar begins to flow, > 0.
    hardening : a number: linear hardening modulus, >= 0 (0: perfectly plastic); a `Voce`; or
        pairs of plastic strain (logarithmic) and yield stress (true), from (0, yield_stress) on,
        straight between and constant beyond the last.

    Examples
    --------
    >>> steel = gs.J2(gs.Isotropic(200e9, 0.3), yield_stress=250e6, hardening=2e9)
    >>> shear = np.array([[0, 0, 0, 0.01, 0, 0]])
    >>> update = steel.update(shear, np.zeros((1, 7)), moduli=False)
    >>> float((update.stress[0, 3] / 1e6).round(1)), float(update.state[0, 6].round(5))
    (149.8, 0.00465)
    """

    elastic: Isotropic
    yield_stress: float
    hardening: Hardening = 0.0

    state_size: ClassVar[int] = 7
    finite_strain: ClassVar[bool] = True

    def __post_init__(self) -> None:
        fits = isinstance(self.elastic, Isotropic)
        require(fits, "J2: elastic", type(self.elastic).__name__, "an Isotropic")
        value = constant(self.yield_stress, "J2: yield_stress", POSITIVE)
        object.__setattr__(self, "yield_stress", value)
        self._curve  # noqa: B018  refuses what isn't hardening
        if is_number(self.hardening):
            object.__setattr__(self, "hardening", float(self.hardening))  # type: ignore[arg-type]
        elif not isinstance(self.hardening, Voce):
            pairs = tuple((float(p), float(stress)) for p, stress in self.hardening)  # type: ignore[union-attr]
            object.__setattr__(self, "hardening", pairs)

    @cached_property
    def _curve(self) -> FlowCurve:
        return flow_curve(self.yield_stress, self.hardening)

    @property
    def density(self) -> float:
        """Mass per undeformed volume."""
        return self.elastic.density

    def stiffness(self) -> Float:
        """(6,6) stress over strain at rest, order xx yy zz xy yz zx, engineering shear strains."""
        return self.elastic.stiffness()

    def expansion_strain(self) -> Float:
        """(6,) free strain per unit of temperature change."""
        return self.elastic.expansion_strain()

    def update(self, strain: Float, state: Float | None, *, moduli: bool) -> Update:
        """Stress, moduli and state at a Green-Lagrange strain (…,6), from the state (…,7) at the
        end of the last step (None: at rest)."""
        logarithmic = LogarithmicStrain(strain)
        points, shear = logarithmic.components.shape[1], self.elastic.shear
        new = np.zeros((7, points)) if state is None else np.array(state.reshape(points, 7).T)
        deviator = logarithmic.components - new[:6] / ENGINEERING[:, None]
        dilatation = deviator[:3].sum(axis=0)
        deviator[:3] -= dilatation / 3.0
        norm = np.sqrt(ENGINEERING @ (deviator * deviator))
        trial = np.sqrt(6.0) * shear * norm
        flowing, share, slope = self._return_mapping(trial, new[6])
        new[:6] += share * deviator * ENGINEERING[:, None]
        stress = 2.0 * shear * (1.0 - share) * deviator
        stress[:3] += (self.elastic.lame + 2.0 / 3.0 * shear) * dilatation
        matrices = self.stiffness() if moduli else None
        if matrices is not None and len(flowing):
            matrices = np.broadcast_to(matrices, (points, 6, 6)).copy()
            direction = deviator[:, flowing] / norm[flowing]
            matrices[flowing] = self._consistent_moduli(direction, share[flowing], slope)
        pulled_back = logarithmic.pulled_back(stress, matrices)
        return Update(*pulled_back, components_last(new, strain.shape[:-1]))

    def results(self, strain: Float, state: Float) -> dict[str, Float]:
        """The elastic energy and the accumulated plastic strain (…)."""
        plastic = state[..., :6].reshape(-1, 6).T / ENGINEERING[:, None]
        energy = self.elastic.quadratic_energy(LogarithmicStrain(strain).components - plastic)
        return {"energy": energy.reshape(state.shape[:-1]), "plastic_strain": state[..., 6]}

    def _return_mapping(self, trial: Float, p: Float) -> tuple[Long, Float, Float]:
        """Which points flow (F,), or would as soon as they are strained on; the share (P,) of the
        trial deviator that becomes plastic, and the slope (F,) of the yield stress afterwards; p
        (P,) grows in place."""
        share, stress = np.zeros_like(p), self._curve.stress_and_slope(p)[0]
        flowing = np.flatnonzero(trial >= stress * (1.0 - _ON_SURFACE))
        stiffness, start = 3.0 * self.elastic.shear, p[flowing]
        trial, increment = trial[flowing], np.zeros_like(start)
        outside = trial > stress[flowing] * (1.0 + _ON_SURFACE)
        increment[outside] = self._curve.increment(trial[outside], start[outside], stiffness)
        share[flowing] = stiffness * increment / trial
        p[flowing] = start + increment
        return flowing, share, self._curve.stress_and_slope(p[flowing])[1]

    def _consistent_moduli(self, direction: Float, share: Float, slope: Float) -> Float:
        """(F,6,6) derivative of the mapped stress; ``direction`` (6,F) unit deviators, of which
        ``share`` (F,) became plastic, to a yield stress that rises with ``slope`` (F,)."""
        shear = self.elastic.shear
        along = 1.0 / (1.0 + slope / (3.0 * shear)) - share
        deviatoric = np.diag(1.0 / ENGINEERING)
        deviatoric[:3, :3] -= 1.0 / 3.0
        # one product with a constant matrix adds up and puts the components last
        terms = np.empty((37, len(share)))
        np.multiply(along * direction[:, None], direction, out=terms[:36].reshape(6, 6, -1))
        terms[36] = share
        lowered = terms.T @ np.vstack([np.eye(36), deviatoric.ravel()])
        return self.stiffness() - 2.0 * shear * lowered.reshape(-1, 6, 6)
