"""Linear statics: K u = f to a stated displacement error."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from gpusim.fem.assembly.assembly import Assembled, assemble
from gpusim.fem.assembly.reduced_system import reduced_system
from gpusim.fem.assembly.stiffness_rounding import extremes
from gpusim.fem.assembly.system import System, make_system
from gpusim.fem.krylov.outer_iteration import Outcome
from gpusim.fem.lattice.lattice import Lattice
from gpusim.fem.linear.linear_solver import solve_system
from gpusim.fem.linear.solve_plan import Clock, Options, SolvePlan, plan_solve
from gpusim.fem.model.constraints import touched
from gpusim.fem.model.dead_loads import with_dead_loads
from gpusim.fem.model.elimination import eliminate
from gpusim.fem.model.model import Model
from gpusim.fem.model.solution import Solution
from gpusim.fem.sparse.block_rows import BlockRows


def linear_static(model: Model, lattice: Lattice | None, options: Options) -> Solution:
    """The solution of a model that is supported, on the ``lattice`` of its cells if it has one."""
    clock = options.clock
    asked, model = model, with_dead_loads(model, options.formulation)
    elimination = eliminate(model)
    assembled = assemble(model, options.formulation, lattice)
    clock.mark("assembly")
    system = whole = _system(model, assembled, options.formulation)
    if elimination is not None:
        assembled, system = reduced_system(assembled, whole, elimination)
    plan = plan_solve(model, assembled, system, options)
    clock.mark("choice")
    outcome = solve_system(plan, model, assembled, system, options)
    if elimination is not None:
        u = elimination.displacements(outcome.u)
        outcome = replace(outcome, u=u, forces=whole.elements.product(u))
    return replace(_solution(model, system, assembled.rows, outcome, plan, clock), model=asked)


def _system(model: Model, assembled: Assembled, formulations: Mapping[str, str]) -> System:
    system = make_system(model, assembled)
    if "reduced" in formulations.values():
        # hourglass modes may be left: as soft as can be, and not felt by the loads
        system = replace(system, contrast=np.inf)
    return system


def _solution(
    model: Model,
    system: System,
    rows: BlockRows,
    outcome: Outcome,
    plan: SolvePlan,
    clock: Clock,
) -> Solution:
    u, message = outcome.u, outcome.message
    if not outcome.converged:
        cause = extremes(model)
        message += f"; the model has {cause}" if cause else ""
    forces = model.load_cases
    internal = outcome.forces
    if internal is None:
        internal = system.apply(u) * system.scale
    assert model.fixed is not None
    held = model.fixed | touched(model.constraints, model.fixed.shape)
    reactions = np.where(held, internal - forces, 0.0)
    single = model.forces is not None and model.forces.ndim == 2
    clock.mark("reactions")
    return Solution(
        u=u[0] if single else u,
        converged=outcome.converged,
        error_estimate=outcome.error_estimate,
        iterations=outcome.iterations,
        residuals=outcome.residuals,
        reactions=reactions[0] if single else reactions,
        strain_energy=0.5 * np.einsum("lni,lni->l", u, internal),
        external_work=0.5 * np.einsum("lni,lni->l", u, forces + reactions),
        unknowns=int(system.free.sum()),
        message=message,
        warnings=(),
        timings=clock.timings,
        method=outcome.method,
        backend=outcome.backend,
        real=outcome.real,
        element_classes=rows.element_classes,
        reasons=plan.lines,
        model=model,
    )
