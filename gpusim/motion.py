"""Motions: where the nodes of a body are, the only door to displacements.

What an instant is to a motion, its *state*, is plain data that is known before the motion is:
weights of load cases, a time. Frames depend on it and on the motion, and on nothing else.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np

from gpusim.arrays.array_types import Float

State = tuple[float, ...]


class Motion(Protocol):
    """The motion of one body."""

    def displacement(self, state: State) -> Float:
        """(N, 3) m of the body's nodes."""

    def reactions(self, state: State) -> Float:
        """(S, 3) N of the body's supports; none where nobody solved for them."""


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


@dataclass(frozen=True, eq=False)
class Given:
    """Another program's displacements ``at`` a time, (N, 3) m."""

    at: Callable[[float], Float]

    def displacement(self, state: State) -> Float:
        """(N, 3) m at the time that is the state."""
        (time,) = state
        return self.at(time)

    def reactions(self, state: State) -> Float:
        """None."""
        return np.zeros((0, 3))
