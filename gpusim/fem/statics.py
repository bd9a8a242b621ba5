"""Linear statics: K u = f to a stated displacement error."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from numbers import Integral, Real

import numpy as np
import numpy.typing as npt

from gpusim.arrays.array_types import Float
from gpusim.errors import InputError
from gpusim.fem.assembly.assembly import Assembled, assemble, model_lattice
from gpusim.fem.assembly.node_graph import Numbering
from gpusim.fem.assembly.stiffness_rounding import extremes
from gpusim.fem.assembly.system import System, make_system
from gpusim.fem.krylov.outer_iteration import Outcome
from gpusim.fem.methods import solve_system
from gpusim.fem.model.model import Model, Solution, resolve_formulation
from gpusim.fem.model.supports import check_supports
from gpusim.fem.solve_plan import METHODS, Clock, Options, SolvePlan, plan_solve
from gpusim.fem.sparse.block_rows import BlockRows
from gpusim.gpu import Device
from gpusim.parallel.blas_threads import one_blas_thread
from gpusim.validation import unmasked


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
        A wrong argument; supports that leave a rigid-body motion free (named).
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
        numbering = None if lattice is not None else Numbering.of(model)
        if numbering is not None:
            model = numbering.renumbered(model)
            begin = None if begin is None else numbering.forward(begin)
        options = Options(method, device, backend, tolerance, max_iterations, begin, progress,
                          formulations, clock)  # fmt: skip
        clock.mark("check")
        assembled = assemble(model, formulations, lattice)
        clock.mark("assembly")
        system = _system(model, assembled, formulations)
        plan = plan_solve(model, assembled, system, options)
        clock.mark("choice")
        outcome = solve_system(plan, model, assembled, system, options)
        solution = _solution(model, system, assembled.rows, outcome, plan, clock)
        return solution if numbering is None else numbering.back(solution)


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
    if not isinstance(model, Model):
        raise InputError(f"solve: model; got {type(model).__name__}; expected a Model")
    if not (device is None or isinstance(device, Device)):
        raise InputError(f"solve: device; got {device!r}; expected a Device, or None")
    if not (isinstance(tolerance, Real) and 0.0 < tolerance < 1.0):
        raise InputError(f"solve: tolerance; got {tolerance!r}; expected a number in (0, 1)")
    if backend not in ("auto", "gpu", "numpy"):
        raise InputError(f"solve: backend; got {backend!r}; expected 'auto', 'gpu' or 'numpy'")
    if method not in METHODS:
        raise InputError(f"solve: method; got {method!r}; expected one of {', '.join(METHODS)}")
    whole = isinstance(max_iterations, Integral) and not isinstance(max_iterations, bool)
    if max_iterations is not None and not (whole and max_iterations >= 1):
        raise InputError(
            f"solve: max_iterations; got {max_iterations!r}; expected a whole number of at least 1"
        )
    if not (progress is None or callable(progress)):
        raise InputError(f"solve: progress; got {progress!r}; expected a function, or None")


def _start(model: Model, start: npt.ArrayLike | None) -> Float | None:
    if start is None:
        return None
    try:
        if np.iscomplexobj(start):
            raise TypeError("complex")
        u = np.asarray(start, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InputError(f"solve: start; not numbers ({error}); expected float64") from None
    shape = model.load_cases.shape
    if u.shape not in (shape, shape[1:]) or not np.isfinite(u).all():
        raise InputError(f"solve: start; got shape {u.shape}; expected {shape} finite numbers")
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
    reactions = np.where(model.fixed, internal - forces, 0.0)
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
