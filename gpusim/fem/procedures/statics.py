"""Statics: displacements of a model, by linear theory or at large displacements.

Long or small bodies are factorised on the host (``gpusim.fem.direct_solvers``) and refined with
float64 residuals. Everything else takes conjugate gradients in float64 (double-single where the
device has no 64-bit floats), preconditioned by multigrid, until the residual f - K u, formed in
float64 on the host, is small enough. Load cases share the set-up; a device iterates them at once,
the host side by side (on Linux, in copies of the process: ``gpusim.parallel.processes``). Large
displacements are found step by step on the host (``nonlinear_static``).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Annotated

import numpy as np
import numpy.typing as npt

from gpusim.arrays.array_types import Float
from gpusim.fem.assembly.assembly import model_lattice
from gpusim.fem.assembly.node_graph import Numbering
from gpusim.fem.linear.solve_plan import METHODS, Clock, Options
from gpusim.fem.materials.law import Law
from gpusim.fem.model.model import Model, resolve_formulation
from gpusim.fem.model.solution import Solution
from gpusim.fem.model.supports import check_supports
from gpusim.fem.procedures.linear_static import linear_static
from gpusim.gpu import Device
from gpusim.parallel.blas_threads import one_blas_thread
from gpusim.parallel.machine import keep_freed_memory
from gpusim.validation import Count, Rule, as_float64, checked, finite_numbers, one_of, require

Tolerance = Annotated[float, Rule("a number in (0, 1)", lambda value: 0.0 < value < 1.0)]


@checked
def solve(
    model: Model,
    device: Device | None = None,
    *,
    tolerance: Tolerance = 1e-6,
    geometry: Annotated[str, one_of("linear", "nonlinear")] = "linear",
    factors: npt.ArrayLike | None = None,
    formulation: str | Mapping[str, str] | None = None,
    backend: Annotated[str, one_of("auto", "gpu", "numpy")] = "auto",
    method: Annotated[str, one_of(*METHODS)] = "auto",
    max_iterations: Count | None = None,
    start: npt.ArrayLike | None = None,
    progress: Callable[[int, float], None] | None = None,
) -> Solution:
    """Displacements of a static model, by linear theory or at large displacements.

    By linear theory K u = f; which solver is cheaper is estimated. At large displacements each load
    step is an equilibrium found by Newton's method; steps that fail are halved, limit points passed
    by arc length. `Isotropic` and `Orthotropic` cells strain by 2 % at most, others by any amount.

    Parameters
    ----------
    model : see ``Model``.
    device : None takes the process-wide one (none at all for ``backend="numpy"``).
    tolerance : relative displacement error to reach (`gpusim.fem.krylov.error_estimates`,
        `gpusim.fem.direct_solvers.iterative_refinement`); of the greatest one in an equilibrium.
    geometry : "linear", or "nonlinear": equilibrium of the deformed body.
    factors : load factors of the steps of a nonlinear analysis, (K,); (K,L) for a model with L load
        cases: how they add up in each step. None: one step with everything.
    formulation : integration or enrichment by name, for all cells or per type; see
        ``gpusim.fem.elements.element``. The default is "incompatible" for hex8, "full" otherwise.
    backend : where multigrid iterates: "gpu", "numpy" (the twins, on all processors of the host),
        or "auto": "gpu" where ``device`` is given or the adapter isn't a software one. Large
        displacements are always found on the host.
    method : "direct", "multigrid" (smoothed aggregation below geometric levels), or "auto": the
        cheaper of the two; direct also where multigrid doesn't converge.
    max_iterations : of conjugate gradients by linear theory; None: 1000.
    start : (N,3) or (L,N,3) to begin from, by linear theory; a direct solver needs none.
    progress : called with (iterations, estimated relative error), of load cases here or equilibria.

    Raises
    ------
    InputError
        A wrong argument; supports and constraints that leave a rigid-body motion free (named).
    NotConverged
        Values that aren't finite, a matrix that rounding made indefinite, or no equilibrium at the
        first load step. One that is missing later ends the analysis: the solution has the steps
        before it, ``converged`` is False and ``message`` says why.
        Running out of iterations or stagnating isn't raised: ``Solution.converged`` tells it.
    OutOfDeviceMemory
        The device can't hold the model; refused before anything is allocated there.

    Examples
    --------
    >>> bar = gs.mesh.box(size=(1, 0.1, 0.1), divisions=(4, 1, 1))
    >>> fixed = np.isclose(bar.points[:, :1], 0.0).repeat(3, axis=1)
    >>> pull = gs.fem.traction(bar, gs.mesh.select_faces(bar, name="x_max"), (1e6, 0, 0))
    >>> model = gs.Model(bar, gs.Isotropic(210e9, 0.0), fixed, pull)
    >>> solution = gs.fem.solve(model, tolerance=1e-8)
    >>> solution.method, bool(solution.error_estimate < 1e-8)
    ('direct', True)
    >>> bent = gs.Model(bar, gs.Isotropic(210e9, 0.0), fixed, 500 * pull[:, [1, 2, 0]])
    >>> steps = gs.fem.solve(bent, geometry="nonlinear", factors=[0.5, 1.0]).steps
    >>> [f"{step.u[:, 2].max():.3f}" for step in steps]  # 0.942 at factor 1 by linear theory
    ['0.391', '0.582']
    """
    require(isinstance(model, Model), "solve model", type(model).__name__, "a Model")
    require(isinstance(device, Device | None), "solve device", repr(device), "a Device, or None")
    targets = _targets(model, geometry, factors, start)
    keep_freed_memory()
    most, begin = max_iterations and int(max_iterations), _start(model, start)
    options = Options(method, device, backend, tolerance, most, begin, progress,
                      resolve_formulation(model, formulation), Clock())  # fmt: skip
    # sums by several threads of BLAS aren't worth their waiting; the work is shared out above it
    with one_blas_thread():
        return _solved(model, targets, options)


def _solved(model: Model, targets: Float | None, options: Options) -> Solution:
    """At the factors ``targets`` (K,L), or by linear theory; nodes are numbered anew where that is
    quicker."""
    lattice = model_lattice(model)
    check_supports(model, lattice)
    numbering, own = None if lattice is not None else Numbering.of(model), model
    if numbering is not None:
        own = numbering.renumbered(model)
        begin = None if options.start is None else numbering.forward(options.start)
        options = replace(options, start=begin)
    options.clock.mark("check")
    if targets is None:
        solution = linear_static(own, lattice, options)
    else:
        # what linear theory doesn't need isn't loaded
        from gpusim.fem.procedures.nonlinear_static import nonlinear_static

        solution = nonlinear_static(own, targets, options)
    if numbering is not None:
        solution = replace(numbering.back(solution), model=model)
    dangling = len(model.mesh.dangling_nodes)
    told = f"{dangling} nodes belong to no cell; they move only where it is prescribed"
    return replace(solution, warnings=(told, *solution.warnings)) if dangling else solution


def _targets(
    model: Model, geometry: str, factors: npt.ArrayLike | None, start: npt.ArrayLike | None
) -> Float | None:
    """Factors of the steps, see `_factors`; None by linear theory. Refuses what the analysis would
    leave aside."""
    if geometry == "linear":
        _refuse_finite_strain(model)
        expected = "none by linear theory: its load cases are superposed, see Solution.u"
        require(factors is None, "solve: factors", repr(factors), expected)
        return None
    expected = "none: equilibria are followed from rest"
    require(start is None, "solve: start", type(start).__name__, expected)
    return _factors(model, factors)


def _refuse_finite_strain(model: Model) -> None:
    for number, law in enumerate(model.materials):
        finite = isinstance(law, Law) and law.finite_strain
        expected = "a linear elastic one, or geometry='nonlinear'"
        require(not finite, f"solve: materials[{number}] by linear theory", repr(law), expected)


def _start(model: Model, start: npt.ArrayLike | None) -> Float | None:
    if start is None:
        return None
    shape = model.load_cases.shape
    u = finite_numbers(start, "solve: start", (shape, shape[1:]), f"{shape} finite numbers")
    return np.broadcast_to(u, shape)


def _factors(model: Model, factors: npt.ArrayLike | None) -> Float:
    """(K,L) factors of the load cases, step by step."""
    cases = len(model.load_cases)
    expected = "(K,) finite numbers, K >= 1"
    if cases > 1:
        expected = f"(K, {cases}) finite numbers, K >= 1: how load cases add up in each step"
    asked = [1.0] if factors is None else factors
    given = as_float64(asked, "solve: factors", expected)
    require(given.size > 0, "solve: factors", "none", expected)
    count = len(given) if given.ndim else 1
    shapes = [(count, cases), (count,)] if cases == 1 else [(count, cases)]
    return finite_numbers(asked, "solve: factors", shapes, expected).reshape(-1, cases)
