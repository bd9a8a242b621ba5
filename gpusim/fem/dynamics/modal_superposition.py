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
from gpusim.fem.dynamics.initial_value_problem import InitialValueProblem
from gpusim.fem.dynamics.modal_basis import ModalBasis
from gpusim.fem.linear.solve_plan import Options
from gpusim.fem.model.damping import Damping, Rayleigh
from gpusim.fem.model.modes import Modes
from gpusim.fem.model.record import Record
from gpusim.parallel.blas_threads import one_blas_thread

# instants that are worked on at a time
_CHUNK = 1024


@dataclass(frozen=True, eq=False)
class ModalStates:
    """Amplitudes of n modes at m instants (m,n), their rates and accelerations, and the ``work``
    (m,) that the loads have done."""

    amplitude: Float
    rate: Float
    acceleration: Float
    work: Float


class ModalCoordinates:
    """Amplitudes of n modes at any instant, with ``angular`` frequencies (n,) rad/s and ``damping``
    (n,) 1/s, twice the ratio times the frequency; from ``amplitude`` and ``rate`` (n,) at the first
    instant of ``forcing``, the modal loads (R,n) over modal masses."""

    def __init__(
        self, angular: Float, damping: Float, forcing: Record, amplitude: Float, rate: Float
    ) -> None:
        self.angular, self.damping, self._forcing = angular, damping, forcing
        self.first_energy = 0.5 * float((rate**2 + (angular * amplitude) ** 2).sum())
        lapse, push = np.diff(forcing.times), forcing.values[:-1]
        slope = forcing.slope(forcing.times[:-1])
        # q, q', p and its slope where intervals begin, and the work of p until then
        self._begin = np.stack([np.empty_like(push)] * 2 + [push, slope], axis=-1)
        self._work, work = np.zeros(len(lapse)), 0.0
        for first in range(0, len(lapse), _CHUNK):
            steps = self._propagators(lapse[first : first + _CHUNK])
            for number, step in enumerate(steps, first):
                begin, self._work[number] = self._begin[number], work
                begin[:, 0], begin[:, 1] = amplitude, rate
                amplitude, rate, _, gained = _carried(step, begin, lapse[number])
                work += float(gained)

    def at(self, times: Float) -> ModalStates:
        """Within those of the loads."""
        number = np.searchsorted(self._forcing.times, times, side="right") - 1
        number = np.clip(number, 0, len(self._begin) - 1)
        tau = times - self._forcing.times[number]
        q, rate, push, gained = _carried(self._propagators(tau), self._begin[number], tau[:, None])
        acceleration = push - self.damping * rate - self.angular**2 * q
        return ModalStates(q, rate, acceleration, self._work[number] + gained)

    def _propagators(self, tau: Float) -> Float:
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
        with one_blas_thread():
            grown = expm(system / ratio * t[..., None, None])[..., :3, :] * ratio[..., :3, :]
        return np.asarray(grown[number])


def _carried(step: Float, begin: Float, tau: Float | float) -> tuple[Float, Float, Float, Float]:
    """q, q' and p (...,n) after ``tau``, by propagators (...,n,3,5) of q, q', p and its slope, and
    the work of p until then, (...): the integral of p q', by parts."""
    area, q, rate = np.moveaxis(np.einsum("...ij,...j->...i", step[..., 1:], begin), -1, 0)
    first, _, push, slope = np.moveaxis(begin, -1, 0)
    after = push + slope * tau
    return q, rate, after, (after * q - push * first - slope * area).sum(axis=-1)


@dataclass(frozen=True, eq=False)
class ModalMotion:
    """A body's motion, exact at any instant: ``shapes`` (n + K,N,3) by their amplitudes.

    The first are ``modes``. The others have no inertia: their amplitudes are those of a ``static``
    record (R,K), and they have ``stiffness`` (K,). ``lacking``: the shares of energies that modes
    lack, by name.
    """

    shapes: Float
    modes: ModalCoordinates
    static: Record
    stiffness: Float
    lacking: dict[str, float]

    def at(self, time: float) -> tuple[Float, Float]:
        """Displacement and velocity (N,3)."""
        amplitude, rate, *_ = self.coordinates(np.array([time]))
        u, v = np.tensordot(np.concatenate([amplitude, rate]), self.shapes, axes=1)
        return u, v

    def coordinates(self, times: Float) -> tuple[Float, Float, Float, Float]:
        """Amplitudes at ``times`` (m,), rates and accelerations (m,n + K), and energies (4,m), the
        fields of an `EnergyHistory`: damping has dissipated what is missing."""
        own, states, static = self.modes, self.modes.at(times), self.static.at(times)
        kinetic = 0.5 * (states.rate**2).sum(axis=1)
        strain = 0.5 * ((own.angular * states.amplitude) ** 2).sum(axis=1)
        lost = states.work - (kinetic + strain - own.first_energy)
        lost = lost if own.damping.any() else np.zeros_like(lost)
        first, added = (0.5 * q**2 @ self.stiffness for q in (self.static.values[:1], static))
        slope = self.static.slope(times)
        return (
            np.hstack([states.amplitude, static]),
            np.hstack([states.rate, slope]),
            np.hstack([states.acceleration, np.zeros_like(slope)]),
            np.stack([kinetic, strain + added, states.work + added - first, lost]),
        )


def modal_superposition(
    problem: InitialValueProblem, modes: Modes, damping: Damping | None, options: Options
) -> ModalMotion:
    """Of mass-normalised ``modes``, and of residual vectors as if these had no inertia."""
    equation, factors = problem.linear_equation, problem.factors
    loads = np.where(factors.values.any(axis=0), problem.forces(equation).T, 0.0).T
    basis = ModalBasis.of(equation, modes, loads, options)
    angular, beyond = np.split(basis.angular, [basis.count])
    push, pull = np.split(basis.forcing.real, [basis.count], axis=1)
    begin = equation.unknowns(np.stack([problem.u, problem.v]))
    inertia = equation.inertia(equation.unknowns(basis.shapes[: basis.count]))
    amplitude, rate = equation.scale * begin @ inertia.T
    (lost,) = (damping or Rayleigh()).dissipation(np.ones(1), angular)
    forcing = Record(factors.times, factors.values @ push)
    coordinates = ModalCoordinates(angular, lost, forcing, amplitude, rate)
    lacking = {
        "static answer to a load (which is added, as if it had no inertia)": basis.lacking.max()
    }
    for what, own, state, image in (
        ("initial displacement", angular * amplitude, begin[:1], equation.stiffness(begin[:1])),
        ("initial velocity", rate, begin[1:], equation.inertia(begin[1:])),
    ):
        whole = equation.scale * float(np.vdot(state, image))
        lacking[what] = 1.0 - float(own @ own) / whole if whole > 0.0 else 0.0
    static = Record(factors.times, factors.values @ (pull / beyond**2))
    return ModalMotion(basis.shapes, coordinates, static, beyond**2, lacking)
