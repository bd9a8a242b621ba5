"""Arc length: the path of equilibria past limit points, where load factors turn back.

The load factor is an unknown of its own; the length of a step in displacements is given (Crisfield,
Comput. Struct. 13 (1981) 55). Each iteration solves two systems with one tangent, for the residual
and for the load, and takes the root of the constraint that goes on as the step began. A step begins
in the direction of the last one, so that no determinant is asked for its sign.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from gpusim.arrays.array_types import Float
from gpusim.errors import NotConverged
from gpusim.fem.assembly.equation import Equation, Tangent
from gpusim.fem.linear.tangent_solver import Correction, TangentSolver
from gpusim.fem.model.solution import Iteration
from gpusim.fem.procedures.newton import Controls, Equilibrium, error_left, relative_residual

# iterations of a step, and how many the length of the next one is chosen for
_MOST, _WANTED = 15, 5
_MOST_STEPS = 150
# of the longest step: one that has to be shorter is held up by something that no step gets past
_LEAST_LENGTH = 2.0**-12
# the length of a step changes by this factor at most
_CHANGE = 2.0


@dataclass(frozen=True)
class LoadPath:
    """Load factors from ``begin`` to ``target``, both (L,), in equal shares; the path is in s."""

    begin: Float
    target: Float

    def factors(self, s: float) -> Float:
        """(L,) of the load cases."""
        return (1.0 - s) * self.begin + s * self.target


def follow_path(
    equation: Equation,
    solver: TangentSolver,
    path: LoadPath,
    start: Equilibrium,
    length: float,
    controls: Controls,
) -> Iterator[Equilibrium]:
    """Equilibria from ``start`` on, about ``length`` (2-norm of displacements) apart at first, and
    at last a place near where the path first crosses its end, at a share of 1 or more.

    The elements are committed at each equilibrium before that: what lies beyond the end is nothing
    that they have been through. Raises NotConverged where steps become too small, or are too many.
    """
    branch = _Branch(equation, solver, path, controls)
    u, s = start.u, start.share
    before: Float | None = None
    longest = length
    for _ in range(_MOST_STEPS):
        begun = equation.snapshot()
        try:
            du, ds, iterations = branch.step(u, s, before, length)
        except NotConverged as error:
            equation.restore(begun)
            length *= 0.5
            if length < _LEAST_LENGTH * longest:
                raise NotConverged(f"by arc length: {error}") from None
            continue
        if s + ds >= 1.0:
            equation.restore(begun)
            yield Equilibrium(u + (1.0 - s) / ds * du, iterations, s + ds)
            return
        u, s, before = u + du, s + ds, du
        equation.commit(u, path.factors(s))
        yield Equilibrium(u, iterations, s)
        change = np.sqrt(_WANTED / len(iterations))
        length *= float(np.clip(change, 1.0 / _CHANGE, _CHANGE))
        longest = max(longest, length)
    raise NotConverged(f"by arc length: got {_MOST_STEPS} steps; expected fewer")


@dataclass(frozen=True, eq=False)
class _Branch:
    """Equilibria of an ``equation`` along a ``path``."""

    equation: Equation
    solver: TangentSolver
    path: LoadPath
    controls: Controls

    def step(
        self, u: Float, s: float, before: Float | None, length: float
    ) -> tuple[Float, float, tuple[Iteration, ...]]:
        """Displacements (N,3) and share of the load that lead to the next equilibrium."""
        equation, controls = self.equation, self.controls
        equation.forget_foretold()
        # the residual is rounding here, and no answer to it is wanted
        load = self._corrections(equation.linearised(u, self.path.factors(s))).du[0]
        size = float(np.linalg.norm(load))
        if size == 0.0:
            raise NotConverged("got a step in which no load grows; expected one that does")
        ds = length / size
        if before is not None and float(np.vdot(before, load)) < 0.0:
            ds = -ds
        du = ds * load
        equation.advance(u, du, foretell=False)
        done: list[Iteration] = []
        steps = [float(np.abs(du).max())]
        while len(done) < _MOST:
            tangent = equation.linearised(u + du, self.path.factors(s + ds))
            found = self._corrections(tangent, tangent.residual)
            residual, load = found.du
            share = _root(du, residual, load, length)
            step = residual + share * load
            equation.advance(u + du, step, foretell=False)
            du, ds = du + step, ds + share
            steps.append(float(np.abs(step).max()))
            moved = max(float(np.abs(u + du).max()), float(np.abs(u).max()))
            error = error_left(steps, found.residual) / moved
            free = relative_residual(equation, tangent)
            ended = error <= controls.tolerance
            definite = found.definite and (not ended or self.solver.definite(tangent))
            done.append(Iteration(steps[-1] / moved, free, found.iterations, definite, error))
            if ended:
                return du, ds, tuple(done)
        raise NotConverged(
            f"got steps of {done[-1].step:.2g} of the displacement after {_MOST} iterations"
        )

    def _corrections(self, tangent: Tangent, *forces: Float) -> Correction:
        """Answers to forces (N,3), and to those that the whole path adds, with supports at rest."""
        load = self.equation.external(tangent.u, self.path.target - self.path.begin)
        right = np.stack([*forces, load])
        return self.solver.correction(tangent, right, np.zeros_like(right), self.controls.forcing)


def _root(du: Float, residual: Float, load: Float, length: float) -> float:
    """Share x of the load with |du + residual + x load| = length, the root that goes on as du."""
    base = du + residual
    a, b = float(np.vdot(load, load)), float(np.vdot(load, base))
    c = float(np.vdot(base, base)) - length**2
    square = b * b - a * c
    if not square >= 0.0:
        raise NotConverged("got no load factor at this distance; expected a shorter step")
    roots = [(-b + sign * np.sqrt(square)) / a for sign in (1.0, -1.0)]
    return float(max(roots, key=lambda x: float(np.vdot(du, base + x * load))))
