"""The ways to solve a system, and how one of them is picked."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from functools import cache, partial

import numpy as np
import numpy.typing as npt

from gpusim.arrays.congruence import noise
from gpusim.errors import InputError, NotConverged, OutOfDeviceMemory
from gpusim.fem.assembly.assembly import Assembled
from gpusim.fem.assembly.system import System, finest_matrix
from gpusim.fem.device.arena import Arena
from gpusim.fem.device.operator_form import device_tets, operator_bytes, upload_operator
from gpusim.fem.device.tet_elements import TetElements
from gpusim.fem.device.v_cycle import compile_kernels
from gpusim.fem.direct_solvers.iterative_refinement import refine
from gpusim.fem.direct_solvers.solver_choice import (
    Direct,
    direct_solver,
    least_seconds,
    multigrid_seconds,
)
from gpusim.fem.incompressibility.mixed_formulation import Mixed, mixed_solver
from gpusim.fem.krylov.cg import DeviceCG, NumpyCG
from gpusim.fem.krylov.error_estimates import Norm
from gpusim.fem.krylov.load_cases import Progress, each_case
from gpusim.fem.krylov.outer_iteration import HARSH, Outcome, iterate
from gpusim.fem.krylov.rounding_error import Blur
from gpusim.fem.model.model import Model
from gpusim.fem.multigrid.hierarchy import Hierarchy, build_hierarchy
from gpusim.fem.multigrid.preconditioner import Multigrid
from gpusim.gpu import Device, default_device, software_adapter

__all__ = ["METHODS", "Clock", "Options", "Result", "solve_system"]

Float = npt.NDArray[np.float64]

METHODS = ("auto", "direct", "multigrid")
# of conjugate gradients with pressures; with more something is wrong
_MOST_WITH_PRESSURES = 600
_MOST_ITERATIONS = 1000
# where multigrid has failed, a direct solver may take this long (s, estimated)
_PATIENCE = 600.0
# where stiffnesses differ greatly it may take this many times as long as multigrid would, or (s)
_INVERSE_STEPS = 8
_HARSH_PATIENCE, _HARSH_SECONDS = 30.0, 30.0
# load cases that a direct solver refines each by itself; of many at once it solves for all with
# matrix products
_FEW_CASES = 4
# ratio of greatest and least modulus, 300 at nu = 0.495, from which on a material is stiff in bulk
_STIFF_IN_BULK = 300.0


@dataclass
class Clock:
    """Seconds since the last mark, per part."""

    timings: dict[str, float] = field(default_factory=dict)
    last: float = field(default_factory=time.perf_counter)

    def mark(self, name: str) -> None:
        now = time.perf_counter()
        self.timings[name] = self.timings.get(name, 0.0) + now - self.last
        self.last = now


@dataclass(frozen=True)
class Options:
    """How to iterate, and the ``formulation`` per cell type of what was assembled."""

    device: Device | None
    backend: str
    tolerance: float
    most: int | None
    start: Float | None
    progress: Callable[[int, float], None] | None
    formulation: Mapping[str, str]


@dataclass(frozen=True)
class Result:
    """An outcome and how it came about."""

    outcome: Outcome
    method: str
    backend: str
    real: str


def solve_system(
    method: str,
    model: Model,
    assembled: Assembled,
    system: System,
    options: Options,
    clock: Clock,
) -> Result:
    look = cache(partial(direct_solver, assembled, system.free, model.mesh.points, system.scale))
    if method == "direct":
        direct = look()
        if direct is None or not direct.fits:
            raise InputError(
                "solve: method 'direct'; got a body whose factors "
                + ("can't be ordered" if direct is None else f"need {direct.nbytes / 1e9:.1f} GB")
                + "; expected one that fits the free memory, or method 'multigrid'"
            )
        clock.mark("choice")
        return _factorised(direct, system, options, clock, "")
    if method == "auto":
        patience = multigrid_seconds(int(system.free.sum()))
        if system.contrast > HARSH:
            # multigrid takes many times as long there, and its error is harder to tell
            patience = max(_HARSH_PATIENCE * patience, _HARSH_SECONDS)
        worth = least_seconds(assembled, system.free) <= patience
        direct = look() if worth else None
        clock.mark("choice")
        if direct is not None and direct.seconds <= patience and direct.fits:
            return _factorised(direct, system, options, clock, "")

    def instead(reason: str) -> Result | None:
        direct = look() if method == "auto" else None
        if direct is None or not (direct.fits and direct.seconds <= _PATIENCE):
            return None
        return _factorised(direct, system, options, clock, f"; multigrid had failed: {reason}")

    try:
        result = _iterated(model, assembled, system, options, clock)
    except NotConverged as error:
        other = instead(str(error))
        if other is None:
            raise
        return other
    if result.outcome.converged:
        return result
    return instead(result.outcome.message) or result


def _factorised(
    direct: Direct, system: System, options: Options, clock: Clock, note: str
) -> Result:
    factor = direct.build()
    clock.mark("factorisation")

    def one(part: System, start: Float | None, progress: Progress | None) -> Outcome:
        del start  # it needs none
        return refine(part, factor, tolerance=options.tolerance, progress=progress)

    if len(system.right) <= _FEW_CASES:
        outcome = each_case(one, system, None, options.progress)
    else:
        outcome = one(system, None, options.progress)
    clock.mark("iterations")
    message = f"{outcome.message} ({direct.description}{note})"
    return Result(replace(outcome, message=message), "direct", "numpy", "f64")


def _iterated(
    model: Model, assembled: Assembled, system: System, options: Options, clock: Clock
) -> Result:
    if _nearly_incompressible(model):
        result = _with_pressures(model, assembled, system, options, clock)
        if result is not None:
            return result
    on_device = _on_device(options)
    if on_device:
        # the operator and the vectors at least; what multigrid adds is known once it is set up
        device = options.device if options.device is not None else default_device()
        elements = device_tets(device, assembled)
        least = assembled.rows.nbytes if elements is None else operator_bytes(assembled, elements)
        _ask(device, least + 5 * 8 * system.right.size, system)
    with ThreadPoolExecutor(1) as aside:
        by_elements = on_device and elements is not None
        compiled = None
        if on_device:
            compiled = aside.submit(compile_kernels, device, by_elements)
        multigrid, norm = _multigrid(model, assembled, system, on_device)
    if compiled is not None:
        compiled.result()
    clock.mark("preconditioner")
    most = options.most if options.most is not None else _MOST_ITERATIONS
    run = partial(
        iterate,
        norm=norm,
        blur=Blur(multigrid, options.tolerance),
        tolerance=options.tolerance,
        most=most,
    )
    if not on_device:

        def one(part: System, start: Float | None, progress: Progress | None) -> Outcome:
            return run(part, NumpyCG(multigrid.product, multigrid), start=start, progress=progress)

        outcome = each_case(one, system, options.start, options.progress)
        clock.mark("iterations")
        return Result(outcome, "multigrid", "numpy", "f64")
    with Arena(device) as arena:
        cases = len(system.right)
        _ask(device, _memory(assembled, elements, cases, multigrid), system)
        operator = upload_operator(arena, assembled, elements, system.scale, cases)
        ready = multigrid.upload(arena, operator, cases)
        loop = DeviceCG(arena, operator, ready, cases)
        clock.mark("upload")
        outcome = run(system, loop, start=options.start, progress=options.progress)
        clock.mark("iterations")
        return Result(outcome, "multigrid", "gpu", arena.real)


def _with_pressures(
    model: Model, assembled: Assembled, system: System, options: Options, clock: Clock
) -> Result | None:
    """None where the bodies aren't fit for it, or it has failed; on the host."""
    try:
        mixed = mixed_solver(model, options.formulation, assembled, system)
        clock.mark("preconditioner")
        if mixed is None:
            return None
        outcome = each_case(
            partial(_with_pressure, mixed, options), system, options.start, options.progress
        )
    except NotConverged:
        return None
    finally:
        clock.mark("iterations")
    if not outcome.converged and options.most is None:
        return None
    note = f"displacements and pressures: a nearly incompressible material; {mixed.probed} more"
    message = f"{outcome.message} ({note} iterations looked for soft modes)"
    return Result(replace(outcome, message=message), "multigrid", "numpy", "f64")


