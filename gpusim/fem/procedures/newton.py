"""Newton's method for one load step.

The geometric part of a tangent takes, from the second iteration on, the stresses that the linear
part of the last step foretold in place of those of the state that it ended in (mixed integration
points; Magisano, Leonetti & Garcea, IJNME 109 (2017) 1237): a slender body passes through states of
huge membrane forces on its way, whose tangents lead nowhere. Where that doesn't settle, plain
iterations begin anew. A line search isn't made: along the residual's work it stops at once.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from gpusim.arrays.array_types import Float
from gpusim.errors import NotConverged
from gpusim.fem.assembly.equation import Equation
from gpusim.fem.linear.tangent_solver import TangentSolver
from gpusim.fem.model.solution import Iteration

# iterations with foretold stresses, and without
_MOST_MIXED, _MOST_PLAIN = 12, 25
# of the motion: a step below it is rounding
_ROUNDING = 1e-13
# an iterate this many times as large as the body has left for good
_LOST = 1e3


@dataclass(frozen=True, eq=False)
class Equilibrium:
    """``u`` (N,3) in equilibrium, and how it was found."""

    u: Float
    iterations: tuple[Iteration, ...]

    @property
    def error_estimate(self) -> float:
        """Relative, of the greatest displacement, here or where the step began."""
        return self.iterations[-1].error_estimate


@dataclass(frozen=True)
class Controls:
    """``tolerance`` of the displacements in equilibrium, relative; ``forcing``: that of each linear
    solution; ``foretell``: first with foretold stresses; ``stable``: an equilibrium whose tangent
    is indefinite is none; ``steady``: nor is one on whose way a tangent was, which may be
    another than the load path leads to; ``progress`` is called with (iterations, estimated
    error)."""

    tolerance: float
    forcing: float
    foretell: bool
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
    causes = []
    for foretell, most in ((True, _MOST_MIXED), (False, _MOST_PLAIN)):
        if foretell and not controls.foretell:
            continue
        try:
            return _iterated(equation, solver, u, factors, controls, foretell, most)
        except NotConverged as error:
            causes.append(str(error))
            equation.restore(begun)
    raise NotConverged(causes[-1])


def _iterated(
    equation: Equation,
    solver: TangentSolver,
    u: Float,
    factors: Float,
    controls: Controls,
    foretell: bool,
    most: int,
) -> Equilibrium:
    extent = float(np.ptp(equation.model.mesh.points, axis=0).max())
    done: list[Iteration] = []
    equation.forget_foretold()
    # a body that is unloaded comes back to nothing: errors are told of where it was
    begun = float(np.abs(u).max())
    steps: list[float] = []
    while len(done) < most:
        tangent = equation.linearised(u, factors)
        given = equation.missing(u, factors)
        found = solver.correction(tangent, tangent.residual[None], given[None], controls.forcing)
        if controls.steady and not found.definite:
            raise NotConverged(f"iteration {len(done) + 1}: got a state that isn't stable")
        du = found.du[0]
        equation.advance(u, du, foretell)
        u = u + du
        step, size = float(np.abs(du).max()), max(float(np.abs(u).max()), begun)
        if not size <= _LOST * extent:
            raise NotConverged(
                f"iteration {len(done) + 1}: got displacements of {size:.3g}; expected less than "
                f"{_LOST:.0f} times the body's extent, {extent:.3g}"
            )
        steps.append(step)
        error = error_left(steps, controls.forcing) / (size if size > 0.0 else 1.0)
        residual = _relative(tangent.residual, equation, u, factors)
        done.append(
            Iteration(step / max(size, 1e-300), residual, found.iterations, found.definite, error)
        )
        if controls.progress is not None:
            controls.progress(len(done), error)
        if error <= controls.tolerance or step <= _ROUNDING * size:
            if controls.stable and not found.definite:
                raise NotConverged("got an equilibrium that isn't stable; expected a stable one")
            return Equilibrium(u, tuple(done))
    raise NotConverged(
        f"got steps of {done[-1].step:.2g} of the displacement after {most} iterations; "
        f"expected an error of {controls.tolerance:.1e}"
    )


def error_left(steps: Sequence[float], forcing: float) -> float:
    """What is left after the last of ``steps``, by how much shorter than the one before it was: of
    the next ones, which shrink at least as fast, and of the linear solution. One step, or one that
    that doesn't shrink, tells nothing. The worse of two counts: steps may be small by turns."""
    shrink = max((after / before for before, after in pairwise(steps[-3:])), default=1.0)
    if not shrink < 0.5:
        return max(steps[:-3:-1])
    return steps[-1] * max(shrink / (1.0 - shrink), forcing)


def _relative(residual: Float, equation: Equation, u: Float, factors: Float) -> float:
    """The residual on free unknowns over the forces that act."""
    acting = np.abs(equation.external(u, factors)).max()
    size = float(max(acting, np.abs(residual).max()))
    return float(np.abs(equation.unbalanced(residual)).max()) / size if size > 0.0 else 0.0
