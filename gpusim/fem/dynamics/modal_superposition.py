"""Modal superposition: each mode by itself, exactly where loads are linear in between instants.

A mode's amplitude obeys q'' + c q' + omega^2 q = p. Over an interval in which p is linear, q, its
rate, its integral and p are a linear system with constant coefficients, whose exponential carries
them from the beginning of the interval to any instant in it (Nigam & Jennings, Bull. Seismol. Soc.
Am. 59 (1969) 909, for all dampings and rigid-body modes).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import expm

from gpusim.arrays.array_types import Float
from gpusim.errors import NotConverged
from gpusim.fem.assembly.equation_of_motion import EquationOfMotion
from gpusim.fem.dynamics.initial_value_problem import InitialValueProblem
from gpusim.fem.krylov.truncated_cg import truncated_cg
from gpusim.fem.linear.shifted_solver import ShiftedSolver
from gpusim.fem.linear.solve_plan import Options
from gpusim.fem.model.damping import Damping
from gpusim.fem.model.modes import Modes
from gpusim.fem.model.record import Record

# instants that are worked on at a time
_CHUNK = 1024
# of forces, that modes are given credit for
_ROUNDING = 1e-9
# of the first elastic eigenvalue: what makes the stiffness of a free body definite
_SHIFT = 0.1


@dataclass(frozen=True, eq=False)
class Oscillators:
    """n modes: ``angular`` frequencies (n,) rad/s, ``damping`` (n,) 1/s, twice the ratio times the
    frequency."""

    angular: Float
    damping: Float

    def propagators(self, tau: Float) -> Float:
        """(m,n,3,5): what the integral of q, q and q' are after times ``tau`` (m,), by what these,
        p and its slope were."""
        lapse, number = np.unique(tau, return_inverse=True)
        angular, damping, t = self.angular, self.damping, lapse[:, None]
        system = np.zeros((len(lapse), len(angular), 5, 5))
        system[..., [0, 1, 2, 3], [1, 2, 3, 4]] = 1.0
        system[..., 2, 1], system[..., 2, 2] = -(angular**2), -damping
        # in units in which nothing grows large: entries of an exponential are as good as its norm
        length = np.where(t > 0.0, t, 1.0) + np.zeros_like(angular)
        rate = np.maximum(angular, 1.0 / length)
        stiff = np.maximum(rate**2, damping / length)
        unit = np.stack([length, np.ones_like(rate), rate, stiff, stiff / length], axis=-1)
        ratio = unit[..., :, None] / unit[..., None, :]
        grown = expm(system / ratio * t[..., None, None])[..., :3, :] * ratio[..., :3, :]
        return np.asarray(grown[number])


@dataclass(frozen=True, eq=False)
class ModalStates:
    """Amplitudes of n modes at m instants (m,n), their rates and accelerations, and the ``work``
    (m,) that the loads have done."""

    amplitude: Float
    rate: Float
    acceleration: Float
    work: Float


class ModalCoordinates:
    """Amplitudes of modes at any instant, from ``amplitude`` and ``rate`` (n,) at the first one of
    ``forcing``: the modal loads (R,n) over modal masses."""

    def __init__(
        self, oscillators: Oscillators, forcing: Record, amplitude: Float, rate: Float
    ) -> None:
        self.oscillators, self._forcing = oscillators, forcing
        lapse, values = np.diff(forcing.times), forcing.values
        slope = np.diff(values, axis=0) / lapse[:, None]
        self.first_energy = 0.5 * float((rate**2 + (oscillators.angular * amplitude) ** 2).sum())
        # q, q', p and its slope where intervals begin, and the work of p until then
        self._begin = np.stack([np.empty_like(slope)] * 2 + [values[:-1], slope], axis=-1)
        self._work = np.zeros(len(lapse))
        state, work = np.stack([amplitude, rate], axis=-1), 0.0
        for first in range(0, len(lapse), _CHUNK):
            steps = oscillators.propagators(lapse[first : first + _CHUNK])
            for number, step in enumerate(steps, first):
                self._begin[number, :, :2], self._work[number] = state, work
                area, *after = _carried(step, self._begin[number])
                state = np.stack(after, axis=-1)
                gained = values[number + 1] * after[0] - values[number] * self._begin[number, :, 0]
                work += float((gained - slope[number] * area).sum())

    def at(self, times: Float) -> ModalStates:
        """Within those of the loads."""
        forcing = self._forcing
        number = np.searchsorted(forcing.times, times, side="right") - 1
        number = np.clip(number, 0, len(self._begin) - 1)
        tau, begin = times - forcing.times[number], self._begin[number]
        area, q, rate = _carried(self.oscillators.propagators(tau), begin)
        load = begin[..., 2] + begin[..., 3] * tau[:, None]
        # the integral of p q', by parts
        gained = (load * q - begin[..., 2] * begin[..., 0] - begin[..., 3] * area).sum(axis=1)
        own = self.oscillators
        return ModalStates(
            q, rate, load - own.damping * rate - own.angular**2 * q, self._work[number] + gained
        )


def _carried(step: Float, begin: Float) -> tuple[Float, Float, Float]:
    """The integral of q, q and q' (...,n) after propagators (...,n,3,5) of q, q', p and slope."""
    area, q, rate = np.moveaxis(np.einsum("...ij,...j->...i", step[..., 1:], begin), -1, 0)
    return area, q, rate


@dataclass(frozen=True, eq=False)
class ModalMotion:
    """A body's motion, exact at any instant: ``shapes`` (n + K,N,3) by their amplitudes.

    The first are ``modes``. The others are corrections, one a load case: of its static answer what
    modes lack. They follow the ``factors`` of the loads, and have ``stiffness`` (K,K). ``lacking``:
    the shares of energies that modes lack, by name.
    """

    shapes: Float
    modes: ModalCoordinates
    factors: Record
    stiffness: Float
    lacking: dict[str, float]

    def at(self, time: float) -> tuple[Float, Float]:
        """Displacement and velocity (N,3)."""
        amplitude, rate, *_ = self.coordinates(np.array([time]))
        u, v = np.tensordot(np.concatenate([amplitude, rate]), self.shapes, axes=1)
        return u, v

    def coordinates(self, times: Float) -> tuple[Float, Float, Float, Float]:
        """Amplitudes at ``times`` (m,), rates and accelerations (m,n + K), and energies (4,m), the
        fields of an `EnergyHistory`: damping has dissipated what is missing. Corrections have no
        inertia."""
        states, own, factors = self.modes.at(times), self.modes.oscillators, self.factors.at(times)
        kinetic = 0.5 * (states.rate**2).sum(axis=1)
        strain = 0.5 * ((own.angular * states.amplitude) ** 2).sum(axis=1)
        lost = states.work - (kinetic + strain - self.modes.first_energy)
        lost = lost if own.damping.any() else np.zeros_like(lost)
        added = 0.5 * np.einsum("tk,kl,tl->t", factors, self.stiffness, factors)
        first = self.factors.values[0]
        work = states.work + added - 0.5 * first @ self.stiffness @ first
        slope = self.factors.slope(times)
        return (
            np.hstack([states.amplitude, factors]),
            np.hstack([states.rate, slope]),
            np.hstack([states.acceleration, np.zeros_like(slope)]),
            np.stack([kinetic, strain + added, work, lost]),
        )


def modal_superposition(
    problem: InitialValueProblem, modes: Modes, damping: Damping | None, options: Options
) -> ModalMotion:
    """Of mass-normalised ``modes``."""
    equation, factors = problem.linear_equation, problem.factors
    forces = problem.forces(equation)
    x, scale = equation.unknowns(modes.shapes), equation.scale
    angular = modes.angular
    # rigid-body modes may have a damping, though no ratio
    positive = np.maximum(angular, 1e-100)
    lost = np.zeros_like(angular) if damping is None else 2.0 * damping.ratios(positive) * positive
    inertia, loads = equation.inertia(x), scale * forces @ x.T
    begin = equation.unknowns(np.stack([problem.u, problem.v]))
    amplitude, rate = scale * begin @ inertia.T
    forcing = Record(factors.times, factors.values @ loads)
    coordinates = ModalCoordinates(Oscillators(angular, lost), forcing, amplitude, rate)
    missing, acting = forces - loads @ inertia, factors.values.any(axis=0)
    missing -= scale * missing @ x.T @ inertia
    # rounding, where modes have all of a load
    missing[np.abs(missing).max(axis=1) <= _ROUNDING * np.abs(forces).max(axis=1)] = 0.0
    missing[~acting] = 0.0
    corrections = _static_corrections(equation, angular, missing, options)
    corrections -= scale * corrections @ inertia.T @ x
    stiffness = scale * corrections @ forces.T
    shapes = np.concatenate([modes.shapes, equation.displacements(corrections)])
    static = ((loads / positive)[:, angular > 0.0] ** 2).sum(axis=1) + np.diag(stiffness)
    lacking = {
        f"static answer to {name} (which is added, as if it had no inertia)": share
        for name, share in zip(
            problem.load_names, np.diag(stiffness) / np.maximum(static, 1e-300), strict=True
        )
    }
    for what, own, state, image in (
        ("initial displacement", angular * amplitude, begin[:1], equation.stiffness(begin[:1])),
        ("initial velocity", rate, begin[1:], equation.inertia(begin[1:])),
    ):
        whole = scale * float(np.vdot(state, image))
        lacking[what] = 1.0 - float(own @ own) / whole if whole > 0.0 else 0.0
    return ModalMotion(shapes, coordinates, factors, stiffness, lacking)


def _static_corrections(
    equation: EquationOfMotion, angular: Float, missing: Float, options: Options
) -> Float:
    """K^-1 times forces (K,3N) that move no mode."""
    rigid = angular.min() <= 0.0
    shift = float(_SHIFT * angular[angular > 0.0].min(initial=1.0) ** 2) if rigid else 0.0
    near = ShiftedSolver(equation, shift, options).preconditioner
    found = truncated_cg(equation.stiffness, near, missing, options.tolerance)
    if found is None:
        raise NotConverged("transient: static answers; got a stiffness that isn't positive")
    return found[0]
