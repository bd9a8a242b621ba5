"""Load steps: one equilibrium after another, with smaller steps where Newton's method fails."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from gpusim.arrays.array_types import Float
from gpusim.errors import NotConverged
from gpusim.fem.assembly.equation import Equation
from gpusim.fem.linear.tangent_solver import TangentSolver
from gpusim.fem.model.solution import Iteration, LoadStep
from gpusim.fem.procedures.newton import Controls, equilibrium

# share of a step below which no cut-back is tried
_LEAST_SHARE = 1.0 / 256.0


def load_steps(
    equation: Equation, solver: TangentSolver, targets: Float, controls: Controls
) -> Iterator[LoadStep]:
    """Equilibria at ``targets`` (K,L), each from the one before.

    A step in which Newton's method fails is halved until it is found, and doubled again after two
    that were. Raises NotConverged where steps become too small: what has been yielded stays right.
    """
    u = np.zeros_like(equation.model.mesh.points)
    begin = np.zeros(targets.shape[1])
    for number, target in enumerate(targets, start=1):
        done, share, substeps, in_a_row = 0.0, 1.0, 0, 0
        iterations: list[Iteration] = []
        while done < 1.0:
            share = min(share, 1.0 - done)
            factors = target if done + share >= 1.0 else begin + (done + share) * (target - begin)
            try:
                found = equilibrium(equation, solver, u, factors, controls)
            except NotConverged as error:
                in_a_row, share = 0, 0.5 * share
                if share < _LEAST_SHARE:
                    raise NotConverged(
                        f"load step {number} of {len(targets)}, at {done:.3g} of it: {error}"
                    ) from None
                continue
            u = found.u
            equation.commit(u)
            iterations += found.iterations
            done, substeps, in_a_row = done + share, substeps + 1, in_a_row + 1
            if in_a_row >= 2:
                share, in_a_row = 2.0 * share, 0
        internal = equation.internal(u)
        held = ~equation.free
        reactions = np.where(held, internal - equation.external(u, target), 0.0)
        yield LoadStep(target, u, reactions, tuple(iterations), found.error_estimate, substeps)
        begin = target
