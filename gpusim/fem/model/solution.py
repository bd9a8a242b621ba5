"""What a static solve returns."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from gpusim.field_summary import field_summary

__all__ = ["Solution"]

Float = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Solution:
    """Displacements and how far they can be trusted; units are the model's.

    u : (N,3) float64, or (L,N,3) where the model has several load cases.
    converged : the estimate is at or below the tolerance asked for, in every load case.
    error_estimate : estimated relative error of u (see ``stopping_criterion`` and
    ``iterative_refinement``), the worst
        load case; it is computed from the true float64 residual, not from the recursive one.
    iterations : conjugate gradient iterations, refinements included; of the direct solver: solves.
    residuals : (iterations,L) preconditioned residual norms sqrt(r.z) over the first one; of the
        direct solver: corrections over the first one.
    reactions : like u, the force that the supports exert; zero on free degrees of freedom. Their
        relative error may be far larger than that of u where stiff parts are held by soft ones.
    strain_energy, external_work : (L,), u.Ku/2 and (forces . u + reactions . u)/2; they agree
        when the solve has converged.
    unknowns : free degrees of freedom. message : why the solve ended. warnings : what a reader
        should know (dangling nodes). timings : seconds per part. backend, real,
        method, element_classes, row_classes : how it was computed. reasons : the solver's choices
        and why, one a line.

    Examples
    --------
    >>> bar = gs.mesh.box(size=(1, 0.1, 0.1), divisions=(4, 1, 1))
    >>> fixed = np.isclose(bar.points[:, :1], 0.0).repeat(3, axis=1)
    >>> forces = gs.fem.face_force(bar, gs.mesh.select_faces(bar, name="x_max"), total=(1e4, 0, 0))
    >>> solution = gs.solve(gs.Model(bar, [gs.Isotropic(210e9, 0.3)], fixed=fixed, forces=forces))
    >>> solution.converged, solution.reactions.sum(axis=0).round(3) + 0.0
    (True, array([-10000.,      0.,      0.]))
    """

    u: Float
    converged: bool
    error_estimate: float
    iterations: int
    residuals: Float
    reactions: Float
    strain_energy: Float
    external_work: Float
    unknowns: int
    message: str
    warnings: tuple[str, ...]
    timings: dict[str, float]
    backend: str
    real: str
    method: str
    element_classes: int
    row_classes: int
    reasons: tuple[str, ...] = ()

    __repr__ = field_summary

    @property
    def energy_balance(self) -> float:
        """Greatest relative difference of strain energy and external work over load cases."""
        size = np.maximum(np.abs(self.strain_energy), np.abs(self.external_work))
        difference = np.abs(self.strain_energy - self.external_work)
        return float((difference / np.where(size > 0.0, size, 1.0)).max())
