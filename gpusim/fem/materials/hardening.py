"""Isotropic hardening: the yield stress as a function of the accumulated plastic strain."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np

from gpusim.arrays.array_types import Float
from gpusim.errors import NotConverged
from gpusim.fem.materials.constants import FROM_ZERO, POSITIVE, constant
from gpusim.validation import finite_numbers, is_number, require

_ITERATIONS = 50
_ROUNDING = 16.0 * np.finfo(np.float64).eps


@dataclass(frozen=True)
class Voce:
    """Exponential saturation: yield + linear p + (saturation - yield) (1 - exp(-rate p)).

    p is the accumulated plastic strain; the constants are K_inf, delta and H of Simo & Hughes
    (Computational Inelasticity, 1998).

    Parameters
    ----------
    saturation : stress that the exponential part tends to, at least the yield stress.
    rate : saturation exponent, > 0.
    linear : modulus of a linear part beside it, >= 0.

    Examples
    --------
    >>> steel = gs.Isotropic(E=206.9e9, nu=0.29)
    >>> hardening = gs.fem.Voce(saturation=715e6, rate=16.93, linear=129.24e6)
    >>> gs.J2(steel, yield_stress=450e6, hardening=hardening).yield_stress
    450000000.0
    """

    saturation: float
    rate: float
    linear: float = 0.0

    def __post_init__(self) -> None:
        for one in fields(self):
            rule = FROM_ZERO if one.name == "linear" else POSITIVE
            value = constant(getattr(self, one.name), f"Voce: {one.name}", rule)
            object.__setattr__(self, one.name, value)


Hardening = float | Voce | Sequence[tuple[float, float]]


def flow_curve(yield_stress: float, hardening: Hardening) -> FlowCurve:
    """The curve that starts at ``yield_stress``. Raises InputError for what isn't hardening."""
    if isinstance(hardening, Voce):
        what = "J2: hardening: saturation below the yield stress"
        expected = f"at least {yield_stress:g}"
        require(hardening.saturation >= yield_stress, what, hardening.saturation, expected)
        return SaturatingCurve(yield_stress, hardening)
    if is_number(hardening):
        slope = constant(hardening, "J2: hardening", FROM_ZERO)
        return PiecewiseLinearCurve(np.zeros(1), np.array([yield_stress]), slope)
    expected = "a number, a Voce or pairs of plastic strain and yield stress"
    count = len(hardening) if isinstance(hardening, Sequence | np.ndarray) else 0
    shape = (max(count, 1), 2)
    strain, stress = finite_numbers(hardening, "J2: hardening", [shape], expected).T
    first = float(strain[0]), float(stress[0])
    expected = f"(0.0, {yield_stress!r}), the yield stress"
    require(first == (0.0, yield_stress), "J2: hardening: the first pair", first, expected)
    for name, steps, rises in (
        ("plastic strains", np.diff(strain), np.diff(strain) > 0.0),
        ("yield stresses", np.diff(stress), np.diff(stress) >= 0.0),
    ):
        at = int(np.argmin(rises)) if len(rises) else 0
        got = f"a step of {steps[at]:g} after pair {at}" if len(rises) else ""
        expected = "rising ones" if name == "plastic strains" else "ones that don't fall"
        require(bool(rises.all()), f"J2: hardening: {name}", got, expected)
    return PiecewiseLinearCurve(strain, stress, 0.0)


class PiecewiseLinearCurve:
    """Straight between some points, then on with a last slope."""

    def __init__(self, strain: Float, stress: Float, last_slope: float) -> None:
        self.strain, self.stress = strain, stress
        self.slope = np.append(np.diff(stress) / np.diff(strain), last_slope)

    def stress_and_slope(self, p: Float) -> tuple[Float, Float]:
        """By the piece that p is in; at a corner, the one that begins there."""
        piece = np.searchsorted(self.strain, p, side="right") - 1
        slope = self.slope[piece]
        return self.stress[piece] + slope * (p - self.strain[piece]), slope

    def increment(self, trial: Float, p: Float, stiffness: float) -> Float:
        """In closed form: yield stress + stiffness p is piecewise linear and rises."""
        levels = self.stress + stiffness * self.strain
        level = trial + stiffness * p
        piece = np.maximum(np.searchsorted(levels, level, side="right") - 1, 0)
        over = (level - levels[piece]) / (stiffness + self.slope[piece])
        return np.maximum(self.strain[piece] + over - p, 0.0)


@dataclass(frozen=True)
class SaturatingCurve:
    """Voce's, from a yield stress on."""

    yield_stress: float
    voce: Voce

    def stress_and_slope(self, p: Float) -> tuple[Float, Float]:
        """Yield stress and its derivative."""
        gain, voce = self.voce.saturation - self.yield_stress, self.voce
        exponential = np.exp(-voce.rate * p)
        stress = self.yield_stress + voce.linear * p + gain * (1.0 - exponential)
        return stress, voce.linear + gain * voce.rate * exponential

    def increment(self, trial: Float, p: Float, stiffness: float) -> Float:
        """By Newton's method, which rises to the solution: the slope falls with p."""
        step = np.zeros_like(p)
        for _ in range(_ITERATIONS):
            stress, slope = self.stress_and_slope(p + step)
            excess = trial - stiffness * step - stress
            step = np.maximum(step + excess / (stiffness + slope), 0.0)
            if bool((np.abs(excess) <= _ROUNDING * trial).all()):
                return step
        raise NotConverged(f"J2: no yield stress found in {_ITERATIONS} iterations")


FlowCurve = PiecewiseLinearCurve | SaturatingCurve
"""Yield stress over accumulated plastic strain p, for the return mapping: ``stress_and_slope`` (P,)
at p, and ``increment`` (P,) dp with yield stress at p + dp = trial - stiffness dp, where ``trial``
is above that at p."""
