"""Motion at large displacements: equilibrium with the forces of inertia, by Newton's method.

Within a step these are linear in the displacement that it ends in: those of a predicted state, and
s M times what it differs by. So each step is an equilibrium of the static kind, of a body on
springs s M.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from gpusim.arrays.array_types import Float
from gpusim.errors import NotConverged
from gpusim.fem.assembly.element_batches import Elements, portions
from gpusim.fem.assembly.element_responses import element_responses
from gpusim.fem.assembly.equation import Equation, Tangent
from gpusim.fem.assembly.shifted_system import Shift, shifted_elements, with_row_sums
from gpusim.fem.dynamics.initial_value_problem import InitialValueProblem
from gpusim.fem.dynamics.time_integration import LinearMotion, Scheme, predicted
from gpusim.fem.elements.element_response import Internal, Want
from gpusim.fem.linear.solve_plan import Options
from gpusim.fem.linear.tangent_solver import TangentSolver
from gpusim.fem.model.damping import Rayleigh
from gpusim.fem.model.history import State
from gpusim.fem.model.mass import ElementMass, scalar_mass
from gpusim.fem.procedures.newton import Controls, Steps, equilibrium
from gpusim.validation import require

# linear solutions within Newton's method, and the estimate of a step's error
_FORCING, _ROUGHLY = 1e-4, 0.1
# relative difference of shifts that is rounding
_SAME = 1e-9
# of the greatest energy: what steps may add to it before they count as unstable
_MOST_GROWTH = 0.05


class StepEquation(Equation):
    """A body on springs, ``shift``, that pull it to ``origin`` (N,3), and further ``forces``
    (N,3): those of inertia at the end of a step."""

    shift: Shift
    origin: Float
    forces: Float

    def linearised(self, u: Float, factors: Float, want: Want = Want.TANGENT) -> Tangent:
        """With the springs."""
        tangent = super().linearised(u, factors, want)
        rows = with_row_sums(tangent.assembled.rows, self.shift)
        pull = self.forces - self.shift.forces((u - self.origin)[None])[0]
        return replace(
            tangent,
            residual=tangent.residual + pull,
            assembled=replace(tangent.assembled, rows=rows),
        )

    def elements(self, u: Float, want: Want, forces: Sequence[Float]) -> Sequence[Elements]:
        """With their share of the springs."""
        return [shifted_elements(one, self.shift) for one in super().elements(u, want, forces)]


@dataclass(frozen=True, eq=False)
class Balance:
    """At the end of a step: what elements remember, ``external`` and ``internal`` forces (N,3),
    kinetic and strain ``energies``, NaN where a law doesn't tell them."""

    elements: list[Internal]
    external: Float
    internal: Float
    energies: Float