def _with_pressure(
    mixed: Mixed, options: Options, part: System, start: Float | None, progress: Progress | None
) -> Outcome:
    """One load case by displacements and pressures."""
    most = options.most or _MOST_WITH_PRESSURES
    return iterate(
        part, mixed.loop(1), mixed.norm, start, blur=Blur(mixed, options.tolerance),
        tolerance=options.tolerance, most=most, progress=progress,
    )  # fmt: skip


def _on_device(options: Options) -> bool:
    if options.backend == "auto":
        return options.device is not None or not software_adapter()
    return options.backend == "gpu"


def _ask(device: Device, nbytes: int, system: System) -> None:
    """Refuse what the device can't hold, and say what it could."""
    try:
        device.require_memory(nbytes, "solve")
    except OutOfDeviceMemory as error:
        left = (device.memory_limit or 0) - device.allocated
        fitting = max(0, int(system.free.sum() * (left / nbytes)))
        raise OutOfDeviceMemory(
            f"{error}; expected at most about {fitting} unknowns of this kind (the model has "
            f"{int(system.free.sum())}), fewer load cases at once, or backend 'numpy'"
        ) from None


def _nearly_incompressible(model: Model) -> bool:
    """Whether some material's bulk modulus outweighs its shear modulus beyond Jacobi smoothing."""
    moduli = [np.linalg.eigvalsh(material.stiffness()) for material in model.materials]
    return max(float(one.max() / one.min()) for one in moduli) > _STIFF_IN_BULK


