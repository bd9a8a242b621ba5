"""Procedures that superpose modes: in time, and at frequencies.

As in CalculiX the modes are those of the *FREQUENCY before, and no others: nothing stands for what
they lack of the static answer. Where supports move, their stiffness alone pulls at modes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from gpusim.arrays.array_types import Float
from gpusim.deck.increments import Increments
from gpusim.deck.procedures import MASS, NONE, Frequency, converged, last_state, values
from gpusim.deck.step import Analysis, Procedure, Step
from gpusim.fem import (
    HarmonicResponse,
    History,
    ModalDamping,
    Modes,
    Rayleigh,
    Record,
    StructuralDamping,
    mass_matrix,
    solve,
)
from gpusim.fem.dynamics.modal_basis import ModalBasis
from gpusim.fem.dynamics.modal_superposition import ModalCoordinates, ModalMotion
from gpusim.fem.dynamics.transient import superposed
from gpusim.fem.model.damping import Damping
from gpusim.fem.model.dead_loads import with_dead_loads
from gpusim.mesh.formats.abaqus.cards import Card, number, whole
from gpusim.validation import require

# of *STEADY STATE DYNAMICS: points between two natural frequencies, and their bias to these
_POINTS, _BIAS = 20, 3.0
# modes, and points between two of them, more than which nobody means
_MOST = 100_000
# of a static answer
_TOLERANCE = 1e-10


def read_modal_damping(card: Card) -> Damping:
    """*MODAL DAMPING: first and last mode, their share of critical damping; RAYLEIGH: two empty
    fields, and the shares of mass and stiffness. Raises InputError."""
    where = card.where()
    if "RAYLEIGH" in card.parameters:
        *_, mass, stiffness = values(card, 4)
        require(min(mass, stiffness) >= 0.0, where, f"{mass:g}, {stiffness:g}", "numbers >= 0")
        return Rayleigh(mass, stiffness)
    ratios: list[float] = []
    for line, row in card.records(3, 3, "first and last mode, ratio"):
        first = whole(row[0], line)
        last, ratio = whole(row[1] or row[0], line), number(row[2], line)
        expected = f"numbers that grow, up to {_MOST}"
        require(1 <= first <= last <= _MOST, f"{line}: modes", f"{first} to {last}", expected)
        require(0.0 <= ratio < 1.0, f"{line}: ratio", f"{ratio:g}", "0 to below 1")
        ratios += [0.0] * (last - len(ratios))
        ratios[first - 1 : last] = [ratio] * (last + 1 - first)
    return ModalDamping([*ratios, 0.0])


class Superposition(Procedure):
    """Of the modes of the *FREQUENCY before."""

    moves = True

    def unfit(self, before: Sequence[Step], perturbation: bool) -> str:
        """Without modes, or about another state than theirs."""
        of = self.superposes(before)
        if of is None:
            return "no modes; expected a step with *FREQUENCY before it"
        same = of.perturbation == perturbation
        return "" if same else "expected PERTURBATION where *FREQUENCY has it, and only there"

    def superposes(self, before: Sequence[Step]) -> Step | None:
        """The last step with modes."""
        found = [one for one in before if isinstance(one.procedure, Frequency)]
        return found[-1] if found else None


@dataclass(frozen=True)
class ModalDynamics(Superposition):
    """*MODAL DYNAMIC: loads go straight from the end of an increment to that of the next."""

    @classmethod
    def read(cls, card: Card, step: Card) -> ModalDynamics:
        """Of the cards of a step. Raises InputError."""
        return cls(replace(Increments.read(card, step), equal=True, at_once=True))

    def unfit(self, before: Sequence[Step], perturbation: bool) -> str:
        """A second one about a stressed state, at which CalculiX forgets displacements alone."""
        again = perturbation and any(isinstance(one.procedure, ModalDynamics) for one in before)
        return super().unfit(before, perturbation) or (
            "a second *MODAL DYNAMIC about a stressed state; expected one" if again else ""
        )

    def solve(self, step: Step, analysis: Analysis) -> History:
        """From where the step just before has left the body; *FREQUENCY has it rest."""
        assert step.motion is not None
        times = np.array([step.motion.begin, *step.increments])
        factors = step.motion.factors(times)
        basis, beyond = modal_loads(step, analysis)
        modes = basis.modes
        (lost,) = (step.damping or Rayleigh()).dissipation(np.ones(1), modes.angular)
        forcing = Record(times, factors @ basis.forcing.real)
        begin = shares(analysis, modes, np.stack(last_state(step, analysis)))
        coordinates = ModalCoordinates(modes.angular, lost, forcing, *begin)
        shapes, static = np.concatenate([modes.shapes, beyond]), Record(times, factors)
        response = ModalMotion(shapes, coordinates, static, np.zeros(len(beyond)), {})
        return History(times, **basis.computation | superposed(response, times, None))


@dataclass(frozen=True)
class HarmonicDynamics(Superposition):
    """*STEADY STATE DYNAMICS: harmonic motion at frequencies from ``least`` to ``greatest`` Hz:
    natural ones, and from one of them to the next so many ``points``, the denser near these the
    greater the ``bias``."""

    fresh = True
    least: float
    greatest: float
    points: int
    bias: float

    @classmethod
    def read(cls, card: Card, step: Card) -> HarmonicDynamics:
        """Of the cards of a step. Raises InputError."""
        least, greatest, points, bias = values(card, 4)
        got, fits = f"{least:g} to {greatest:g}", 0.0 <= least <= greatest and greatest > 0.0
        require(fits, f"{card.where()}: band", got, "two frequencies >= 0 that grow")
        what = f"{card.where()}: points between natural frequencies"
        require(0.0 <= points <= _MOST, what, f"{points:g}", f"at most {_MOST}")
        points = max(int(points), 2) if points else _POINTS
        return cls(NONE, least, greatest, points, bias if bias >= 1.0 else _BIAS)

    def frequencies(self, natural: Float) -> Float:
        """At which the response is looked for."""
        inner = natural[(natural > self.least) & (natural < self.greatest)]
        ends = np.array([self.least, *inner, self.greatest])
        even = np.linspace(-1.0, 1.0, self.points)[1:-1]
        biased = np.sign(even) * np.abs(even) ** (1.0 / self.bias)
        between = 0.5 * (ends[1:] + ends[:-1]) + 0.5 * np.diff(ends) * biased[:, None]
        return np.unique([*ends, *between.ravel()])

    def solve(self, step: Step, analysis: Analysis) -> HarmonicResponse:
        """Raises InputError at a resonance that nothing damps."""
        assert step.motion is not None
        basis, beyond = modal_loads(step, analysis)
        frequencies = self.frequencies(basis.modes.frequencies)
        dampings = [StructuralDamping(analysis.loss_factor), step.damping or Rayleigh()]
        what = f"{analysis.path}: step {step.number}: frequencies, without *MODAL DAMPING"
        stiffness = basis.dynamic_stiffness(2.0 * np.pi * frequencies, dampings, what)
        ahead = np.where(step.motion.quadrature, 1j, 1.0)
        weights = step.motion.factors(frequencies) * ahead
        coordinates = np.hstack([weights @ basis.forcing / stiffness, weights])
        shapes = np.concatenate([basis.shapes, beyond])
        unknown = np.full(len(frequencies), np.nan)
        return HarmonicResponse(frequencies, coordinates, shapes, unknown, **basis.computation)


def modal_loads(step: Step, analysis: Analysis) -> tuple[ModalBasis, Float]:
    """What the cases of a motion do to the modes that were found last; and what these lack of the
    displacements that go with moving supports, (L,N,3)."""
    assert step.motion is not None
    modes = [one for one in analysis.before if isinstance(one, Modes)][-1]
    model, names = analysis.model_of(step.motion.cases), analysis.formulation
    forces = with_dead_loads(model, names).load_cases
    forcing = np.tensordot(forces, modes.shapes, axes=([1, 2], [1, 2]))
    moved = model.prescribed_cases.any(axis=(1, 2))
    beyond = np.zeros_like(forces)
    if moved.any():
        pulled = replace(
            model, forces=0.0 * forces[moved], prescribed=model.prescribed_cases[moved],
            loads=(), temperature=None,
        )  # fmt: skip
        u = converged(solve(pulled, formulation=names, tolerance=_TOLERANCE), step).u
        own = shares(analysis, modes, u)
        forcing[moved] += own * modes.angular**2
        beyond[moved] = u - np.tensordot(own, modes.shapes, axes=1)
    return ModalBasis(modes.shapes, modes.angular, forcing, modes), beyond


def shares(analysis: Analysis, modes: Modes, u: Float) -> Float:
    """(L,n) of modes in displacements (L,N,3) of what isn't held."""
    assert modes.model.fixed is not None
    mass = mass_matrix(modes.model, MASS, analysis.formulation)
    free = np.where(modes.model.fixed, 0.0, u).reshape(len(u), -1)
    return np.asarray((mass @ free.T).T @ modes.shapes.reshape(len(modes.shapes), -1).T)
