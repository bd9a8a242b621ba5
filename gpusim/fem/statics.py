"""Linear statics: K u = f to a stated displacement error."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from numbers import Integral, Real

import numpy as np
import numpy.typing as npt
from scipy.sparse import csr_matrix

from gpusim.errors import InputError
from gpusim.fem.aggregation import block_matrix, build_hierarchy
from gpusim.fem.arena import Arena
from gpusim.fem.block_rows import BlockRows, assemble, resolve_formulation
from gpusim.fem.cg import DeviceCG, NumpyCG
from gpusim.fem.diagonal import invert_blocks
from gpusim.fem.iterate import Norm, Outcome, System, iterate
from gpusim.fem.model import Model
from gpusim.fem.preconditioner import BlockJacobi, Multigrid
from gpusim.fem.solution import Solution
from gpusim.fem.sparse import apply_sparse
from gpusim.fem.stiffness import DeviceStiffness, apply_stiffness
from gpusim.fem.supports import check_supports
from gpusim.gpu import Device, default_device

__all__ = ["PRECONDITIONERS", "solve"]

Float = npt.NDArray[np.float64]
Progress = Callable[[int, float], None]

PRECONDITIONERS = ("multigrid", "block_jacobi")
_MOST_ITERATIONS = {"multigrid": 1000, "block_jacobi": 100_000}


@dataclass
class _Clock:
    """Seconds since the last mark, per part."""

    timings: dict[str, float] = field(default_factory=dict)
    last: float = field(default_factory=time.perf_counter)

    def mark(self, name: str) -> None:
        now = time.perf_counter()
        self.timings[name] = self.timings.get(name, 0.0) + now - self.last
        self.last = now


def solve(
    model: Model,
    device: Device | None = None,
    *,
    tolerance: float = 1e-6,
    formulation: str | Mapping[str, str] | None = None,
    backend: str = "gpu",
    max_iterations: int | None = None,
    preconditioner: str = "multigrid",
    start: npt.ArrayLike | None = None,
    progress: Progress | None = None,
) -> Solution:
    """Displacements of a linear static model.

    Conjugate gradients in float64 (double-single where the device has no 64-bit floats), every
    load case at once, inside a float64 refinement: after each run the true residual f - K u is
    formed in float64 on the host and, if its estimate asks for it, corrected again.

    Parameters
    ----------
    model : see ``Model``.
    device : None takes the process-wide one (none at all for ``backend="numpy"``).
    tolerance : relative displacement error to reach, in (0, 1); the estimate is documented in
        ``gpusim.fem.stopping``.
    formulation : "incompatible" (default for hex8), "full" or "bbar", for all cells or per type.
    backend : "gpu", or "numpy" for the twin.
    max_iterations : of conjugate gradients; None: 1000 (multigrid), 100000 (block_jacobi).
    preconditioner : "multigrid" (smoothed aggregation) or "block_jacobi".
    start : (N,3) or (L,N,3) displacements to begin from.
    progress : called with (iterations so far, estimated relative error).

    Raises
    ------
    InputError
        A wrong argument; supports that leave a rigid-body motion free (named).
    NotConverged
        Values that aren't finite, negative curvature, or a coarse matrix that rounding has made
        indefinite. Running out of iterations or stagnating isn't raised: ``Solution.converged``
        is False and ``message`` says why.
    OutOfDeviceMemory
        The device can't hold the model; refused before anything is allocated.
    """
    clock = _Clock()
    _check_arguments(model, device, tolerance, backend, max_iterations, preconditioner)
    check_supports(model)
    formulations = resolve_formulation(model, formulation)
    first = _start(model, start)
    clock.mark("check")
    rows = assemble(model, formulations)
    clock.mark("assembly")
    system = _system(model, rows)
    if not system.right.any():
        u = np.broadcast_to(system.prescribed, system.right.shape).copy()
        return _solution(model, system, rows, u, _trivial(system), clock, backend, "none", "none")
    chosen, norm, product = _preconditioner(preconditioner, model, rows, system)
    clock.mark("preconditioner")
    most = max_iterations if max_iterations is not None else _MOST_ITERATIONS[preconditioner]
    chunk = 5 if preconditioner == "multigrid" else 100
    refine = partial(
        iterate,
        norm=norm,
        start=first,
        tolerance=tolerance,
        most=most,
        chunk=chunk,
        progress=progress,
    )
    if backend == "numpy":
        loop = NumpyCG(product, chosen)
        outcome = refine(system, loop)
        real = "f64"
    else:
        with Arena(device if device is not None else default_device()) as arena:
            cases, nodes = system.right.shape[:2]
            arena.device.require_memory(_memory(rows, cases, chosen), "solve")
            operator = DeviceStiffness(arena, rows, system.scale, cases)
            ready = chosen.upload(arena, operator, cases)
            device_loop = DeviceCG(arena, operator, ready, cases, 3 * nodes)
            clock.mark("upload")
            outcome = refine(system, device_loop)
            real = arena.real
    clock.mark("iterations")
    return _solution(model, system, rows, outcome.u, outcome, clock, backend, real, chosen.name)


def _check_arguments(
    model: Model,
    device: Device | None,
    tolerance: float,
    backend: str,
    max_iterations: int | None,
    preconditioner: str,
) -> None:
    if not isinstance(model, Model):
        raise InputError(f"solve: model; got {type(model).__name__}; expected a Model")
    if not (device is None or isinstance(device, Device)):
        raise InputError(f"solve: device; got {device!r}; expected a Device, or None")
    if not (isinstance(tolerance, Real) and 0.0 < tolerance < 1.0):
        raise InputError(f"solve: tolerance; got {tolerance!r}; expected a number in (0, 1)")
    if backend not in ("gpu", "numpy"):
        raise InputError(f"solve: backend; got {backend!r}; expected 'gpu' or 'numpy'")
    if preconditioner not in PRECONDITIONERS:
        raise InputError(
            f"solve: preconditioner; got {preconditioner!r}; "
            f"expected one of {', '.join(PRECONDITIONERS)}"
        )
    whole = isinstance(max_iterations, Integral) and not isinstance(max_iterations, bool)
    if max_iterations is not None and not (whole and max_iterations >= 1):
        raise InputError(
            f"solve: max_iterations; got {max_iterations!r}; expected a whole number of at least 1"
        )


def _start(model: Model, start: npt.ArrayLike | None) -> Float | None:
    if start is None:
        return None
    try:
        u = np.asarray(start, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InputError(f"solve: start; not numbers ({error}); expected float64") from None
    shape = model.load_cases.shape
    if u.shape not in (shape, shape[1:]) or not np.isfinite(u).all():
        raise InputError(f"solve: start; got shape {u.shape}; expected {shape} finite numbers")
    return np.broadcast_to(u, shape)


def _system(model: Model, rows: BlockRows) -> System:
    assert model.prescribed is not None and model.fixed is not None
    free = ~model.fixed
    free[model.mesh.dangling_nodes] = False
    # a power of two: the scaled problem has the same digits, and fits the range of float32
    largest = float(np.abs(rows.diagonal).max())
    scale = float(2.0 ** np.round(np.log2(largest)))
    prescribed = model.prescribed[None]
    pull = apply_stiffness(rows, prescribed) if prescribed.any() else np.zeros_like(prescribed)
    right = np.where(free, model.load_cases - pull, 0.0)
    size = np.abs(right).max(axis=(1, 2))
    load_scale: Float = np.exp2(np.round(np.log2(np.where(size > 0.0, size, 1.0))))
    return System(
        apply=lambda u: apply_stiffness(rows, u) / scale,
        right=right / load_scale[:, None, None],
        free=free,
        scale=scale,
        load_scale=load_scale,
        prescribed=prescribed,
    )


def _preconditioner(
    name: str, model: Model, rows: BlockRows, system: System
) -> tuple[BlockJacobi | Multigrid, Norm, Callable[[Float], Float]]:
    """Preconditioner, norm of the stopping rule, and the NumPy loop's product with K'.

    Inside the loop NumPy multiplies by the assembled matrix, which is several times faster than
    differences; the refinement's residual still comes from differences.
    """
    matrix = block_matrix(rows)
    matrix.data /= system.scale
    assembled = csr_matrix(matrix)

    def product(x: Float) -> Float:
        return apply_sparse(assembled, x)

    if name == "block_jacobi":
        diagonal = rows.diagonal[rows.row_class] / system.scale
        return BlockJacobi(invert_blocks(diagonal, system.free)), Norm(diagonal, None), product
    hierarchy = build_hierarchy(matrix, system.free, model.mesh.points)
    return Multigrid(hierarchy, product), Norm(None, hierarchy.lowest), product


def _memory(rows: BlockRows, cases: int, chosen: BlockJacobi | Multigrid) -> int:
    """Bytes of the buffers to come: vectors, operator, preconditioner."""
    nodes = rows.node_count
    total = 5 * cases * nodes * 24 + rows.table.nbytes + rows.neighbour.nbytes + 8 * nodes
    if isinstance(chosen, BlockJacobi):
        return total + chosen.inverse.nbytes + 2 * cases * nodes * 24
    for level in chosen.hierarchy.levels:
        total += level.inverse.nbytes + 24 * level.prolongation.nnz
        total += 0 if level.matrix is None else 12 * level.matrix.nnz
        total += 4 * 8 * cases * int(level.prolongation.shape[0])
    return total + 12 * chosen.hierarchy.coarse_inverse.nnz


def _trivial(system: System) -> Outcome:
    cases = len(system.right)
    return Outcome(system.right, True, 0.0, 0, np.zeros((0, cases)), "no load: exact")


def _solution(
    model: Model,
    system: System,
    rows: BlockRows,
    u: Float,
    outcome: Outcome,
    clock: _Clock,
    backend: str,
    real: str,
    preconditioner: str,
) -> Solution:
    forces = model.load_cases
    internal = apply_stiffness(rows, u)
    assert model.fixed is not None
    reactions = np.where(model.fixed, internal - forces, 0.0)
    single = model.forces is not None and model.forces.ndim == 2
    warnings = []
    dangling = len(model.mesh.dangling_nodes)
    if dangling:
        warnings.append(f"{dangling} nodes belong to no cell; their displacement is zero")
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
        message=outcome.message,
        warnings=tuple(warnings),
        timings=clock.timings,
        backend=backend,
        real=real,
        preconditioner=preconditioner,
        element_classes=rows.element_classes,
        row_classes=len(rows.table),
    )
