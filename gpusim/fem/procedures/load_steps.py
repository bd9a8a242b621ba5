"""Load steps: one equilibrium after another, with smaller steps where Newton's method fails, and by
arc length past limit points."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from gpusim.arrays.array_types import Float
from gpusim.errors import NotConverged
from gpusim.fem.assembly.equation import Equation
from gpusim.fem.linear.tangent_solver import TangentSolver
from gpusim.fem.model.solution import Iteration, LoadStep
from gpusim.fem.procedures.arc_length import LoadPath, PathPoint, follow_path
from gpusim.fem.procedures.newton import Controls, Steps, equilibrium
from gpusim.fem.recovery.linear_theory import turns_over

# share of a step below which no cut-back is tried
_LEAST_SHARE = 1.0 / 256.0


@dataclass(eq=False)
class _Stepping:
    """Where a load path has been followed to: ``u`` (N,3) at the share ``done`` of it, ``most`` at
    most, in so many ``substeps``, the last of which moved by ``length`` (2-norm)."""

    path: LoadPath
    u: Float
    done: float = 0.0
    most: float = 0.0
    substeps: int = 0
    length: float = 0.0
    iterations: list[Iteration] = field(default_factory=list)

    def move(self, share: float, u: Float, iterations: tuple[Iteration, ...]) -> None:
        self.length = float(np.linalg.norm(u - self.u))
        self.u, self.done, self.substeps = u, share, self.substeps + 1
        self.most = max(self.most, share)
        self.iterations += iterations


def load_steps(
    equation: Equation, solver: TangentSolver, targets: Float, controls: Controls
) -> Iterator[LoadStep]:
    """Equilibria at ``targets`` (K,L), each from the one before, and those on the way that were
    found by arc length. They are stable, unless there is no way around: a step that leads to one
    that isn't may have left the path that the body would take.

    Raises NotConverged where none is found: what has been yielded stays right.
    """
    u, begin = np.zeros_like(equation.model.mesh.points), np.zeros(targets.shape[1])
    wanted = controls
    for number, target in enumerate(targets, start=1):
        stepping = _Stepping(LoadPath(begin, target), u)
        try:
            for point in _passed(equation, solver, stepping, wanted):
                yield _step(equation, stepping, stepping.path.factors(point.s), False)
                stepping.iterations, stepping.substeps = [], 0
        except NotConverged as last:
            where = f"load step {number} of {len(targets)}, at {stepping.done:.3g} of it"
            if stepping.most > stepping.done:
                where += f", after loads turned back at {stepping.most:.3g} (a limit load?)"
            raise NotConverged(f"{where}: {last}") from None
        yield _step(equation, stepping, target, True)
        u, begin = stepping.u, target
        # no stable way leads on from where a body isn't
        stable = controls.stable and stepping.iterations[-1].definite
        wanted = replace(controls, stable=stable)


def _passed(
    equation: Equation, solver: TangentSolver, stepping: _Stepping, controls: Controls
) -> Iterator[PathPoint]:
    """To the end of the path, past the points by arc length that are yielded: with stable ends if
    there is such a way."""
    path = stepping.path
    by_forces = equation.by_forces_alone(path.target - path.begin)
    # given motion and heat stress a body at first more than it stays; metal flows
    steady = by_forces and controls.stable and controls.steps is Steps.FORETOLD
    try:
        _by_halving(equation, solver, stepping, replace(controls, steady=steady))
        return
    except NotConverged:
        any_end = replace(controls, stable=False)
    if by_forces and stepping.substeps:
        yield from _by_arc_length(equation, solver, stepping, any_end)
    else:
        _by_halving(equation, solver, stepping, any_end)


def _by_halving(
    equation: Equation, solver: TangentSolver, stepping: _Stepping, controls: Controls
) -> None:
    """To the end of the path: a step in which Newton's method fails is halved until it is found,
    and doubled again after two that were."""
    share, in_a_row = 1.0, 0
    while stepping.done < 1.0:
        share = min(share, 1.0 - stepping.done)
        end = stepping.done + share
        try:
            factors = stepping.path.factors(end)
            begun = equation.snapshot()
            found = equilibrium(equation, solver, stepping.u, factors, controls)
            if controls.stable and turns_over(equation.model.mesh, stepping.u, found.u):
                equation.restore(begun)
                raise NotConverged("got a cell that turns by more than 120 degrees in one step")
        except NotConverged:
            share, in_a_row = 0.5 * share, 0
            if share < _LEAST_SHARE:
                if not controls.steady or stepping.substeps:
                    raise
                # there isn't even a beginning: steps that may leave the path are better than none
                controls, share = replace(controls, steady=False), 1.0
            continue
        equation.commit(found.u, factors)
        stepping.move(end, found.u, found.iterations)
        in_a_row += 1
        if in_a_row == 2:
            share, in_a_row = 2.0 * share, 0


def _by_arc_length(
    equation: Equation, solver: TangentSolver, stepping: _Stepping, controls: Controls
) -> Iterator[PathPoint]:
    """The same past limit points: until the path crosses its end, where Newton's method goes on."""
    path, start = stepping.path, PathPoint(stepping.done, stepping.u, ())
    for point in follow_path(equation, solver, path, start, stepping.length, controls):
        stepping.move(point.s, point.u, point.iterations)
        if point.s >= 1.0:
            found = equilibrium(equation, solver, point.u, path.target, controls)
            equation.commit(found.u, path.target)
            stepping.move(1.0, found.u, found.iterations)
            return
        yield point


def _step(equation: Equation, stepping: _Stepping, factors: Float, wanted: bool) -> LoadStep:
    u, done = stepping.u, stepping.iterations
    reactions = equation.reactions(u, factors)
    return LoadStep(
        factors, u, reactions, tuple(done), done[-1].error_estimate, stepping.substeps, wanted
    )
