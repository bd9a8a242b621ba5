"""Linear solvers, and a system solved by them, as a plan says."""

from __future__ import annotations

import numpy as np

from gpusim.arrays.array_types import Float
from gpusim.errors import NotConverged
from gpusim.fem.assembly.assembly import Assembled
from gpusim.fem.assembly.system import System
from gpusim.fem.krylov.outer_iteration import Outcome
from gpusim.fem.linear.device_solver import solve_on_device
from gpusim.fem.linear.direct_solver import DirectSolver
from gpusim.fem.linear.multigrid_solver import MultigridSolver
from gpusim.fem.linear.pressure_solver import solve_with_pressures
from gpusim.fem.linear.solve_plan import Direct, Options, SolvePlan
from gpusim.fem.model.model import Model

LinearSolver = DirectSolver | MultigridSolver
"""Of K on its free unknowns, over the system's ``scale``: prepared once, used often; ``update``
takes another matrix of the same pattern, whose nodes are at ``points`` (N,3) by then."""


def prepared(plan: SolvePlan, assembled: Assembled, system: System, points: Float) -> LinearSolver:
    """The one that the plan tries first, for nodes at ``points`` (N,3)."""
    direct = plan.direct() if plan.attempts[0] == "direct" else None
    if direct is None:
        return MultigridSolver.prepare(plan, assembled, system, points)
    return DirectSolver(direct)


def solve_system(
    plan: SolvePlan, model: Model, assembled: Assembled, system: System, options: Options
) -> Outcome:
    """What the plan says, in its order, until an attempt has converged."""
    if plan.attempts == ("none",):
        u = np.broadcast_to(system.prescribed, system.right.shape).copy()
        none = np.zeros((0, len(system.right)))
        return Outcome(
            u, True, 0.0, 0, none, "no load: exact", None, "none", options.backend, "none"
        )
    if plan.attempts == ("direct",):
        return _factorised(plan.direct(), system, options, "")

    def instead(reason: str) -> Outcome | None:
        direct = plan.direct() if "direct" in plan.attempts else None
        if direct is None or not direct.in_reach:
            return None
        return _factorised(direct, system, options, f"; multigrid had failed: {reason}")

    result = None
    try:
        if "pressures" in plan.attempts:
            result = solve_with_pressures(model, assembled, system, options)
        if result is None and plan.on_device:
            result = solve_on_device(plan, model, assembled, system, options)
        elif result is None:
            solver = MultigridSolver.prepare(plan, assembled, system, model.mesh.points)
            options.clock.mark("preconditioner")
            result = solver.solve(system, options)
    except NotConverged as error:
        other = instead(str(error))
        if other is None:
            raise
        return other
    if result.converged:
        return result
    return instead(result.message) or result


def _factorised(direct: Direct | None, system: System, options: Options, note: str) -> Outcome:
    assert direct is not None
    solver = DirectSolver(direct, note)
    options.clock.mark("factorisation")
    return solver.solve(system, options)
