"""Direct solvers: factors of K, and displacements refined with float64 residuals."""

from __future__ import annotations

from dataclasses import replace

from gpusim.arrays.array_types import Float
from gpusim.fem.assembly.assembly import Assembled
from gpusim.fem.assembly.system import System
from gpusim.fem.direct_solvers.iterative_refinement import refine
from gpusim.fem.krylov.cg import Preconditioner
from gpusim.fem.krylov.outer_iteration import Outcome
from gpusim.fem.linear.solve_plan import Direct, Options


class DirectSolver(Preconditioner):
    """Factors that ``direct`` builds; ``note`` follows its description in messages."""

    update_cost = 4
    """Iterations with factors that take as long as new ones."""

    def __init__(self, direct: Direct, note: str = "") -> None:
        super().__init__()
        self._direct, self._note = direct, note
        self._factor = direct.build(direct.rows)

    @property
    def preconditioner(self) -> Preconditioner:
        """The factors themselves."""
        return self

    def apply(self, r: Float) -> Float:
        """K^-1 r for (L,3N) r; zero on fixed unknowns."""
        return self._factor.apply(r)

    def invert(self) -> None:
        """Make hundreds of solutions cheaper, one after the other."""
        self._factor.invert()

    def solve(self, system: System, options: Options) -> Outcome:
        """Displacements under the loads of the system, to the error that is asked for."""
        outcome = refine(
            system, self._factor, tolerance=options.tolerance, progress=options.progress
        )
        options.clock.mark("iterations")
        message = f"{outcome.message} ({self._direct.description}{self._note})"
        return replace(outcome, message=message, method="direct")

    def update(self, assembled: Assembled, system: System, points: Float) -> None:
        """Factorise another matrix of the same pattern, in the same order."""
        self._factor = self._direct.build(assembled.rows)
