"""What acts at the end of a step of a deck, on the way there, and what is done with it."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from gpusim.arrays.array_types import Bool, Float
from gpusim.deck.amplitudes import Amplitude
from gpusim.deck.increments import Increments
from gpusim.fem import (
    Buckling,
    Equations,
    FollowerPressure,
    HarmonicResponse,
    History,
    Material,
    Model,
    Modes,
    Rayleigh,
    Solution,
)
from gpusim.fem.model.damping import Damping
from gpusim.field_summary import field_summary

Result = Solution | Modes | Buckling | History | HarmonicResponse
"""Of a step."""


@dataclass(frozen=True, eq=False)
class Step:
    """The state at the end of a step: everything that acts then, also from earlier steps.

    ``number`` counts from 1, ``name`` is the deck's (or empty), ``time`` the end of the step in
    total time. ``fixed`` (N,3) bool, ``prescribed`` and ``forces`` (N,3) float64 as in a
    ``Model``; ``forces`` holds the equivalent forces of temperature too. ``temperature`` (N,) is
    the change against the initial one, None where there is none. ``constraints`` are ties,
    *EQUATION and supports in turned axes, as in a ``Model``.

    In a nonlinear deck pressures are ``loads`` that follow the body, and neither they nor
    temperature are part of ``forces``. Everything goes straight from one state to the next, those
    of the ``path`` on the way to this one included; ``increments`` (K,) are the times of the load
    steps that are solved for, the end of the step the last of them.

    In a linear deck the ``forces`` of pressures act on the body at rest; ``followers`` makes these
    pressures as perturbations of the state see them.

    ``procedure`` is what the step does. In one in which the body moves, what acts is the sum of the
    cases of ``motion``, and the ``increments`` are instants; ``damping`` is that of its modes.
    ``perturbation``: about the state of the static step before.

    Examples
    --------
    >>> step = gs.load_deck("bricks.inp").steps[0]
    >>> step.number, step.time, int(step.fixed.sum())
    (1, 1.0, 12)
    """

    number: int
    name: str
    time: float
    fixed: Bool
    prescribed: Float
    forces: Float
    temperature: Float | None
    constraints: tuple[Equations, ...]
    procedure: Procedure
    loads: tuple[FollowerPressure, ...] = ()
    followers: Callable[[], tuple[FollowerPressure, ...]] = tuple
    path: tuple[Step, ...] = ()
    increments: Float = field(default_factory=lambda: np.zeros(0))
    motion: Motion | None = None
    damping: Damping | None = None
    perturbation: bool = False
    __repr__ = field_summary

    def forces_at(self, points: Float) -> Float:
        """(N,3) nodal forces on the body whose nodes are at ``points`` (N,3)."""
        return self.forces + sum((load.forces(points) for load in self.loads), np.zeros((1, 3)))

    def held_as(self, other: Step) -> bool:
        """Whether both hold the same degrees of freedom, by the same constraints."""
        return np.array_equal(self.fixed, other.fixed) and self.constraints == other.constraints

    @property
    def idle(self) -> bool:
        """Whether nothing acts and nothing is moved."""
        acts = self.forces.any() or self.prescribed.any() or self.loads
        return not (acts or (self.temperature is not None and self.temperature.any()))


@dataclass(frozen=True, eq=False)
class Motion:
    """What acts in the course of time, or of frequency: ``cases``, each times its course; of the
    ``quadrature`` ones a quarter of a period ahead. ``begin``: its first instant."""

    begin: float
    cases: Sequence[Step]
    courses: Sequence[Amplitude]
    quadrature: Sequence[bool]

    def factors(self, at: Float) -> Float:
        """(T,L) of the cases."""
        return np.stack([course.at(at) for course in self.courses], axis=-1)


@dataclass(frozen=True)
class Procedure(ABC):
    """What ``increments`` of time a step has, and what it does in them. In one that ``moves`` loads
    are there from the beginning on; a ``fresh`` one has no loads but its own."""

    moves: ClassVar[bool] = False
    fresh: ClassVar[bool] = False
    increments: Increments

    @abstractmethod
    def unfit(self, before: Sequence[Step], perturbation: bool) -> str:
        """What speaks against it after the steps ``before``, if anything."""

    def superposes(self, before: Sequence[Step]) -> Step | None:
        """The step whose modes it superposes."""
        return None

    @abstractmethod
    def solve(self, step: Step, analysis: Analysis) -> Result:
        """The result of a step."""

    def shown(self, result: Result) -> Result:
        """What was asked for of it."""
        return result


@dataclass(frozen=True, eq=False)
class Analysis:
    """A deck when a step's turn comes: results ``before`` it, the solutions of all ``static`` steps
    by number; ``model_of`` steps that hold the same as load cases. Others: see `Deck`."""

    path: str
    steps: Sequence[Step]
    materials: Sequence[Material]
    formulation: Mapping[str, str]
    nonlinear: bool
    initial_motion: tuple[Float, Float]
    damping: Rayleigh
    loss_factor: float
    model_of: Callable[[Sequence[Step]], Model]
    tolerance: float
    method: str
    static: Mapping[int, Solution]
    before: Sequence[Result]
