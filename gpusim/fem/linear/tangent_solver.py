"""Tangents solved in Newton's method: the solver of the first one is updated for all others."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse import csr_matrix

from gpusim.arrays.array_types import Float
from gpusim.arrays.unique import noise
from gpusim.errors import NotConverged
from gpusim.fem.assembly.assembly import Assembled
from gpusim.fem.assembly.equation import Equation, Tangent
from gpusim.fem.assembly.reduced_system import reduced_system
from gpusim.fem.assembly.system import System, finest_product, scaled_system
from gpusim.fem.elements.element_response import Want
from gpusim.fem.krylov.gmres import gmres
from gpusim.fem.krylov.truncated_cg import truncated_cg
from gpusim.fem.linear.linear_solver import LinearSolver, prepared
from gpusim.fem.linear.solve_plan import Options, SolvePlan, plan_solve

Apply = Callable[[Float], Float]

# share of the motion below which a step leaves factors and levels as they are
_NEAR = 0.01
# share of random forces down to which negative directions are looked for: one column of thirty is
# seen to buckle from 1.002 of its critical load on, with the others at 0.7 of it
_LOOK = 0.1


@dataclass(frozen=True, eq=False)
class Correction:
    """``du`` (L,N,3), prescribed displacements included, after so many ``iterations``, with what
    the residual has fallen to, relative; ``definite``: the tangent's symmetric part was positive
    definite."""

    du: Float
    iterations: int
    residual: float
    definite: bool


class TangentSolver:
    """Of one ``equation``; which solver it is the first tangent decides, as in linear statics.

    Factors or levels are made anew after steps that are more than a hundredth of the motion. Where
    a tangent is indefinite the preconditioner is made of its material part, which isn't. Then, and
    where it has a skew part, minimum residuals take over from conjugate gradients.
    """

    def __init__(self, equation: Equation, options: Options) -> None:
        self._equation, self._options = equation, replace(options, backend="numpy")
        self._solver: LinearSolver | None = None
        # where the nodes were when the solver took its matrix; None: it was none that fits
        self._taken: Float | None = None
        # the tangent that was found to be indefinite, whose material part the solver has
        self._indefinite: Tangent | None = None
        self.plan: SolvePlan | None = None

    def correction(
        self, tangent: Tangent, forces: Float, given: Float, forcing: float
    ) -> Correction:
        """Solve K du = ``forces`` (L,N,3) until the residual has fallen to ``forcing``, with
        ``given`` (L,N,3) displacements at the supports.

        Raises NotConverged where that can't be had.
        """
        assembled, system = self._system(tangent, forces, given)
        if not system.right.any():
            return self._whole(np.zeros_like(system.right), 0, 0.0, system, True)
        right = system.right.reshape(len(system.right), -1)
        apply, found = _product(assembled, system, tangent.skew), None
        if self._indefinite is not tangent and not self._near(tangent.u):
            self._take(tangent, assembled, system)
        definite = self._taken is not None
        if definite and tangent.skew is None:
            found = truncated_cg(apply, self._prepared.preconditioner, right, forcing)
            definite = found is not None
        if found is None:
            if not definite:
                self._take_material_part(tangent, forces, given)
            precondition = self._prepared.preconditioner.apply
            each = [gmres(apply, precondition, one[None], forcing) for one in right]
            x, iterations = np.concatenate([x for x, _ in each]), sum(count for _, count in each)
            found = x, iterations, forcing
        if definite and found[1] > self._prepared.update_cost:
            self._taken = None  # that wasn't worth it: the next tangent gets its own
        return self._whole(*found, system, definite)

    def definite(self, tangent: Tangent) -> bool:
        """Whether the symmetric part of a tangent that has been solved is positive definite.

        Residuals may hardly hold the mode in which it isn't, as those of a straight column. Here
        conjugate gradients begin with forces that hold every mode, and it is the softest ones that
        they meet first.
        """
        if self._solver is None:
            # nothing has moved
            return True
        still = np.zeros((1, *tangent.u.shape))
        assembled, system = self._system(tangent, still, still)
        every = np.where(system.free.ravel(), noise(still.size, 13), 0.0)[None]
        near = self._solver.preconditioner
        return truncated_cg(_product(assembled, system), near, every, _LOOK) is not None

    def definite_anew(self, tangent: Tangent) -> bool:
        """The same of a tangent that hasn't been solved, with factors or levels of its own."""
        if self._solver is None:
            return True
        still = np.zeros((1, *tangent.u.shape))
        self._take(tangent, *self._system(tangent, still, still))
        return self._taken is not None and self.definite(tangent)

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

    def _take(self, tangent: Tangent, assembled: Assembled, system: System) -> None:
        """Factors or levels of a matrix, unless it turns out to be indefinite."""
        self._taken, self._indefinite = None, None
        with suppress(NotConverged):
            self._update(tangent, assembled, system)
            self._taken = tangent.u

    def _take_material_part(self, tangent: Tangent, forces: Float, given: Float) -> None:
        if self._indefinite is not tangent:
            material = self._equation.linearised(tangent.u, tangent.factors, Want.MATERIAL)
            self._update(tangent, *self._system(material, forces, given))
            self._taken, self._indefinite = None, tangent

    @property
    def _prepared(self) -> LinearSolver:
        assert self._solver is not None
        return self._solver

    def _near(self, u: Float) -> bool:
        """Whether displacements have changed by less than a hundredth of themselves."""
        taken = self._taken
        return taken is not None and bool(np.abs(u - taken).max() <= _NEAR * np.abs(u).max())

    def _update(self, tangent: Tangent, assembled: Assembled, system: System) -> None:
        model = self._equation.model
        points = model.mesh.points + tangent.u
        if self._solver is not None:
            self._solver.update(assembled, system, points)
            return
        self.plan = plan_solve(model, assembled, system, self._options)
        self._solver = prepared(self.plan, assembled, system, points)

    def _whole(
        self, x: Float, iterations: int, residual: float, system: System, definite: bool
    ) -> Correction:
        """In the model's units, with supports and what constraints gave up."""
        size = (system.load_scale / system.scale)[:, None, None]
        du = np.where(system.free, x.reshape(system.right.shape) * size, system.prescribed)
        elimination = self._equation.elimination
        whole = du if elimination is None else elimination.displacements(du)
        return Correction(whole, iterations, residual, definite)


def _product(assembled: Assembled, system: System, skew: csr_matrix | None = None) -> Apply:
    """x (L,n) -> K x on the free unknowns, K with a ``skew`` part if there is one."""
    product, free = finest_product(assembled.rows, system), system.free.ravel()
    if skew is None:
        return lambda x: np.where(free, product(x), 0.0)
    # vectors are rows; minus: the transpose of a skew matrix
    return lambda x: np.where(free, product(x) - x @ skew / system.scale, 0.0)
