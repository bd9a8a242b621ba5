"""Phase error: by how much vibration that is stepped lags behind, which adds up over its cycles."""

from __future__ import annotations

import numpy as np

from gpusim.arrays.array_types import Float
from gpusim.fem.dynamics.time_integration import Scheme
from gpusim.fem.model.history import State

# mean square of a motion about its mean, over that of all: less is none
_STILL = 1e-12


class PhaseError:
    """Of a motion that is stepped by a ``scheme``, looked at step by step."""

    def __init__(self, scheme: Scheme) -> None:
        self._scheme = scheme
        self._duration = self._cubes = self._speeds = self._squares = 0.0
        self._sum: Float | float = 0.0

    def add(self, before: State, after: State) -> None:
        """One more step."""
        step = after.time - before.time
        self._duration += step
        self._cubes += step**3
        self._sum = self._sum + step * after.u
        self._squares += step * float(np.vdot(after.u, after.u))
        self._speeds += step * float(np.vdot(after.v, after.v))

    @property
    def frequency(self) -> float:
        """The mean one, Hz: Rayleigh's quotient of velocities and of displacements about their
        mean, to which those modes count most that move the body most."""
        mean, whole = self._sum / self._duration, self._squares / self._duration
        spread = whole - float(np.vdot(mean, mean))
        square = self._speeds / self._duration / spread if spread > _STILL * whole else 0.0
        return float(np.sqrt(square)) / (2.0 * np.pi)

    @property
    def cycles(self) -> float:
        """At the end, of a vibration with the mean frequency."""
        turn = 2.0 * np.pi * self.frequency * float(np.sqrt(self._cubes / self._duration))
        lag = 1.0 - stepped_frequency(self._scheme, turn) / turn if turn > 0.0 else 0.0
        return abs(lag) * self.frequency * self._duration


def stepped_frequency(scheme: Scheme, turn: float) -> float:
    """The phase in which an undamped vibration goes on in a step of phase ``turn``: that of the
    amplification matrix' principal root (Chung & Hulbert 1993), rad."""
    alpha_m, alpha_f, beta, gamma = scheme.alpha_m, scheme.alpha_f, scheme.beta, scheme.gamma
    # of displacement, velocity times step, and acceleration times its square
    end = np.array([
        [1.0, 0.0, -beta], [0.0, 1.0, -gamma], [(1.0 - alpha_f) * turn**2, 0.0, 1.0 - alpha_m],
    ])  # fmt: skip
    begin = np.array([[1.0, 1.0, 0.5 - beta], [0.0, 1.0, 1.0 - gamma],
                      [-alpha_f * turn**2, 0.0, -alpha_m]])  # fmt: skip
    roots = np.linalg.eigvals(np.linalg.solve(end, begin))
    return float(np.angle(roots[np.argmax(roots.imag)]))
