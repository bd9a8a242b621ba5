"""Time integration: Newmark's method, HHT-alpha and generalized-alpha, step by step.

Balance of forces is asked for between the ends of a step (Chung & Hulbert, J. Appl. Mech. 60 (1993)
371): inertia at a share ``alpha_m``, all other forces at ``alpha_f`` before its end. A step solves
(K + s M) d = residual at a predicted state, so that what an iteration leaves doesn't add up.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import count

import numpy as np

from gpusim.arrays.array_types import Float
from gpusim.errors import NotConverged
from gpusim.fem.dynamics.initial_value_problem import InitialValueProblem
from gpusim.fem.krylov.cg import Preconditioner
from gpusim.fem.krylov.truncated_cg import truncated_cg
from gpusim.fem.linear.shifted_solver import ShiftedSolver
from gpusim.fem.linear.solve_plan import Options
from gpusim.fem.model.damping import Rayleigh
from gpusim.fem.model.history import State
from gpusim.validation import require

METHODS = ("newmark", "hht", "generalized-alpha")
# of conjugate gradients on the mass, whose condition is some tens once it is scaled
_MASS_TOLERANCE = 1e-12
# relative difference of shifts that is rounding
_SAME = 1e-9
# an adaptive step is doubled where its error is so much below what is allowed: it grows by 8
_SMALL_ERROR = 1.0 / 16.0
_MOST_HALVINGS = 20
# constant steps whose error is estimated: every so many
_LOOK = 10


@dataclass(frozen=True)
class Scheme:
    """The parameters of generalized-alpha, of which the others are cases."""

    alpha_m: float
    alpha_f: float
    beta: float
    gamma: float

    @staticmethod
    def named(method: str, spectral_radius: float) -> Scheme:
        """Second order, with that spectral radius at high frequencies: 1 keeps their energy, and 0
        takes it in a step. Newmark's has 1: the trapezoidal rule; HHT's is from 0.5 up."""
        alpha_m, alpha_f, rho = 0.0, 0.0, spectral_radius
        if method == "hht":
            require(rho >= 0.5, "transient: spectral_radius", rho, "0.5 to 1 for hht")
            alpha_f = (1.0 - rho) / (1.0 + rho)
        elif method == "generalized-alpha":
            alpha_m, alpha_f = (2.0 * rho - 1.0) / (rho + 1.0), rho / (rho + 1.0)
        ahead = 1.0 - alpha_m + alpha_f
        return Scheme(alpha_m, alpha_f, 0.25 * ahead**2, ahead - 0.5)

    def shift(self, step: float, damping: Rayleigh) -> tuple[float, float]:
        """s and the factor of K + s M in a step's matrix."""
        speed = (1.0 - self.alpha_f) * self.gamma / (self.beta * step)
        factor = (1.0 - self.alpha_f) + damping.stiffness * speed
        inertia = (1.0 - self.alpha_m) / (self.beta * step**2)
        return (inertia + damping.mass * speed) / factor, factor

    def between(self, begin: Float, end: Float) -> Float:
        """Where forces are asked for."""
        if self.alpha_f == 0.0:
            return end
        return self.alpha_f * begin + (1.0 - self.alpha_f) * end

    def corrected(self, predicted: State, d: Float, step: float) -> State:
        """Of a state that was predicted with the acceleration of the step's beginning, the one with
        a displacement that differs by ``d``."""
        change = d / (self.beta * step**2)
        return replace(
            predicted,
            u=predicted.u + d,
            v=predicted.v + self.gamma * step * change,
            a=predicted.a + change,
        )

    def local_error(self, before: State, after: State) -> Float:
        """Of a step's displacement, what the next order would add (Zienkiewicz & Xie, Earthquake
        Eng. Struct. Dyn. 20 (1991) 871)."""
        step = after.time - before.time
        return abs(self.beta - 1.0 / 6.0) * step**2 * (after.a - before.a)


