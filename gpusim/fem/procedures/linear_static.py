"""Linear statics: K u = f to a stated displacement error."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from numbers import Integral, Real

import numpy as np
import numpy.typing as npt

from gpusim.arrays.array_types import Float
from gpusim.fem.assembly.assembly import Assembled, assemble, model_lattice
from gpusim.fem.assembly.node_graph import Numbering
from gpusim.fem.assembly.reduced_system import reduced_system
from gpusim.fem.assembly.stiffness_rounding import extremes
from gpusim.fem.assembly.system import System, make_system
from gpusim.fem.krylov.outer_iteration import Outcome
from gpusim.fem.linear.linear_solver import solve_system
from gpusim.fem.linear.solve_plan import METHODS, Clock, Options, SolvePlan, plan_solve
from gpusim.fem.model.constraints import touched
from gpusim.fem.model.elimination import Elimination, eliminate
from gpusim.fem.model.model import Model, Solution, resolve_formulation
from gpusim.fem.model.supports import check_supports
from gpusim.fem.sparse.block_rows import BlockRows
from gpusim.gpu import Device
from gpusim.parallel.blas_threads import one_blas_thread
from gpusim.validation import finite_numbers, require, require_one_of, unmasked


@unmasked()
def solve(
    model: Model,
    device: Device | None = None,
    *,
    tolerance: float = 1e-6,
    formulation: str | Mapping[str, str] | None = None,
    backend: str = "auto",
    method: str = "auto",
    max_iterations: int | None = None,
    start: npt.ArrayLike | None = None,
    progress: Callable[[int, float], None] | None = None,
) -> Solution:
    """Displacements of a linear static model.

    Long or small bodies are factorised on the host (``gpusim.fem.direct_solvers``) and refined with
    float64 residuals. Everything else takes conjugate gradients in float64 (double-single where the
    device has no 64-bit floats), preconditioned by multigrid, until the residual f - K u, formed in
    float64 on the host, is small enough. Load cases share the set-up; a device iterates them at
    once, the host side by side (on Linux, in copies of the process: ``gpusim.parallel.processes``).
    Which way is cheaper is estimated from the mesh; ``Solution.method`` and ``message`` say it.

    Parameters
    ----------
    model : see ``Model``.
    device : None takes the process-wide one (none at all for ``backend="numpy"``).
    tolerance : relative displacement error to reach, in (0, 1), as it is estimated in
        ``gpusim.fem.krylov.error_estimates`` and ``fem.direct_solvers.iterative_refinement``.
    formulation : integration or enrichment by name, for all cells or per type; see
        ``gpusim.fem.elements.element``. The default is "incompatible" for hex8, "full" otherwise.
    backend : where multigrid iterates: "gpu", "numpy" (the twins, on all processors of the host),
        or "auto": "gpu" where ``device`` is given or the adapter isn't a software one.
    method : "direct", "multigrid" (smoothed aggregation below geometric levels), or "auto": the
        cheaper of the two; direct also where multigrid doesn't converge.
    max_iterations : of conjugate gradients; None: 1000.
    start : (N,3) or (L,N,3) displacements to begin from; a direct solver needs none.
    progress : called with (iterations, estimated relative error), of this process's load cases.

    Raises
    ------
    InputError
        A wrong argument; supports and constraints that leave a rigid-body motion free (named), or
        contradict each other.
    NotConverged
        Values that aren't finite, negative curvature, or a matrix that rounding made indefinite.
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
    """
    clock = Clock()
    _check_arguments(model, device, tolerance, backend, max_iterations, method, progress)
    # sums by several threads of BLAS aren't worth their waiting; the work is shared out above it
    with one_blas_thread():
        lattice = model_lattice(model)
        check_supports(model, lattice)
        formulations = resolve_formulation(model, formulation)
        begin = _start(model, start)
        numbering, asked = None if lattice is not None else Numbering.of(model), model
        if numbering is not None:
            model = numbering.renumbered(model)
            begin = None if begin is None else numbering.forward(begin)
        elimination = eliminate(model)
        options = Options(method, device, backend, tolerance, max_iterations, begin, progress,
                          formulations, clock)  # fmt: skip
        clock.mark("check")
        assembled = assemble(model, formulations, lattice)
        clock.mark("assembly")
        system = _system(model, assembled, formulations)
        solution = _solved(model, assembled, system, elimination, options)
        return solution if numbering is None else replace(numbering.back(solution), model=asked)


def _solved(
    model: Model,
    assembled: Assembled,
    whole: System,
    elimination: Elimination | None,
    options: Options,
) -> Solution:
    """The solution of a system, or of what constraints leave of it."""
    system = whole
    if elimination is not None:
        assembled, system = reduced_system(assembled, whole, elimination)
    plan = plan_solve(model, assembled, system, options)
    options.clock.mark("choice")
    outcome = solve_system(plan, model, assembled, system, options)
    if elimination is not None:
        u = elimination.displacements(outcome.u)
        outcome = replace(outcome, u=u, forces=whole.elements.product(u))
    return _solution(model, system, assembled.rows, outcome, plan, options.clock)


def _system(model: Model, assembled: Assembled, formulations: Mapping[str, str]) -> System:
    system = make_system(model, assembled)
    if "reduced" in formulations.values():
        # hourglass modes may be left: as soft as can be, and not felt by the loads
        system = replace(system, contrast=np.inf)
    return system


def _check_arguments(
    model: Model,
    device: Device | None,
    tolerance: float,
    backend: str,
    max_iterations: int | None,
    method: str,
    progress: Callable[[int, float], None] | None,
) -> None:
    require(isinstance(model, Model), "solve: model", type(model).__name__, "a Model")
    known = isinstance(device, Device | None)
    require(known, "solve: device", repr(device), "a Device, or None")
    share = isinstance(tolerance, Real) and 0.0 < tolerance < 1.0
    require(share, "solve: tolerance", repr(tolerance), "a number in (0, 1)")
    places = ("auto", "gpu", "numpy")
    require(backend in places, "solve: backend", repr(backend), "'auto', 'gpu' or 'numpy'")
    require_one_of("solve: method", method, METHODS)
    whole = isinstance(max_iterations, Integral) and not isinstance(max_iterations, bool)
    counted = max_iterations is None or (whole and max_iterations >= 1)
    expected = "a whole number of at least 1"
    require(counted, "solve: max_iterations", repr(max_iterations), expected)
    told = progress is None or callable(progress)
    require(told, "solve: progress", repr(progress), "a function, or None")


def _start(model: Model, start: npt.ArrayLike | None) -> Float | None:
    if start is None:
        return None
    shape = model.load_cases.shape
    u = finite_numbers(start, "solve: start", (shape, shape[1:]), f"{shape} finite numbers")
    return np.broadcast_to(u, shape)


def _solution(
    model: Model,
    system: System,
    rows: BlockRows,
    outcome: Outcome,
    plan: SolvePlan,
    clock: Clock,
) -> Solution:
    u, message = outcome.u, outcome.message
    if not outcome.converged:
        cause = extremes(model)
        message += f"; the model has {cause}" if cause else ""
    forces = model.load_cases
    internal = outcome.forces
    if internal is None:
        internal = system.apply(u) * system.scale
    assert model.fixed is not None
    held = model.fixed | touched(model.constraints, model.fixed.shape)
    reactions = np.where(held, internal - forces, 0.0)
    single = model.forces is not None and model.forces.ndim == 2
    warnings = []
    dangling = len(model.mesh.dangling_nodes)
    if dangling:
        warnings.append(
            f"{dangling} nodes belong to no cell; they move only where it is prescribed"
        )
    clock.mark("reactions")
    return Solution(
        u=u[0] if single else u,
        converged=outcome.converged,
        error_estimate=outcome.error_estimate,
        iterations=outcome.iterations,
        residuals=outcome.residuals,
        reactions=reactions[0] if single else reactions,
        strain_energy=0.5 * np.einsum("lni,lni->l", u, internal),
        external_work=0.5 * np.einsum("lni,lni->l", u, forces + reactions),
        unknowns=int(system.free.sum()),
        message=message,
        warnings=tuple(warnings),
        timings=clock.timings,
        method=outcome.method,
        backend=outcome.backend,
        real=outcome.real,
        element_classes=rows.element_classes,
        row_classes=rows.class_count,
        reasons=plan.lines,
        model=model,
    )
