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
from gpusim.fem.assembly.equation import Equation
from gpusim.fem.linear.tangent_solver import TangentSolver
from gpusim.fem.model.solution import Iteration
from gpusim.fem.procedures.newton import Controls, error_left

# iterations of a step, and how many the length of the next one is chosen for
_MOST, _WANTED = 15, 5
_MOST_STEPS, _MOST_CUTS = 400, 12
# the length of a step changes by this factor at most
_CHANGE = 2.0


@dataclass(frozen=True)
class LoadPath:
    """Load factors ``begin`` + s (``target`` - ``begin``), both (L,); the path is in s."""

    begin: Float
    target: Float

    def factors(self, s: float) -> Float:
        """(L,) of the load cases."""
        return self.begin + s * (self.target - self.begin)


@dataclass(frozen=True, eq=False)
class PathPoint:
    """Equilibrium at ``s`` of a load path; from 1 on, a place near the path's end."""

    s: float
    u: Float
    iterations: tuple[Iteration, ...]


def follow_path(
    equation: Equation,
    solver: TangentSolver,
    path: LoadPath,
    start: PathPoint,
    length: float,
    controls: Controls,
) -> Iterator[PathPoint]:
    """Equilibria from ``start`` on, about ``length`` (2-norm of displacements) apart at first, and
    at last a place near where the path first crosses its end.

    The elements are committed at each equilibrium before that: what lies beyond the end is nothing
    that they have been through. Raises NotConverged where steps become too small, or are too many.
    """
    u, s = start.u, start.s
    before: Float | None = None
    cuts = 0
    for _ in range(_MOST_STEPS):
        begun = equation.snapshot()
        try:
            du, ds, iterations = _step(equation, solver, path, (u, s), before, length, controls)
        except NotConverged as error:
            equation.restore(begun)
            cuts, length = cuts + 1, 0.5 * length
            if cuts > _MOST_CUTS:
                raise NotConverged(f"by arc length: {error}") from None
            continue
        if s + ds >= 1.0:
            equation.restore(begun)
            yield PathPoint(s + ds, u + (1.0 - s) / ds * du, tuple(iterations))
            return
        u, s, before, cuts = u + du, s + ds, du, 0
        equation.commit(u, path.factors(s))
        yield PathPoint(s, u, tuple(iterations))
        change = np.sqrt(_WANTED / len(iterations))
        length *= float(np.clip(change, 1.0 / _CHANGE, _CHANGE))
    raise NotConverged(f"by arc length: got {_MOST_STEPS} steps; expected fewer")


def _step(
    equation: Equation,
    solver: TangentSolver,
    path: LoadPath,
    state: tuple[Float, float],
    before: Float | None,
    length: float,
    controls: Controls,
) -> tuple[Float, float, list[Iteration]]:
    """Displacements (N,3) and share of the load that lead to the next equilibrium."""
    u, s = state
    equation.forget_foretold()
    residual, load, _ = _solved(equation, solver, path, u, s, controls)
    ds = length / float(np.linalg.norm(load))
    if before is not None and float(np.vdot(before, load)) < 0.0:
        ds = -ds
    du = ds * load
    equation.advance(u, du, foretell=False)
    done: list[Iteration] = []
    steps = [float(np.abs(du).max())]
    while len(done) < _MOST:
        residual, load, info = _solved(equation, solver, path, u + du, s + ds, controls)
        share = _root(du, residual, load, length)
        step = residual + share * load
        equation.advance(u + du, step, foretell=False)
        du, ds = du + step, ds + share
        steps.append(float(np.abs(step).max()))
        moved = max(float(np.abs(u + du).max()), float(np.abs(u).max()))
        error = error_left(steps, controls.forcing) / moved
        done.append(Iteration(steps[-1] / moved, info[0], info[1], info[2], error))
        if error <= controls.tolerance:
            return du, ds, done
    raise NotConverged(
        f"got steps of {done[-1].step:.2g} of the displacement after {_MOST} iterations"
    )


def _solved(
    equation: Equation,
    solver: TangentSolver,
    path: LoadPath,
    u: Float,
    s: float,
    controls: Controls,
) -> tuple[Float, Float, tuple[float, int, bool]]:
    """(N,3) answers to the residual and to the load, and what to say of them."""
    factors = path.factors(s)
    tangent = equation.linearised(u, factors)
    load = equation.external(u, path.target - path.begin)
    forces = np.stack([tangent.residual, load])
    found = solver.correction(tangent, forces, np.zeros_like(forces), controls.forcing)
    free = equation.unbalanced(tangent.residual)
    relative = float(np.abs(free).max() / max(np.abs(tangent.residual).max(), np.abs(load).max()))
    return found.du[0], found.du[1], (relative, found.iterations, found.definite)


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