def predicted(state: State, step: float) -> State:
    """A step later, with the same acceleration."""
    u = state.u + step * state.v + 0.5 * step**2 * state.a
    v = state.v + step * state.a
    return replace(state, time=state.time + step, u=u, v=v)


class LinearMotion:
    """M a + C v + K u = f, in rows (1,3N) of an equation of motion.

    Where no factors are at hand, conjugate gradients end when the energy in K + s M of their error
    is ``options.tolerance``^2 of the state's.
    """

    def __init__(
        self, problem: InitialValueProblem, scheme: Scheme, damping: Rayleigh, options: Options
    ) -> None:
        self._problem, self.scheme, self._damping = problem, scheme, damping
        self._options = options
        self.equation = problem.linear_equation
        self._forces = problem.forces(self.equation)
        self._begin = self.equation.unknowns(np.stack([problem.u, problem.v]))[:, None]
        self._solvers: dict[float, ShiftedSolver] = {}
        self._counts: list[int] = []
        # a step ends where the next one begins
        self.energies, self._load = lru_cache(2)(self._energies), lru_cache(2)(self._load_at)

    @property
    def message(self) -> str:
        """How steps were solved."""
        if not self._counts:
            return "one back-substitution each"
        return f"{np.mean(self._counts):.1f} iterations each"

    def begin(self, time: float, onset: float = 0.0) -> State:
        """Forces that aren't balanced accelerate it from the first instant on: (M + ``onset`` K) a
        is what they are."""
        (u, v), equation, damping = self._begin, self.equation, self._damping
        force = self._load(time) - equation.stiffness(u + damping.stiffness * v)
        force -= damping.mass * equation.inertia(v)
        if onset > 0.0:
            a = self._solution(self._solver(1.0 / onset), force / onset, 0.0)
        else:
            a = self.accelerations(force)
        return State(time, u, v, a, np.zeros(2))

    def accelerations(self, force: Float) -> Float:
        """M^-1 ``force``, by conjugate gradients that are scaled by the diagonal.

        Raises NotConverged where the mass isn't positive definite.
        """
        diagonal = np.repeat(self.equation.mass.diagonal(), 3) / self.equation.scale
        near = _Diagonal(np.where(diagonal > 0.0, diagonal, 1.0))
        found = truncated_cg(self.equation.inertia, near, force, _MASS_TOLERANCE)
        if found is None:
            expected = "a positive definite one: mass='exact' or 'lumped'"
            raise NotConverged(f"transient: mass matrix; got a singular one; expected {expected}")
        return found[0]

    def advance(self, state: State, step: float) -> State:
        """One solve, at the predicted state."""
        scheme, damping, equation = self.scheme, self._damping, self.equation
        shift, factor = scheme.shift(step, damping)
        after = predicted(state, step)
        u, v = scheme.between(state.u, after.u), scheme.between(state.v, after.v)
        strained = u + damping.stiffness * v
        inner = equation.stiffness(strained)
        force = scheme.between(self._load(state.time), self._load(after.time)) - inner
        solver, energy, pushed = self._solver(shift), 0.0, state.a + damping.mass * v
        if solver.exact:
            force -= equation.inertia(pushed)
        else:
            # two products with the mass at a time take little more than one
            inertia = equation.inertia(np.concatenate([pushed, after.u]))
            force -= inertia[:1]
            energy = float(np.vdot(strained, inner) + shift * np.vdot(after.u, inertia[1]))
        after = scheme.corrected(after, self._solution(solver, force / factor, energy), step)
        return replace(after, gains=state.gains + self._gains(state, after))

    def error(self, before: State, after: State) -> float:
        """Of a step, estimated, of the greatest displacement. What such steps don't resolve of
        motions is left out: it stays small."""
        shift, _ = self.scheme.shift(after.time - before.time, self._damping)
        inertia = self.equation.inertia(self.scheme.local_error(before, after))
        return float(np.abs(self._solver(shift).apply(shift * inertia)).max())

    def size(self, duration: float) -> float:
        """About the greatest displacement: what loads, and impulses that make the first velocities,
        would do in a motion that takes as long."""
        (u, v), shift = self._begin, (2.0 * np.pi / duration) ** 2
        push = np.abs(self._problem.factors.values).max(axis=0, keepdims=True) @ self._forces
        push += shift * self.equation.inertia(u + v / np.sqrt(shift))
        return float(np.abs(self._solver(shift).apply(push)).max())

    def _gains(self, before: State, after: State) -> Float:
        """In a step, by the trapezoidal rule, which is exact in Newmark's method."""
        moved, damping, equation = after.u - before.u, self._damping, self.equation
        work = 0.5 * np.vdot(self._load(before.time) + self._load(after.time), moved)
        lost = 0.0
        if damping.mass > 0.0 or damping.stiffness > 0.0:
            drag = damping.mass * equation.inertia(moved)
            drag += damping.stiffness * equation.stiffness(moved)
            lost = float(np.vdot(moved, drag)) / (after.time - before.time)
        return equation.scale * np.array([work, lost])

    def _energies(self, state: State) -> Float:
        """(4,) the fields of an `EnergyHistory`."""
        equation, u, v = self.equation, state.u, state.v
        twice = np.vdot(v, equation.inertia(v)), np.vdot(u, equation.stiffness(u))
        return np.append(0.5 * equation.scale * np.array(twice), state.gains)

    def displacements(self, x: Float) -> Float:
        """(N,3) of a vector of states, with what constraints gave up."""
        return np.asarray(self.equation.displacements(x)[0])

    def _load_at(self, time: float) -> Float:
        return self._problem.factors.at(np.array([time])) @ self._forces

    def _solver(self, shift: float) -> ShiftedSolver:
        """Adaptive steps go back and forth between two lengths; equal ones differ by rounding."""
        for near, solver in self._solvers.items():
            if abs(shift - near) <= _SAME * near:
                return solver
        while len(self._solvers) > 1:
            del self._solvers[next(iter(self._solvers))]
        self._solvers[shift] = ShiftedSolver(self.equation, shift, self._options)
        return self._solvers[shift]

    def _solution(self, solver: ShiftedSolver, right: Float, size: float) -> Float:
        """To the tolerance, of an energy of that ``size``."""
        if solver.exact:
            return solver.apply(right)
        near, tolerance = solver.preconditioner, self._options.tolerance
        found = truncated_cg(solver.product, near, right, tolerance, size)
        if found is None:
            raise NotConverged("transient: got a stiffness that isn't definite; expected one")
        self._counts.append(found[1])
        return found[0]


