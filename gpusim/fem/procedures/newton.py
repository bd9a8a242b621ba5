"""Newton's method for one load step.

Where laws are elastic, the geometric part of a tangent takes, from the second iteration on, the
stresses that the linear part of the last step foretold in place of those of the state that it ended
in (mixed integration points; Magisano, Leonetti & Garcea, IJNME 109 (2017) 1237): a slender body
passes through states of huge membrane forces on its way, whose tangents lead nowhere. Where points
have a history, steps that go too far are shortened (`line_search`). Where that doesn't settle,
plain iterations begin anew: a line search stops at once what passes through membrane forces.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from enum import Enum
from itertools import pairwise

import numpy as np

from gpusim.arrays.array_types import Float
from gpusim.errors import NotConverged
from gpusim.fem.assembly.equation import Equation, Tangent
from gpusim.fem.linear.tangent_solver import TangentSolver
from gpusim.fem.model.solution import Iteration
from gpusim.fem.procedures.line_search import line_search

# of the motion: a step below it is rounding
_ROUNDING = 1e-13
# by which a step shrinks, at best, as far as is counted on: one that had nothing to find, as where
# the first step of an even strain was right, doesn't tell how good a tangent is
_SHRINK = 1e-4
# a step less than this share of the motion foretells stresses to within the square of it, 1e-3
_FORETELLS = 0.03
# an iterate this many times as large as the body has left for good
_LOST = 1e3


@dataclass(frozen=True, eq=False)
class Equilibrium:
    """``u`` (N,3) in equilibrium, at a ``share`` of a load path, and how it was found."""

    u: Float
    iterations: tuple[Iteration, ...]
    share: float = 1.0


class Steps(Enum):
    """Of an iteration, with the number of them after which they won't settle."""

    FORETOLD = "foretold", 12
    SEARCHED = "searched", 30
    PLAIN = "plain", 25


@dataclass(frozen=True)
class Controls:
    """``tolerance`` of the displacements in equilibrium, relative; ``forcing``: that of each linear
    solution; which ``steps`` are tried first; ``stable``: an equilibrium whose tangent is
    symmetric, but indefinite, is none; ``steady``: nor is one on whose way a tangent was, which may
    be another than the load path leads to; ``progress`` is called with (iterations, estimated
    error)."""

    tolerance: float
    forcing: float
    steps: Steps
    stable: bool
    progress: Callable[[int, float], None] | None = None
    steady: bool = False


def equilibrium(
    equation: Equation, solver: TangentSolver, u: Float, factors: Float, controls: Controls
) -> Equilibrium:
    """Equilibrium at ``factors`` (L,) of the load cases, from the state ``u`` (N,3).

    Raises NotConverged, with the elements back where they were.
    """
    begun = equation.snapshot()
    try:
        return _iterated(equation, solver, u, factors, controls)
    except NotConverged:
        equation.restore(begun)
    try:
        return _iterated(equation, solver, u, factors, replace(controls, steps=Steps.PLAIN))
    except NotConverged:
        equation.restore(begun)
        raise


def _iterated(
    equation: Equation, solver: TangentSolver, u: Float, factors: Float, controls: Controls
) -> Equilibrium:
    extent = float(np.ptp(equation.model.mesh.points, axis=0).max())
    # a body that is unloaded comes back to nothing: errors are told of where it was
    begun = float(np.abs(u).max())
    done: list[Iteration] = []
    steps: list[float] = []
    _, most = controls.steps.value
    equation.forget_foretold()
    tangent = equation.linearised(u, factors)
    while True:
        given = equation.missing(tangent.u, factors)
        found = solver.correction(tangent, tangent.residual[None], given[None], controls.forcing)
        if controls.steady and not found.definite:
            raise NotConverged(f"iteration {len(done) + 1}: got a state that isn't stable")
        du = found.du[0]
        equation.advance(tangent.u, du, controls.steps is Steps.FORETOLD)
        u = tangent.u + du
        step, size = float(np.abs(du).max()), max(float(np.abs(u).max()), begun)
        if not size <= _LOST * extent:
            raise NotConverged(
                f"iteration {len(done) + 1}: got displacements of {size:.3g}; expected less than "
                f"{_LOST:.0f} times the body's extent, {extent:.3g}"
            )
        steps.append(step)
        error = error_left(steps, found.residual) / (size if size > 0.0 else 1.0)
        residual = relative_residual(equation, tangent)
        ended = error <= controls.tolerance or step <= _ROUNDING * size
        definite = found.definite
        if ended and definite:
            # what a long step foretold may be far from the stresses of a state that is led evenly,
            # and found in two steps; what the last one foretells is right as far as `u` is
            if controls.steps is Steps.FORETOLD and max(steps[-2:]) > _FORETELLS * size:
                tangent = equation.linearised(u, factors)
                definite = solver.definite_anew(tangent)
            else:
                definite = solver.definite(tangent)
        done.append(
            Iteration(step / max(size, 1e-300), residual, found.iterations, definite, error)
        )
        if controls.progress is not None:
            controls.progress(len(done), error)
        if ended:
            # a skew part may keep stable what the symmetric one alone wouldn't
            if controls.stable and not definite and tangent.skew is None:
                raise NotConverged("got an equilibrium that isn't stable; expected a stable one")
            return Equilibrium(u, tuple(done))
        if len(done) == most:
            raise NotConverged(
                f"got steps of {done[-1].step:.2g} of the displacement after {most} iterations; "
                f"expected an error of {controls.tolerance:.1e}"
            )
        if controls.steps is Steps.SEARCHED and np.abs(given).max() <= _ROUNDING * size:
            tangent = line_search(equation, tangent, du)
        else:
            tangent = equation.linearised(u, factors)


def error_left(steps: Sequence[float], residual: float) -> float:
    """What is left after the last of ``steps``, by how much shorter than the one before it was: of
    the next ones, which shrink at least as fast, and of the linear solution. One step, or one that
    doesn't shrink, tells nothing. The worse of two counts: steps may be small by turns."""
    shrink = max((after / before for before, after in pairwise(steps[-3:])), default=1.0)
    if not shrink < 0.5:
        return max(steps[:-3:-1])
    return steps[-1] * max(shrink / (1.0 - shrink), residual, _SHRINK)


def relative_residual(equation: Equation, tangent: Tangent) -> float:
    """The residual on free unknowns over the forces that act."""
    acting = np.abs(equation.external(tangent.u, tangent.factors)).max()
    size = float(max(acting, np.abs(tangent.residual).max()))
    free = float(np.abs(equation.unbalanced(tangent.residual)).max())
    return free / size if size > 0.0 else 0.0