class NonlinearMotion(LinearMotion):
    """M a + C v + f_int(u) = f(u), in displacements (N,3), C a multiple of the mass.

    A step is found when Newton's method has an error of ``options.tolerance`` of the greatest
    displacement. One that adds energy to the body isn't. Linear theory gives the first
    accelerations, and the size of what is to come.
    """

    def __init__(
        self, problem: InitialValueProblem, scheme: Scheme, damping: Rayleigh, options: Options
    ) -> None:
        super().__init__(problem, scheme, damping, options)
        model, names = problem.model, problem.formulation
        self._elements = StepEquation(model, element_responses(model, names))
        elements = ElementMass(model, names, problem.mass_rule)
        self._mass = Shift(elements, scalar_mass(elements), 1.0)
        self._balances: dict[float, Balance] = {}
        # the shift that the solver is for, and the greatest energy until now
        self._solved, self._greatest = 0.0, 0.0

    def begin(self, time: float, onset: float = 0.0) -> State:
        """As that of `LinearMotion`, of the stiffness there."""
        u, v = self._problem.u, self._problem.v
        if u.any():
            expected = "rest, or elastic laws: what points have been through isn't known"
            known = not self._elements.has_history
            require(known, "transient: initial", "displacements of a law with a history", expected)
            self._elements.relax(u, self._factors(time))
        balance = self._balances[time] = self._balance(time, u, v)
        force = balance.external - balance.internal - self._inertia(self._damping.mass * v)
        if onset > 0.0:
            a = self._slowed(force / onset, u, time, 1.0 / onset)
        else:
            a = super().displacements(self.accelerations(self.equation.forces(force[None])))
        return State(time, u, v, a, np.zeros(2))

    def _slowed(self, force: Float, u: Float, time: float, shift: float) -> Float:
        """(N,3) by ``force`` at ``u`` on the stiffness and ``shift`` times the mass."""
        elements = self._elements
        elements.shift = replace(self._mass, factor=shift)
        elements.forces, elements.origin = np.zeros_like(u), u
        tangent = elements.linearised(u, self._factors(time))
        solver = TangentSolver(elements, self._options)
        still, tolerance = np.zeros_like(force[None]), self._options.tolerance
        return np.asarray(solver.correction(tangent, force[None], still, tolerance).du[0])

    def advance(self, state: State, step: float) -> State:
        """One equilibrium, from the last state."""
        scheme, equation, before = self.scheme, self._elements, self._balances[state.time]
        equation.restore(before.elements)
        shift, factor = scheme.shift(step, self._damping)
        if abs(shift - self._solved) > _SAME * shift:
            self._tangents, self._solved = TangentSolver(equation, self._options), shift
        equation.shift = replace(self._mass, factor=shift)
        after = predicted(state, step)
        drag = self._damping.mass * scheme.between(state.v, after.v)
        equation.forces = scheme.alpha_f * (before.external - before.internal)
        equation.forces = (equation.forces - self._inertia(state.a + drag)) / factor
        equation.origin = after.u
        factors = self._factors(after.time)
        first = Steps.SEARCHED if equation.has_history else Steps.FORETOLD
        controls = Controls(self._options.tolerance, _FORCING, first, stable=False)
        found = equilibrium(equation, self._tangents, state.u, factors, controls)
        equation.commit(found.u, factors)
        self._counts.append(len(found.iterations))
        after = scheme.corrected(after, found.u - after.u, step)
        balance = self._balance(after.time, after.u, after.v)
        self._balances = {state.time: before, after.time: balance}
        return replace(after, gains=state.gains + self._gains(state, after))

    def error(self, before: State, after: State) -> float:
        """As that of `LinearMotion`."""
        tangent = self._elements.linearised(after.u, self._factors(after.time))
        pull = self._elements.shift.forces(self.scheme.local_error(before, after)[None])
        found = self._tangents.correction(tangent, pull, np.zeros_like(pull), _ROUGHLY)
        return float(np.abs(found.du).max())

    def displacements(self, x: Float) -> Float:
        """(N,3) of those of states."""
        return x

    def _energies(self, state: State) -> Float:
        return np.append(self._balances[state.time].energies, state.gains)

    def _inertia(self, a: Float) -> Float:
        return np.asarray(self._mass.forces(a[None])[0])

    def _factors(self, time: float) -> Float:
        return np.asarray(self._problem.factors.at(np.array([time]))[0])

    def _balance(self, time: float, u: Float, v: Float) -> Balance:
        equation, factors, strain = self._elements, self._factors(time), 0.0
        external, internal = equation.external(u, factors), equation.internal(u, factors)
        for one in equation.responses:
            for which in portions(len(one.cells)):
                values = one.point_values(which, u)
                strain += float(np.vdot(values.results["energy"], values.volume))
        energies = np.array([0.5 * np.vdot(v, self._inertia(v)), strain])
        return Balance(equation.snapshot(), external, internal, energies)

    def _gains(self, before: State, after: State) -> Float:
        """In a step. Raises NotConverged where the body has gained energy that nobody gave it."""
        begin, end = (self._balances[one.time] for one in (before, after))
        moved, stored = after.u - before.u, end.energies - begin.energies
        work = 0.5 * float(np.vdot(begin.external + end.external, moved))
        drag = self._damping.mass / (after.time - before.time) * self._inertia(moved)
        lost = float(np.vdot(moved, drag))
        if self._elements.has_history:
            # strained for good
            lost += 0.5 * float(np.vdot(begin.internal + end.internal, moved)) - stored[1]
        self._greatest = max(self._greatest, float(begin.energies.sum()))
        size = max(self._greatest, float(end.energies.sum()), 1e-300)
        share = (stored.sum() + lost - work) / size
        if share > _MOST_GROWTH:
            raise NotConverged(f"{share:.1%} of the energy in a step, from nowhere")
        return np.array([work, lost])
