"""Solvers of K + s M: factors, or one multigrid cycle, as the plan of a static solve says."""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property

import numpy as np

from gpusim.arrays.array_types import Float
from gpusim.arrays.unique import noise
from gpusim.errors import NotConverged
from gpusim.fem.assembly.equation_of_motion import EquationOfMotion
from gpusim.fem.assembly.stiffness_rounding import indefinite
from gpusim.fem.assembly.system import finest_product
from gpusim.fem.krylov.cg import NumpyCG, Preconditioner
from gpusim.fem.krylov.error_estimates import BELOW, smallest_ritz_value
from gpusim.fem.linear.direct_solver import DirectSolver
from gpusim.fem.linear.linear_solver import prepared
from gpusim.fem.linear.solve_plan import (
    Options,
    SolvePlan,
    multigrid_seconds,
    plan_solve,
)

# of conjugate gradients, after which their least Ritz value tells how good a cycle is
_STEPS = 10
# of a cycle's least eigenvalue, below which modes take hundreds of cycles (flat bodies have 0.002
# to 0.05, others 0.1 to 0.6); factors may then take this many times as long as a static solution
_WEAK, _PATIENCE = 0.05, 10.0
_POOR = "a multigrid cycle makes little of some motions"


class ShiftedSolver:
    """(K + ``shift`` M)^-1 on rows x (L,3N) over the equation's scale: ``exact`` by factors, or
    nearly by one cycle. ``plan`` says why.

    Raises InputError where the method asked for doesn't fit, NotConverged for factors of a matrix
    that isn't positive definite.
    """

    def __init__(self, equation: EquationOfMotion, shift: float, options: Options) -> None:
        self.equation, self._shift = equation, shift
        assembled, system = equation.shifted(shift)
        # something to solve for: a plan is made for loads
        system = replace(system, right=np.where(system.free, 1.0, 0.0)[None])
        options = replace(options, backend="numpy", device=None)
        model = equation.element_mass.model
        self.plan: SolvePlan = plan_solve(model, assembled, system, options)
        solver = prepared(self.plan, assembled, system, equation.points)
        self.preconditioner: Preconditioner = solver.preconditioner
        self.exact = isinstance(solver, DirectSolver)
        if isinstance(solver, DirectSolver):
            solver.invert()
        self._product = finest_product(assembled.rows, system)

    def apply(self, r: Float) -> Float:
        """(L,3N) of r (L,3N)."""
        return self.preconditioner.apply(r)

    def product(self, x: Float) -> Float:
        """K + ``shift`` M times x (L,3N), as an iteration takes it."""
        return np.where(self.equation.unknown, self._product(x), 0.0)

    def energy(self, x: Float) -> Float:
        """(K + shift M) x for x (L,3N)."""
        image = self.equation.stiffness(x)
        return image + self._shift * self.equation.inertia(x) if self._shift else image

    @property
    def may_be_exact(self) -> bool:
        """Whether there are factors to be had where a cycle doesn't do."""
        direct = None if self.exact else self.plan.direct()
        return direct is not None and direct.in_reach

    @property
    def poor(self) -> bool:
        """Whether a cycle makes so little of some motions that factors are the better way."""
        direct = self.plan.direct() if self.weakest < _WEAK else None
        patience = _PATIENCE * multigrid_seconds(int(self.equation.unknown.sum()))
        return direct is not None and direct.fits and direct.seconds <= patience

    @cached_property
    def weakest(self) -> float:
        """Least eigenvalue of what it makes of K + shift M, by some steps of conjugate gradients; 1
        of factors."""
        if self.exact:
            return 1.0
        unknown = self.equation.unknown
        loop = NumpyCG(self.energy, self.preconditioner)
        active = loop.begin(np.where(unknown, noise(len(unknown), 14), 0.0)[None]) > 0.0
        _, alpha, beta, curvature = loop.run(_STEPS, active)[:, 0].T
        if not (curvature > 0.0).all():
            raise indefinite("conjugate gradients")
        return BELOW * smallest_ritz_value(alpha, beta)


def definite_solver(equation: EquationOfMotion, shift: float, options: Options) -> ShiftedSolver:
    """Of K + ``shift`` M, good for eigenvalues: with a cycle these can't be found where a body is
    nearly incompressible, and hardly where it is flat. Raises NotConverged where its factors don't
    fit, either."""
    solver = ShiftedSolver(equation, shift, options)
    if solver.exact or options.method == "multigrid":
        return solver
    if not solver.plan.stiff_in_bulk:
        return with_factors(equation, shift, options, _POOR) if solver.poor else solver
    if not solver.may_be_exact:
        raise NotConverged(
            "modes: a nearly incompressible body; got factors that don't fit the memory; expected "
            "fewer unknowns, or a smaller Poisson's ratio: multigrid doesn't find its modes"
        )
    return with_factors(equation, shift, options, "a nearly incompressible body")


def with_factors(
    equation: EquationOfMotion, shift: float, options: Options, why: str
) -> ShiftedSolver:
    """Of K + ``shift`` M, exactly; ``why`` not nearly."""
    solver = ShiftedSolver(equation, shift, replace(options, method="direct"))
    direct = solver.plan.direct()
    assert direct is not None
    reasons = {**solver.plan.reasons, "solver": f"direct: {why}; {direct.description}"}
    solver.plan = replace(solver.plan, reasons=reasons)
    return solver
