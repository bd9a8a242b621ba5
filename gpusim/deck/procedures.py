"""Procedures: what is done in a step, as its card says, and how. Those without motion."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from math import inf
from typing import TYPE_CHECKING, Any, ClassVar, Protocol

import numpy as np

from gpusim.deck.increments import Increments
from gpusim.deck.materials import at_finite_strain
from gpusim.deck.step import Step
from gpusim.fem import HarmonicResponse, Modes, Solution, modes
from gpusim.fem.model.history import History
from gpusim.mesh.formats.abaqus.cards import Card, number, whole
from gpusim.validation import require

if TYPE_CHECKING:
    from gpusim.deck.deck import Deck

Result = Solution | Modes | History | HarmonicResponse
"""Of a step."""

# what `Modes` have of each mode
_OF_MODES = ("frequencies", "shapes", "participation", "effective_mass", "error_estimate")

MASS = "calculix"
"""The rule by which elements of decks have their mass."""


@dataclass(frozen=True, eq=False)
class Reached:
    """What is known when a step's turn comes: the solutions of all ``static`` steps by number, the
    results of the steps ``before``."""

    deck: Deck
    static: Mapping[int, Solution]
    before: Sequence[Result]
    tolerance: float

    @property
    def modes(self) -> Modes:
        """Those found last."""
        return [one for one in self.before if isinstance(one, Modes)][-1]

    def equilibrium(self, step: Step) -> Solution | None:
        """About which a step is a perturbation: the last one, where large displacements would have
        come to be if it is linear."""
        if not step.perturbation:
            return None
        last = [one for one in self.before if isinstance(one, Solution)][-1]
        if self.deck.nonlinear:
            return last
        (state,) = (one for one in self.deck.steps if self.static.get(one.number) is last)
        warm = None if state.temperature is None else state.temperature[None]
        materials = [at_finite_strain(one) for one in self.deck.materials]
        model = replace(self.deck.model_of([state]), materials=materials, temperature=warm)
        return replace(last, model=model)


class Procedure(Protocol):
    """``moves``: its loads are there from the beginning on. ``fresh``: it has no loads but its own.
    ``about``: it may be a perturbation about the state of a static step."""

    moves: ClassVar[bool]
    fresh: ClassVar[bool]
    about: ClassVar[bool]

    @property
    def increments(self) -> Increments: ...

    def unfit(self, before: Sequence[Procedure]) -> str:
        """What is missing ``before`` it, if anything."""

    def solve(self, step: Step, reached: Reached) -> Result: ...


@dataclass(frozen=True)
class Static:
    """*STATIC."""

    moves = fresh = about = False
    increments: Increments

    @classmethod
    def read(cls, card: Card, step: Card) -> Static:
        return cls(Increments.read(card, step))

    def unfit(self, before: Sequence[Procedure]) -> str:
        moved = any(one.moves for one in before)
        return "a step in which the body moves before it; expected static steps first" * moved

    def solve(self, step: Step, reached: Reached) -> Solution:
        return reached.static[step.number]


@dataclass(frozen=True)
class Frequency:
    """*FREQUENCY: the ``count`` lowest natural frequencies, those of them from ``least`` to
    ``greatest`` Hz."""

    moves, fresh, about = False, False, True
    increments: ClassVar[Increments] = Increments(period=0.0)
    count: int
    least: float
    greatest: float

    @classmethod
    def read(cls, card: Card, step: Card) -> Frequency:
        given = values(card, 3)
        return cls(_count(card, given), given[1], given[2] or inf)

    def unfit(self, before: Sequence[Procedure]) -> str:
        return ""

    def solve(self, step: Step, reached: Reached) -> Modes:
        deck, about = reached.deck, reached.equilibrium(step)
        model = deck.model_of([step]) if about is None else about.model
        found = modes(
            model, self.count, mass=MASS, formulation=deck.formulation, prestress=about
        )
        at = found.frequencies
        inside = (at >= self.least) & (at <= self.greatest)
        chosen = {name: getattr(found, name)[inside] for name in _OF_MODES}
        return replace(found, **chosen, rigid=found.rigid[: int(inside[: len(found.rigid)].sum())])


def values(card: Card, count: int) -> list[float]:
    """The numbers of a card's first line, zero where none stands. Raises InputError."""
    for line, row in card.rows():
        given = [number(text or "0", card.where(line)) for text in row]
        if len(given) > count:
            card.fail(f"got {len(given)} numbers; expected {count} or fewer", line)
        return given + [0.0] * (count - len(given))
    return [0.0] * count


def _count(card: Card, given: Sequence[float]) -> int:
    fits = given[0] >= 1.0 and given[0] % 1.0 == 0.0
    require(fits, f"{card.where()}: number of modes", f"{given[0]:g}", "a whole number >= 1")
    return int(given[0])