class _Diagonal(Preconditioner):
    def __init__(self, diagonal: Float) -> None:
        super().__init__()
        self._diagonal = diagonal

    def apply(self, r: Float) -> Float:
        return r / self._diagonal


def time_steps(
    motion: LinearMotion, first: float, allowed: float, state: State
) -> Iterator[tuple[State, float]]:
    """States one step after the other from the given one on, and the estimated errors of steps;
    NaN where none is known, as of constant steps but every tenth.

    The ``first`` step is the longest: shorter ones are taken where their error would be greater
    than ``allowed``. Raises NotConverged where a constant step fails, or an adaptive one becomes
    too small.
    """
    step, adaptive = first, allowed < np.inf
    yield state, np.nan
    for number in count():
        for _ in range(_MOST_HALVINGS if adaptive else 1):
            error = np.nan
            try:
                after = motion.advance(state, step)
                if adaptive or number % _LOOK == 0:
                    error = motion.error(state, after)
                if not adaptive or error <= allowed:
                    break
                reason = f"an error of {error:.2g}"
            except NotConverged as failure:
                reason = str(failure)
            step *= 0.5
        else:
            raise NotConverged(
                f"transient: a step from {state.time:.6g}; got {reason}; expected one that can be "
                f"made: a shorter one than {first:.3g} (step_s of scenes; of gs.transient "
                "also step='adaptive')"
            )
        yield after, error
        state = after
        if adaptive and error <= _SMALL_ERROR * allowed:
            step = min(2.0 * step, first)
