"""Solvers of K + s M: factors, or one multigrid cycle, as the plan of a static solve says."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gpusim.arrays.array_types import Float
from gpusim.fem.assembly.equation_of_motion import EquationOfMotion
from gpusim.fem.assembly.system import finest_product
from gpusim.fem.krylov.cg import Preconditioner
from gpusim.fem.linear.direct_solver import DirectSolver
from gpusim.fem.linear.multigrid_solver import MultigridSolver
from gpusim.fem.linear.solve_plan import Options, SolvePlan, plan_solve


class ShiftedSolver:
    """(K + ``shift`` M)^-1 on rows x (L,3N) over the equation's scale: ``exact`` by factors, or
    nearly by one cycle. ``plan`` says why.

    Raises InputError where the method asked for doesn't fit, NotConverged for factors of a matrix
    that isn't positive definite.
    """

    def __init__(self, equation: EquationOfMotion, shift: float, options: Options) -> None:
        assembled, system = equation.shifted(shift)
        # something to solve for: a plan is made for loads
        system = replace(system, right=np.where(system.free, 1.0, 0.0)[None])
        options = replace(options, backend="numpy", device=None)
        model = equation.element_mass.model
        self.plan: SolvePlan = plan_solve(model, assembled, system, options)
        direct = self.plan.direct() if self.plan.attempts[0] == "direct" else None
        self.exact = direct is not None
        points = equation.points
        solver: DirectSolver | MultigridSolver = (
            MultigridSolver.prepare(self.plan, assembled, system, points)
            if direct is None
            else DirectSolver(direct)
        )
        self.preconditioner: Preconditioner = solver.preconditioner
        self._product, self._free = finest_product(assembled.rows, system), equation.unknown

    def apply(self, r: Float) -> Float:
        """(L,3N) of r (L,3N)."""
        return self.preconditioner.apply(r)

    def product(self, x: Float) -> Float:
        """K + ``shift`` M times x (L,3N), as an iteration takes it."""
        return np.where(self._free, self._product(x), 0.0)
