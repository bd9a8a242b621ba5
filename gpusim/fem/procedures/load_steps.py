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
from gpusim.fem.procedures.arc_length import LoadPath, follow_path
from gpusim.fem.procedures.newton import Controls, Equilibrium, Steps, equilibrium
from gpusim.fem.recovery.linear_theory import turns_over

# share of a step below which no cut-back is tried
_LEAST_SHARE = 1.0 / 256.0


@dataclass(eq=False)
class _Stepping:
    """Where the load paths of an ``equation`` have been followed to: ``u`` (N,3) at the share
    ``done`` of the last ``path``, ``most`` at most, where ``acting`` (N,3) forces, of loads and
    ``reactions``, have done ``work``.

    Since the last load step: ``substeps``, with their ``iterations``; ``length`` is the motion of
    the last one (2-norm).
    """

    equation: Equation
    path: LoadPath
    u: Float
    acting: Float
    reactions: Float = field(init=False)
    work: float = 0.0
    done: float = 0.0
    most: float = 0.0
    length: float = 0.0
    substeps: int = 0
    iterations: list[Iteration] = field(default_factory=list)

    def move(self, found: Equilibrium) -> None:
        factors, way = self.path.factors(found.share), found.u - self.u
        self.reactions = self.equation.reactions(found.u, factors)
        acting = self.equation.external(found.u, factors) + self.reactions
        self.work += 0.5 * float(np.vdot(self.acting + acting, way))
        self.u, self.acting, self.length = found.u, acting, float(np.linalg.norm(way))
        self.done, self.most = found.share, max(self.most, found.share)
        self.substeps += 1
        self.iterations += found.iterations

    def load_step(self, wanted: bool) -> LoadStep:
        """What has been moved since the last one."""
        done, substeps = tuple(self.iterations), self.substeps
        self.iterations, self.substeps = [], 0
        factors, error = self.path.factors(self.done), done[-1].error_estimate
        return LoadStep(
            factors, self.u, self.reactions, done, error, substeps, wanted, external_work=self.work
        )


def load_steps(
    equation: Equation, solver: TangentSolver, targets: Float, controls: Controls
) -> Iterator[LoadStep]:
    """Equilibria at ``targets`` (K,L), each from the one before, and those on the way that were
    found by arc length. They are stable, unless there is no way around: a step that leads to one
    that isn't may have left the path that the body would take.

    Raises NotConverged where none is found: what has been yielded stays right.
    """
    rest = np.zeros_like(equation.model.mesh.points)
    begin, wanted = np.zeros(targets.shape[1]), controls
    stepping = _Stepping(equation, LoadPath(begin, begin), rest, rest)
    for number, target in enumerate(targets, start=1):
        stepping.path, stepping.done, stepping.most = LoadPath(begin, target), 0.0, 0.0
        try:
            yield from _passed(solver, stepping, wanted)
        except NotConverged as last:
            where = f"load step {number} of {len(targets)}, at {stepping.done:.3g} of it"
            if stepping.most > stepping.done:
                where += f", after loads turned back at {stepping.most:.3g} (a limit load?)"
            raise NotConverged(f"{where}: {last}") from None
        # no stable way leads on from where a body isn't
        stable = controls.stable and stepping.iterations[-1].definite
        begin, wanted = target, replace(controls, stable=stable)
        yield stepping.load_step(True)


def _passed(solver: TangentSolver, stepping: _Stepping, controls: Controls) -> Iterator[LoadStep]:
    """To the end of the path, past the points by arc length that are yielded: with stable ends if
    there is such a way."""
    equation, path = stepping.equation, stepping.path
    by_forces = equation.by_forces_alone(path.target - path.begin)
    # given motion and heat stress a body at first more than it stays; metal flows
    steady = by_forces and controls.stable and controls.steps is Steps.FORETOLD
    try:
        _by_halving(solver, stepping, replace(controls, steady=steady))
        return
    except NotConverged:
        any_end = replace(controls, stable=False)
    if by_forces and stepping.substeps:
        yield from _by_arc_length(solver, stepping, any_end)
    else:
        _by_halving(solver, stepping, any_end)


def _by_halving(solver: TangentSolver, stepping: _Stepping, controls: Controls) -> None:
    """To the end of the path: a step in which Newton's method fails is halved until it is found,
    and doubled again after two that were."""
    equation, share, in_a_row = stepping.equation, 1.0, 0
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
        stepping.move(replace(found, share=end))
        in_a_row += 1
        if in_a_row == 2:
            share, in_a_row = 2.0 * share, 0


def _by_arc_length(
    solver: TangentSolver, stepping: _Stepping, controls: Controls
) -> Iterator[LoadStep]:
    """The same past limit points: until the path crosses its end, where Newton's method goes on."""
    equation, path = stepping.equation, stepping.path
    start = Equilibrium(stepping.u, (), stepping.done)
    for point in follow_path(equation, solver, path, start, stepping.length, controls):
        if point.share < 1.0:
            stepping.move(point)
            yield stepping.load_step(False)
            continue
        found = equilibrium(equation, solver, point.u, path.target, controls)
        equation.commit(found.u, path.target)
        stepping.iterations += point.iterations
        stepping.move(found)
