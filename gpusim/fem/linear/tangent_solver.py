"""Tangents solved in Newton's method: the solver of the first one is updated for all others."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from gpusim.arrays.array_types import Float
from gpusim.errors import NotConverged
from gpusim.fem.assembly.assembly import Assembled
from gpusim.fem.assembly.equation import Equation, Tangent
from gpusim.fem.assembly.reduced_system import reduced_system
from gpusim.fem.assembly.system import System, finest_product, scaled_system
from gpusim.fem.elements.element_response import Want
from gpusim.fem.krylov.minimum_residual import minimum_residual
from gpusim.fem.linear.direct_solver import DirectSolver
from gpusim.fem.linear.multigrid_solver import MultigridSolver
from gpusim.fem.linear.solve_plan import Options, SolvePlan, plan_solve

# share of the motion below which a step leaves factors and levels as they are
_NEAR = 0.01


@dataclass(frozen=True, eq=False)
class Correction:
    """``du`` (L,N,3), prescribed displacements included, after so many ``iterations``;
    ``definite``: the tangent was positive definite."""

    du: Float
    iterations: int
    definite: bool


class TangentSolver:
    """Of one ``equation``; which solver it is the first tangent decides, as in linear statics.

    Factors or levels are made anew after steps that are more than a hundredth of the motion. Where
    a tangent is indefinite the preconditioner is made of its material part, which isn't, and
    minimum residuals take over from conjugate gradients (Paige & Saunders, SIAM J. Numer. Anal. 12
    (1975) 617).
    """

    def __init__(self, equation: Equation, options: Options) -> None:
        self._equation, self._options = equation, replace(options, backend="numpy")
        self._solver: DirectSolver | MultigridSolver | None = None
        # where the nodes were when the solver took its matrix; None: it was another one's
        self._taken: Float | None = None
        # the tangent that was found to be indefinite, and its material part
        self._indefinite: Tangent | None = None
        self._definite: System
        self.plan: SolvePlan | None = None

    def correction(
        self, tangent: Tangent, forces: Float, given: Float, forcing: float
    ) -> Correction:
        """Solve K du = ``forces`` (L,N,3) to the relative error ``forcing``, with ``given`` (L,N,3)
        displacements at the supports.

        Raises NotConverged where that can't be had.
        """
        points = self._equation.model.mesh.points + tangent.u
        assembled, system = self._system(tangent, forces, given)
        if not system.right.any():
            return self._whole(system.prescribed, 0, True)
        options = replace(self._options, tolerance=forcing, start=None, progress=None)
        outcome = None
        if self._taken is not None and _near(tangent.u, self._taken):
            assert self._solver is not None
            self._solver.follow(assembled, system)
            outcome = _tried(self._solver, system, options)
        if outcome is None and self._indefinite is not tangent:
            # until it has the new matrix it has none that fits
            self._taken = None
            try:
                solver = self._updated(assembled, system, points)
                self._taken = tangent.u
                outcome = _tried(solver, system, options)
            except NotConverged:
                outcome = None
        if outcome is None:
            return self._by_minimum_residual(tangent, (forces, given), forcing)
        return self._whole(*outcome, True)

    def _system(self, tangent: Tangent, forces: Float, given: Float) -> tuple[Assembled, System]:
        """What is solved, less what constraints give up."""
        equation, elimination = self._equation, self._equation.elimination
        points = equation.model.mesh.points + tangent.u
        supports = np.where(equation.free, 0.0, given)
        system = scaled_system(tangent.assembled, points, equation.free, forces, supports)
        if elimination is None:
            return tangent.assembled, system
        offset = np.where(elimination.given_up, given[0], 0.0)
        return reduced_system(tangent.assembled, system, replace(elimination, offset=offset))

    def _whole(self, u: Float, iterations: int, definite: bool) -> Correction:
        """With the displacements that constraints gave up."""
        elimination = self._equation.elimination
        du = np.broadcast_to(u, (len(u), *self._equation.free.shape))
        return Correction(
            du if elimination is None else elimination.displacements(du), iterations, definite
        )

    def _updated(
        self, assembled: Assembled, system: System, points: Float
    ) -> DirectSolver | MultigridSolver:
        if self._solver is None:
            model = self._equation.model
            self.plan = plan_solve(model, assembled, system, self._options)
            direct = self.plan.direct() if self.plan.attempts[0] == "direct" else None
            if direct is not None:
                self._solver = DirectSolver(direct)
            else:
                self._solver = MultigridSolver.prepare(self.plan, assembled, system, points)
        else:
            self._solver.update(assembled, system, points)
        return self._solver

    def _by_minimum_residual(
        self, tangent: Tangent, right: tuple[Float, Float], forcing: float
    ) -> Correction:
        assembled, system = self._system(tangent, *right)
        if self._indefinite is not tangent:
            points = self._equation.model.mesh.points + tangent.u
            material = self._equation.linearised(tangent.u, tangent.factors, Want.MATERIAL)
            definite, self._definite = self._system(material, *right)
            self._updated(definite, self._definite, points)
            self._taken, self._indefinite = None, tangent
        solver, unit = self._solver, self._definite.scale / system.scale
        assert solver is not None
        product, free = finest_product(assembled.rows, system), system.free.ravel()
        steps, iterations = [], 0
        for force in system.right.reshape(len(system.right), -1):
            step, count = minimum_residual(
                lambda v: np.where(free, product(v[None])[0], 0.0),
                lambda r: solver.apply(r[None])[0] / unit,
                force,
                forcing,
            )
            steps.append(step)
            iterations += count
        size = (system.load_scale / system.scale)[:, None, None]
        du = np.stack(steps).reshape(system.right.shape) * size
        return self._whole(np.where(system.free, du, system.prescribed), iterations, False)


def _near(u: Float, taken: Float) -> bool:
    """Whether displacements have changed by less than a hundredth of themselves."""
    return float(np.abs(u - taken).max()) <= _NEAR * float(np.abs(u).max())


def _tried(
    solver: DirectSolver | MultigridSolver, system: System, options: Options
) -> tuple[Float, int] | None:
    """The solution and its iterations, or None where it isn't found."""
    if isinstance(solver, DirectSolver):
        return solver.step(system, options)
    try:
        outcome = solver.solve(system, options)
    except NotConverged:
        return None
    return (outcome.u, outcome.iterations) if outcome.converged else None
