"""Conjugate gradients preconditioned by multigrid, on the host."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np

from gpusim.arrays.array_types import Float
from gpusim.arrays.unique import noise
from gpusim.fem.assembly.assembly import Assembled
from gpusim.fem.assembly.system import System
from gpusim.fem.krylov.cg import NumpyCG, Preconditioner
from gpusim.fem.krylov.error_estimates import Norm, RoundingError
from gpusim.fem.krylov.multigrid_preconditioner import Multigrid
from gpusim.fem.krylov.outer_iteration import Outcome, Progress, each_case, iterate
from gpusim.fem.linear.solve_plan import Options, SolvePlan
from gpusim.fem.multigrid.hierarchy import build_hierarchy

_MOST_ITERATIONS = 1000
# of inverse iteration
_INVERSE_STEPS = 8


@dataclass(eq=False)
class MultigridSolver:
    """``multigrid`` of a matrix whose free unknowns and scale are the ``system``'s, prepared as the
    ``plan`` says."""

    plan: SolvePlan
    system: System
    multigrid: Multigrid

    update_cost: ClassVar[int] = 20
    """Iterations with levels that take as long as new ones."""

    @classmethod
    def prepare(
        cls, plan: SolvePlan, assembled: Assembled, system: System, points: Float
    ) -> MultigridSolver:
        """Levels for the nodes at ``points`` (N,3)."""
        hierarchy = build_hierarchy(
            assembled,
            system,
            points,
            stiff_in_bulk=plan.stiff_in_bulk,
            inverted=plan.on_device,
            uneven_stiffness=plan.uneven_stiffness,
        )
        return cls(plan, system, Multigrid(hierarchy))

    @property
    def preconditioner(self) -> Preconditioner:
        """One cycle."""
        return self.multigrid

    def update(self, assembled: Assembled, system: System, points: Float) -> None:
        """Levels of another matrix."""
        other = self.prepare(self.plan, assembled, system, points)
        self.system, self.multigrid = system, other.multigrid

    def solve(self, system: System, options: Options) -> Outcome:
        """Displacements under the loads of the system, to the error that is asked for."""
        lowest = self.lowest_eigenvalue()

        def one(part: System, start: Float | None, progress: Progress | None) -> Outcome:
            loop = NumpyCG(self.multigrid.product, self.multigrid)
            case = replace(options, start=start, progress=progress)
            return self.iterated(part, loop, lowest, case)

        outcome = each_case(one, system, options.start, options.progress)
        options.clock.mark("iterations")
        return outcome

    def iterated(self, system: System, loop: Any, lowest: float, options: Options) -> Outcome:
        """The outer loop around conjugate gradients, wherever these run."""
        return iterate(
            system,
            loop,
            Norm(lowest),
            options.start,
            rounding=RoundingError(self.multigrid, options.tolerance),
            tolerance=options.tolerance,
            most=options.most if options.most is not None else _MOST_ITERATIONS,
            progress=options.progress,
        )

    def lowest_eigenvalue(self) -> float:
        """About the least one of K: the coarsest level's; where stiffnesses are uneven also by
        inverse iteration with the preconditioner, as soft islands between stiff ones are too small
        for the coarsest level."""
        lowest = self.multigrid.lowest
        if not self.plan.uneven_stiffness:
            return lowest
        free = self.system.free
        x = np.where(free.ravel(), noise(free.size, 12), 0.0)[None]
        for _ in range(_INVERSE_STEPS):
            x = self.multigrid.apply(x)
            x /= np.linalg.norm(x)
        return min(lowest, float(x[0] @ self.multigrid.product(x)[0] / (x[0] @ x[0])))
