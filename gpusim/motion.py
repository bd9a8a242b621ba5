"""Motions: where the nodes of a body are, the only door to displacements.

What an instant is to a motion, its *state*, is plain data that is known before the motion is:
weights of load cases, a time. Frames depend on it and on the motion, and on nothing else.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Protocol, runtime_checkable

import numpy as np
import numpy.typing as npt

from gpusim.arrays.array_types import Float

State = tuple[float, ...]
ALL = -1.0
"""In place of the number of an `Oscillation`'s motion: all of them at once."""


class Motion(Protocol):
    """The motion of one body."""

    def displacement(self, state: State) -> Float:
        """(N, 3) m of the body's nodes."""

    def reactions(self, state: State) -> Float:
        """(S, 3) N of the body's supports; none where nobody solved for them."""


@runtime_checkable
class Vibration(Motion, Protocol):
    """A motion that is known at any instant, not only where frames are."""

    def later(self, state: State, seconds: float) -> State:
        """The state so many s after another one; less than 0: before it."""

    def velocity(self, state: State) -> Float:
        """(N, 3) m/s of the body's nodes."""


@dataclass(frozen=True, eq=False)
class Superposed:
    """Linear: the sum of load cases ``u`` (L, N, 3) m by weights (L,), likewise of their
    ``forces`` (L, S, 3) N in the supports."""

    u: Float
    forces: Float

    def displacement(self, state: State) -> Float:
        """(N, 3) m."""
        return np.asarray(np.tensordot(np.array(state), self.u, axes=1))

    def reactions(self, state: State) -> Float:
        """(S, 3) N."""
        return np.asarray(np.tensordot(np.array(state), self.forces, axes=1))


@dataclass(frozen=True, eq=False)
class Stepped:
    """Equilibria one after the other: displacements ``u`` (K, N, 3) m and ``forces`` (K, S, 3) N in
    the supports, in ``states`` (K, n)."""

    states: Sequence[State]
    u: Float
    forces: Float

    def displacement(self, state: State) -> Float:
        """(N, 3) m; of a state that there is."""
        return np.asarray(self.u[self._number[state]])

    def reactions(self, state: State) -> Float:
        """(S, 3) N; of a state that there is."""
        return np.asarray(self.forces[self._number[state]])

    @cached_property
    def _number(self) -> dict[State, int]:
        return {tuple(state): number for number, state in enumerate(self.states)}


class _Unloaded:
    """A motion whose forces aren't known."""

    def reactions(self, state: State) -> Float:
        """None."""
        return np.zeros((0, 3))


@dataclass(frozen=True, eq=False)
class Given(_Unloaded):
    """Another program's displacements ``at`` a time, (N, 3) m."""

    at: Callable[[float], Float]

    def displacement(self, state: State) -> Float:
        """(N, 3) m at the time that is the state."""
        (time,) = state
        return self.at(time)


@dataclass(frozen=True, eq=False)
class Oscillation(_Unloaded):
    """Motions of one frequency each, of which a state names one by its number, or `ALL`, and says
    what share of its period, and what time after that (s, 0 if it isn't said), has passed: ``rest``
    + Re(amplitude exp(2 pi i (share + frequency time))), summed over `ALL`.

    ``amplitudes`` (n, N, 3) m, complex where nodes aren't in phase, and ``frequencies`` (n,) Hz, by
    ``numbers`` (n,) > 0; with the number 0 nothing moves. ``rest`` (N, 3) m: where.
    """

    numbers: Sequence[int]
    amplitudes: npt.NDArray[Any]
    frequencies: Float
    rest: Float

    def displacement(self, state: State) -> Float:
        """(N, 3) m."""
        return np.asarray(self.rest + self._part(state, 0))

    def velocity(self, state: State) -> Float:
        """(N, 3) m/s."""
        return self._part(state, 1)

    def later(self, state: State, seconds: float) -> State:
        """The same motion at another time."""
        number, share, *past = state
        return (number, share, seconds + sum(past)) if number else state

    def frequency(self, state: State) -> float:
        """Hz; 0 where nothing moves, or all do."""
        return float(self.frequencies[self._places(state)[0]]) if state[0] > 0 else 0.0

    def _part(self, state: State, derivative: int) -> Float:
        total = np.zeros_like(self.rest)
        for place in self._places(state):
            frequency, amplitude = self.frequencies[place], self.amplitudes[place]
            share = state[1] + sum(state[2:]) * frequency
            # a quarter of a period is one: nothing moves by what is rounded off
            turned = np.round(np.exp(2j * np.pi * share), 15)
            turned *= (2j * np.pi * frequency) ** derivative
            total += turned.real * amplitude.real - turned.imag * amplitude.imag
        return total

    def _places(self, state: State) -> Sequence[int]:
        if state[0] == ALL:
            return range(len(self.numbers))
        return [list(self.numbers).index(int(state[0]))] if state[0] else []


@dataclass(frozen=True, eq=False)
class Course:
    """Values (T, ...) at ``times`` (T,) s, with their ``rates`` and, where they are known,
    ``accelerations``: polynomials of degree 5, else 3, between them."""

    times: Float
    values: Float
    rates: Float
    accelerations: Float | None = None

    def at(self, time: float) -> tuple[Float, Float]:
        """Value and rate; before and after all times, the first and the last value at rest."""
        from scipy.interpolate import BPoly  # who has no such motion doesn't wait for it

        first, last = self.times[[0, -1]]
        if not first < time < last:
            end = 0 if time <= first else -1
            return np.asarray(self.values[end]), self.rates[end] * (time in (first, last))
        k = int(np.searchsorted(self.times, time))
        known = [self.values, self.rates, self.accelerations]
        ends = np.stack([one[k - 1 : k + 1] for one in known if one is not None], axis=1)
        between = BPoly.from_derivatives(self.times[k - 1 : k + 1], ends)
        return np.asarray(between(time)), np.asarray(between.derivative()(time))


@dataclass(frozen=True, eq=False)
class Transient(_Unloaded):
    """A motion in time; a state is an instant. ``course``: of the nodes (N, 3) m, or of the
    amplitudes (n,) of ``shapes`` (n, N, 3), of which the first m may be modes, ``natural`` (2, m):
    their frequencies (Hz) and shares of critical damping."""

    course: Course
    shapes: Float | None = None
    natural: Float | None = None

    def displacement(self, state: State) -> Float:
        """(N, 3) m."""
        return self._at(state)[0]

    def velocity(self, state: State) -> Float:
        """(N, 3) m/s."""
        return self._at(state)[1]

    def later(self, state: State, seconds: float) -> State:
        """Another instant."""
        return (state[0] + seconds,)

    def _at(self, state: State) -> tuple[Float, Float]:
        u, v = self.course.at(state[0])
        if self.shapes is None:
            return u, v
        u, v = np.tensordot(np.stack([u, v]), self.shapes, axes=1)
        return u, v
