"""Computations: how an analysis went, which its result tells whatever it is."""

from __future__ import annotations

from dataclasses import dataclass

from gpusim.fem.model.model import Model
from gpusim.field_summary import field_summary


@dataclass(frozen=True, eq=False, kw_only=True)
class Computation:
    """What all results tell beside what was found.

    converged : the estimate is at or below the tolerance asked for, everywhere.
    message : how it was computed, or why it ended. warnings : what a reader should know.
    unknowns : free degrees of freedom, less those that constraints give up.
    method : how it was computed. reasons : the solver's choices and why, one a line.
    timings : seconds per part. model : what was solved.

    Examples
    --------
    >>> bar = gs.mesh.box(size=(1, 0.1, 0.1), divisions=(8, 1, 1))
    >>> found = gs.modes(gs.Model(bar, gs.Isotropic(210e9, 0.3, density=7850.0)), count=8)
    >>> found.converged, found.method, found.unknowns, sorted(found.timings)
    (True, 'direct', 108, ['assembly', 'iteration', 'solver'])
    """

    converged: bool = True
    message: str = "converged"
    warnings: tuple[str, ...] = ()
    unknowns: int
    method: str
    reasons: tuple[str, ...] = ()
    timings: dict[str, float]
    model: Model

    __repr__ = field_summary