def _multigrid(
    model: Model, assembled: Assembled, system: System, on_device: bool
) -> tuple[Multigrid, Norm]:
    """Preconditioner, and the norm of the stopping rule."""
    multigrid = Multigrid(_hierarchy(model, assembled, system, inverted=on_device))
    lowest = multigrid.lowest
    if system.contrast > HARSH:
        lowest = min(lowest, _softest(multigrid, system))
    return multigrid, Norm(lowest)


def _hierarchy(model: Model, assembled: Assembled, system: System, inverted: bool) -> Hierarchy:
    return build_hierarchy(
        finest_matrix(assembled.rows, system),
        assembled.groups,
        assembled.lattice,
        system.free,
        model.mesh.points,
        assembled.rows,
        system.scale,
        stiff_in_bulk=_nearly_incompressible(model),
        inverted=inverted,
        harsh=system.contrast > HARSH,
    )


def _softest(multigrid: Multigrid, system: System) -> float:
    """Rayleigh quotient of K after inverse iteration by the preconditioner: soft islands between
    stiff ones are too small for the coarsest level, whose least eigenvalue serves elsewhere."""
    x = np.where(system.free.ravel(), noise(system.free.size, 12), 0.0)[None]
    for _ in range(_INVERSE_STEPS):
        x = multigrid.apply(x)
        x /= np.linalg.norm(x)
    return float(x[0] @ multigrid.product(x)[0] / (x[0] @ x[0]))


def _memory(
    assembled: Assembled,
    elements: TetElements | None,
    cases: int,
    multigrid: Multigrid,
) -> int:
    """Bytes to come on a device: vectors, operator, preconditioner."""
    return (
        DeviceCG.device_bytes(assembled.rows.node_count, cases)
        + operator_bytes(assembled, elements)
        + multigrid.device_bytes(cases)
    )
