"""Procedures without motion: statics, natural frequencies, linear buckling."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import inf

import numpy as np

from gpusim.arrays.array_types import Float
from gpusim.deck.increments import Increments
from gpusim.deck.materials import at_finite_strain
from gpusim.deck.step import Analysis, Procedure, Result, Step
from gpusim.errors import NotConverged
from gpusim.fem import Buckling, History, Modes, Solution, buckling, modes
from gpusim.mesh.formats.abaqus.cards import Card, number
from gpusim.validation import require

MASS = "calculix"
"""The rule by which elements of decks have their mass."""

NONE = Increments(period=0.0)

# what `Modes` have of each mode
_OF_MODES = ("frequencies", "shapes", "participation", "effective_mass", "error_estimate")


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
            return "after a step in which the body moves; expected it before"
        about = perturbation and len(before) > 0
        return "PERTURBATION about an earlier step; expected it in the first one" * about

    def solve(self, step: Step, analysis: Analysis) -> Solution:
        """All of them are solved together."""
        return analysis.static[step.number]


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

    def solve(self, step: Step, analysis: Analysis) -> Modes:
        """Also of those beyond the band, which CalculiX counts and superposes."""
        about, names = equilibrium(step, analysis), analysis.formulation
        model = analysis.model_of([step]) if about is None else about.model
        return modes(
            model, self.count, mass=MASS, formulation=names, prestress=about, method=analysis.method
        )

    def shown(self, result: Result) -> Result:
        """Those in the band."""
        assert isinstance(result, Modes)
        at = result.frequencies
        inside = (at >= self.least) & (at <= self.greatest)
        chosen = {name: getattr(result, name)[inside] for name in _OF_MODES}
        rigid = result.rigid[: inside[: len(result.rigid)].sum()]
        return replace(result, **chosen, rigid=rigid, below=int(np.argmax(inside)))


@dataclass(frozen=True)
class LinearBuckling(Procedure):
    """*BUCKLE: the ``count`` lowest factors of the step's loads."""

    fresh = True
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

    def solve(self, step: Step, analysis: Analysis) -> Buckling:
        """By linear theory."""
        model, names = analysis.model_of([step]), analysis.formulation
        return buckling(model, self.count, formulation=names, method=analysis.method)


def equilibrium(step: Step, analysis: Analysis) -> Solution | None:
    """About which a step is a perturbation: the last one, where large displacements would have come
    to be if it is linear."""
    state = last_static(analysis.steps[: step.number]) if step.perturbation else None
    if state is None:
        return None
    found = converged(analysis.static[state.number], step)
    if analysis.nonlinear:
        return found
    warm = None if state.temperature is None else state.temperature[None]
    materials = [at_finite_strain(one) for one in analysis.materials]
    model = analysis.model_of([state])
    model = replace(model, materials=materials, temperature=warm, loads=state.followers())
    return replace(found, model=model)


def last_static(steps: Sequence[Step]) -> Step | None:
    """The last step with *STATIC."""
    found = [one for one in steps if isinstance(one.procedure, Static)]
    return found[-1] if found else None


def converged(solution: Solution, step: Step) -> Solution:
    """A solution from which a step can go on. Raises NotConverged."""
    if not solution.converged:
        what = f"step {step.number}: the static analysis before it"
        raise NotConverged(f"{what}: {solution.message}; expected an equilibrium")
    return solution


def last_state(step: Step, analysis: Analysis) -> tuple[Float, Float]:
    """Displacement and velocity (N,3) in which the step just before has left the body, or in which
    it is at the beginning; *FREQUENCY has it rest."""
    last = analysis.before[-1] if analysis.before else None
    if isinstance(last, History):
        return last.u[-1], last.v[-1]
    u, v = analysis.initial_motion if last is None else np.zeros((2, *step.forces.shape))
    return (converged(last, step).u, v) if isinstance(last, Solution) else (u, v)


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
