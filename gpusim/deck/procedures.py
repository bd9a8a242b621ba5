"""Procedures: what is done in a step, as its card says, and how. Those without motion."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import inf
from typing import TYPE_CHECKING, ClassVar

from gpusim.deck.increments import Increments
from gpusim.deck.materials import at_finite_strain
from gpusim.deck.step import Step
from gpusim.fem import Buckling, HarmonicResponse, Modes, Solution, buckling, modes
from gpusim.fem.model.history import History
from gpusim.mesh.formats.abaqus.cards import Card, number
from gpusim.validation import require

if TYPE_CHECKING:
    from gpusim.deck.deck import Deck

Result = Solution | Modes | Buckling | History | HarmonicResponse
"""Of a step."""
MASS = "calculix"
"""The rule by which elements of decks have their mass."""

NONE = Increments(period=0.0)

# what `Modes` have of each mode
_OF_MODES = ("frequencies", "shapes", "participation", "effective_mass", "error_estimate")


@dataclass(frozen=True, eq=False)
class Reached:
    """What is known when a step's turn comes: the solutions of all ``static`` steps by number, and
    the results of the steps ``before``."""

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
        state = last_static(self.deck.steps[: step.number])
        assert state is not None
        found = self.static[state.number]
        if self.deck.nonlinear:
            return found
        warm = None if state.temperature is None else state.temperature[None]
        materials = [at_finite_strain(one) for one in self.deck.materials]
        model = replace(self.deck.model_of([state]), materials=materials, temperature=warm)
        return replace(found, model=model)


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
    def solve(self, step: Step, reached: Reached) -> Result:
        """The result of a step."""


@dataclass(frozen=True)
class Static(Procedure):
    """*STATIC."""

    @classmethod
    def read(cls, card: Card, step: Card) -> Static:
        """Of the cards of a step. Raises InputError."""
        return cls(Increments.read(card, step))

    def unfit(self, before: Sequence[Step], perturbation: bool) -> str:
        """About a first step, a perturbation means that step's stress stiffness in CalculiX, and
        its loads don't act: the first step of a linear analysis has neither."""
        if any(one.procedure.moves for one in before):
            return "*STATIC after a step in which the body moves; expected it before"
        about = perturbation and len(before) > 0
        return "PERTURBATION about an earlier step; expected it in the first one" * about

    def solve(self, step: Step, reached: Reached) -> Solution:
        """All of them are solved together."""
        return reached.static[step.number]


@dataclass(frozen=True)
class Frequency(Procedure):
    """*FREQUENCY: the ``count`` lowest natural frequencies, those of them from ``least`` to
    ``greatest`` Hz."""

    count: int
    least: float
    greatest: float

    @classmethod
    def read(cls, card: Card, step: Card) -> Frequency:
        """Of the cards of a step. Raises InputError."""
        count, least, greatest = values(card, 3)
        return cls(NONE, whole_number(card, count), least, greatest or inf)

    def unfit(self, before: Sequence[Step], perturbation: bool) -> str:
        """A perturbation of nothing."""
        alone = perturbation and last_static(before) is None
        return "PERTURBATION about no step; expected a step with *STATIC before it" * alone

    def solve(self, step: Step, reached: Reached) -> Modes:
        """As in CalculiX those beyond the band are counted, too."""
        deck, about = reached.deck, reached.equilibrium(step)
        model = deck.model_of([step]) if about is None else about.model
        found = modes(model, self.count, mass=MASS, formulation=deck.formulation, prestress=about)
        at = found.frequencies
        inside = (at >= self.least) & (at <= self.greatest)
        chosen = {name: getattr(found, name)[inside] for name in _OF_MODES}
        return replace(found, **chosen, rigid=found.rigid[: inside[: len(found.rigid)].sum()])


@dataclass(frozen=True)
class LinearBuckling(Procedure):
    """*BUCKLE: the ``count`` lowest factors of the step's loads."""

    fresh: ClassVar[bool] = True
    count: int

    @classmethod
    def read(cls, card: Card, step: Card) -> LinearBuckling:
        """Of the cards of a step. Raises InputError."""
        count, *_ = values(card, 4)
        return cls(NONE, whole_number(card, count))

    def unfit(self, before: Sequence[Step], perturbation: bool) -> str:
        """About a stressed state."""
        about = perturbation and len(before) > 0
        return "PERTURBATION with *BUCKLE; expected all loads in the step itself" * about

    def solve(self, step: Step, reached: Reached) -> Buckling:
        """By linear theory."""
        deck = reached.deck
        return buckling(deck.model_of([step]), self.count, formulation=deck.formulation)


def last_static(steps: Sequence[Step]) -> Step | None:
    """The last step with *STATIC."""
    found = [one for one in steps if isinstance(one.procedure, Static)]
    return found[-1] if found else None


def values(card: Card, count: int) -> list[float]:
    """The numbers of a card's first line, zero where none stands. Raises InputError."""
    for line, row in card.rows():
        given = [number(text or "0", card.where(line)) for text in row]
        if len(given) > count:
            card.fail(f"got {len(given)} numbers; expected {count} or fewer", line)
        return given + [0.0] * (count - len(given))
    return [0.0] * count


def whole_number(card: Card, given: float) -> int:
    """How many modes are asked for. Raises InputError."""
    fits = given >= 1.0 and given % 1.0 == 0.0
    require(fits, f"{card.where()}: number of modes", f"{given:g}", "a whole number >= 1")
    return int(given)
