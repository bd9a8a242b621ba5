"""Displacements and pressures together, for nearly incompressible materials."""

from __future__ import annotations

from dataclasses import replace

from gpusim.arrays.array_types import Float
from gpusim.errors import NotConverged
from gpusim.fem.assembly.assembly import Assembled
from gpusim.fem.assembly.system import System
from gpusim.fem.incompressibility.mixed_formulation import mixed_solver
from gpusim.fem.krylov.error_estimates import RoundingError
from gpusim.fem.krylov.outer_iteration import Outcome, Progress, each_case, iterate
from gpusim.fem.linear.solve_plan import Options
from gpusim.fem.model.model import Model

# of conjugate gradients with pressures; with more something is wrong
_MOST_ITERATIONS = 600


def solve_with_pressures(
    model: Model, assembled: Assembled, system: System, options: Options
) -> Outcome | None:
    """None where the bodies aren't fit for it, or it has failed; on the host."""
    clock = options.clock

    def one(part: System, start: Float | None, progress: Progress | None) -> Outcome:
        assert mixed is not None
        return iterate(
            part, mixed.loop(1), mixed.norm, start,
            rounding=RoundingError(mixed, options.tolerance), tolerance=options.tolerance,
            most=options.most or _MOST_ITERATIONS,
            progress=progress,
        )  # fmt: skip

    try:
        mixed = mixed_solver(model, options.formulation, assembled, system)
        clock.mark("preconditioner")
        if mixed is None:
            return None
        outcome = each_case(one, system, options.start, options.progress)
    except NotConverged:
        return None
    finally:
        clock.mark("iterations")
    if not outcome.converged and options.most is None:
        return None
    note = f"displacements and pressures: a nearly incompressible material; {mixed.probed} more"
    message = f"{outcome.message} ({note} iterations looked for soft modes)"
    return replace(outcome, message=message)
