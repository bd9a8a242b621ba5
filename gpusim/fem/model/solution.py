"""The solution of a model: displacements, and how far they can be trusted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from gpusim.arrays.array_types import Float
from gpusim.display import notebook_html, plotted
from gpusim.fem.model.computation import Computation
from gpusim.field_summary import field_summary

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from gpusim.fem.recovery.stress import Stress


@dataclass(frozen=True)
class Iteration:
    """One iteration: the greatest displacement of its ``step`` over the whole one, the ``residual``
    over the forces that act, what the linear solver took, whether the tangent was ``definite``, and
    the error that is left (estimated, relative to the greatest displacement)."""

    step: float
    residual: float
    solver_iterations: int
    definite: bool
    error_estimate: float


@dataclass(frozen=True, eq=False)
class LoadStep:
    """Equilibrium at ``factors`` (L,) of the load cases.

    ``u`` (N,3); ``reactions`` (N,3) forces of the supports; ``iterations`` of Newton's method,
    those of the ``substeps`` on the way included; ``error_estimate`` relative, of the greatest
    displacement; ``wanted``: asked for, and not a point on the way past a limit point. ``stress``:
    of steps that are wanted, Cauchy stress, logarithmic strain and more (`gpusim.fem.Stress`).
    ``external_work``: of loads and supports along the path, by the trapezoidal rule.

    Examples
    --------
    >>> bar = gs.mesh.box(size=(1, 0.1, 0.1), divisions=(4, 1, 1))
    >>> fixed = np.isclose(bar.points[:, :1], 0.0).repeat(3, axis=1)
    >>> pull = gs.fem.traction(bar, gs.mesh.select_faces(bar, name="x_max"), (2e9, 0, 0))
    >>> model = gs.Model(bar, gs.Isotropic(200e9, 0.0), fixed, pull)
    >>> half, whole = gs.fem.solve(model, geometry="nonlinear", factors=[0.5, 1.0]).steps
    >>> f"{1e3 * half.u[:, 0].max():.3f} {1e3 * whole.u[:, 0].max():.3f}"
    '5.000 10.000'
    >>> bool(np.allclose(whole.stress.nodal_strain[:, 0], np.log(1.01)))
    True
    """

    factors: Float
    u: Float
    reactions: Float
    iterations: tuple[Iteration, ...]
    error_estimate: float
    substeps: int
    wanted: bool
    stress: Stress | None = None
    external_work: float = 0.0
    __repr__ = field_summary

    @property
    def strain_energy(self) -> float:
        """What the laws store; NaN where a law doesn't tell it, and without stress."""
        return np.nan if self.stress is None else self.stress.strain_energy


def load_path_results(steps: Sequence[LoadStep], last: LoadStep) -> dict[str, Any]:
    """What a `Solution` has of load ``steps`` that end with, or after, the ``last`` one."""
    every = [one for step in steps for one in step.iterations]
    return {
        "u": last.u,
        "reactions": last.reactions,
        "error_estimate": max((step.error_estimate for step in steps), default=1.0),
        "iterations": sum(one.solver_iterations for one in every),
        "residuals": np.array([[one.residual] for one in last.iterations]),
        "strain_energy": np.array([last.strain_energy]),
        "external_work": np.array([last.external_work]),
        "steps": tuple(steps),
    }


@dataclass(frozen=True, eq=False, repr=False)
class Solution(Computation):
    """Displacements and how far they can be trusted; units are the model's.

    u : (N,3) float64, or (L,N,3) where the model has several load cases.
    error_estimate : estimated relative error of u (see ``krylov.error_estimates`` and
    ``iterative_refinement``), the worst
        load case; it is computed from the true float64 residual, not from the recursive one.
    iterations : conjugate gradient iterations, refinements included; of the direct solver: solves.
    residuals : (iterations,L) preconditioned residual norms sqrt(r.z) over the first one; of the
        direct solver: corrections over the first one.
    reactions : like u, the force that supports and constraints exert; zero on other degrees of
        freedom. Their relative error may be far larger than that of u where stiff parts are held by
        soft ones.
    strain_energy, external_work : (L,), u.Ku/2 and (forces . u + reactions . u)/2; they agree
        when the solve has converged. Of a nonlinear analysis the energy that its laws store in the
        last step (NaN where a law doesn't tell it), and the work of loads and supports up to there
        by the trapezoidal rule: of one step it may be off by half, of ten by a percent. What
        they differ by is that, what has been dissipated, and what heat has done.
    backend, real, element_classes : how it was computed. converged, message, warnings, unknowns,
        method, reasons, timings, model : as all results have them.
    steps : of a nonlinear analysis, in their order; u and reactions are those of the last one.

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
    error_estimate: float
    iterations: int
    residuals: Float
    reactions: Float
    strain_energy: Float
    external_work: Float
    backend: str
    real: str
    element_classes: int
    steps: tuple[LoadStep, ...] = ()

    def _repr_html_(self) -> str | None:
        return notebook_html("solution", self)

    def plot(
        self,
        ax: Axes | None = None,
        *,
        field: str = "von_mises",
        case: int = 0,
        scale: float | None = None,
        unit: str = "m",
        **style: Any,
    ) -> Axes:
        """Draw the deformed skin in the colours of a field, in matplotlib's 3D axes.

        ``field``: "von_mises", "displacement" (its length), or "x", "y", "z" (its components).
        ``case``: the load case. ``scale``: how many times the displacements are drawn; a round
        number unless given. ``unit``: what labels call the model's unit of length ("m": stress in
        Pa, "mm": in MPa). ``style``: ``cmap``, and what ``Poly3DCollection`` takes. Returns the
        axes. Raises InputError for what there isn't.
        """
        return plotted(
            "solution", self, ax, field=field, case=case, scale=scale, unit=unit, **style
        )

    @property
    def energy_balance(self) -> float:
        """Greatest relative difference of strain energy and external work over load cases."""
        size = np.maximum(np.abs(self.strain_energy), np.abs(self.external_work))
        difference = np.abs(self.strain_energy - self.external_work)
        return float((difference / np.where(size > 0.0, size, 1.0)).max())
