"""Direct integration in time, by the HHT method."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from gpusim.arrays.array_types import Float
from gpusim.deck.increments import Increments
from gpusim.deck.procedures import MASS, Static, last_state
from gpusim.deck.step import Analysis, Procedure, Step
from gpusim.fem import History, Record
from gpusim.fem.dynamics.initial_value_problem import InitialValueProblem
from gpusim.fem.dynamics.nonlinear_motion import NonlinearMotion
from gpusim.fem.dynamics.time_integration import LinearMotion, Scheme
from gpusim.fem.dynamics.transient import integrated
from gpusim.fem.linear.solve_plan import Clock, Options
from gpusim.fem.model.history import State
from gpusim.mesh.formats.abaqus.cards import Card, number
from gpusim.validation import require

# the parameter of the HHT method, where a deck says none
_ALPHA = -0.05
# of an increment: in so much of it CalculiX has the stiffness slow the first acceleration
_FIRST = 0.1


@dataclass(frozen=True)
class Dynamics(Procedure):
    """*DYNAMIC: step by step, with the parameter ``alpha``, -1/3 to 0."""

    moves = True
    alpha: float

    @classmethod
    def read(cls, card: Card, step: Card) -> Dynamics:
        """Of the cards of a step. Raises InputError."""
        increments = replace(Increments.read(card, step), at_once=True, alike=2)
        alpha = number(card.parameters.get("ALPHA") or str(_ALPHA), card.where())
        fits = -1.0 / 3.0 <= alpha <= 0.0
        require(fits, f"{card.where()}: ALPHA", f"{alpha:g}", "-1/3 to 0")
        return cls(increments, alpha)

    def unfit(self, before: Sequence[Step], perturbation: bool) -> str:
        """After a state that isn't whole, or gone."""
        other = any(not isinstance(one.procedure, Static | Dynamics) for one in before)
        if other or perturbation:
            return "PERTURBATION, or steps before that aren't *STATIC or *DYNAMIC; expected neither"
        return ""

    def solve(self, step: Step, analysis: Analysis) -> History:
        """From where the steps before have left the body, or as it is at the beginning."""
        assert step.motion is not None
        times = np.array([step.motion.begin, *step.increments])
        factors = Record(times, step.motion.factors(times))
        model = analysis.model_of(step.motion.cases)
        scheme = Scheme(0.0, -self.alpha, 0.25 * (1.0 - self.alpha) ** 2, 0.5 - self.alpha)
        share = (1.0 + self.alpha) * scheme.beta * (_FIRST * self.increments.first) ** 2
        # CalculiX integrates the mass of C3D20R by all points here, that of others as for modes
        rule = "exact" if analysis.formulation.get("hex20") == "reduced" else MASS
        problem = InitialValueProblem(
            model, analysis.formulation, rule, factors, *last_state(step, analysis)
        )
        names, limit = analysis.formulation, analysis.tolerance
        options = Options(analysis.method, None, "numpy", limit, None, None, None, names, Clock())
        moving = NonlinearMotion if analysis.nonlinear else LinearMotion
        motion = moving(problem, scheme, analysis.damping, options)
        fields = integrated(motion, _states(motion, times, share), times, None, None)
        return History(times, method="hht", timings=options.clock.timings, model=model, **fields)


def _states(motion: LinearMotion, times: Float, share: float) -> Iterator[tuple[State, float]]:
    """At the ends of increments, whose errors aren't looked at; at first a ``share`` of the
    stiffness slows the body beside its mass."""
    state = motion.begin(times[0], share)
    yield state, np.nan
    for time in times[1:]:
        state = motion.advance(state, time - state.time)
        yield state, np.nan
