"""A system solved as a plan says."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import partial

import numpy as np

from gpusim.arrays.array_types import Float
from gpusim.arrays.unique import noise
from gpusim.errors import NotConverged, OutOfDeviceMemory
from gpusim.fem.assembly.assembly import Assembled
from gpusim.fem.assembly.system import System
from gpusim.fem.device.node_texels import Arena
from gpusim.fem.device.tet_elements import TetElements
from gpusim.fem.device.tet_forces import device_tets, operator_bytes, upload_operator
from gpusim.fem.device.v_cycle import compile_kernels
from gpusim.fem.direct_solvers.iterative_refinement import refine
from gpusim.fem.incompressibility.mixed_formulation import mixed_solver
from gpusim.fem.krylov.cg import DeviceCG, NumpyCG
from gpusim.fem.krylov.error_estimates import Norm, RoundingError
from gpusim.fem.krylov.multigrid_preconditioner import Multigrid
from gpusim.fem.krylov.outer_iteration import Outcome, Progress, each_case, iterate
from gpusim.fem.linear.solve_plan import Direct, Options, SolvePlan
from gpusim.fem.model.model import Model
from gpusim.fem.multigrid.hierarchy import build_hierarchy
from gpusim.gpu import Device

# of conjugate gradients with pressures; with more something is wrong
_MOST_WITH_PRESSURES = 600
_MOST_ITERATIONS = 1000
# where multigrid has failed, a direct solver may take this long (s, estimated)
_PATIENCE = 600.0
# of inverse iteration
_INVERSE_STEPS = 8


def solve_system(
    plan: SolvePlan, model: Model, assembled: Assembled, system: System, options: Options
) -> Outcome:
    """What the plan says, in its order, until an attempt has converged."""
    if plan.attempts == ("none",):
        u = np.broadcast_to(system.prescribed, system.right.shape).copy()
        none = np.zeros((0, len(system.right)))
        return Outcome(
            u, True, 0.0, 0, none, "no load: exact", None, "none", options.backend, "none"
        )
    if plan.attempts == ("direct",):
        return _factorised(plan.direct(), system, options, "")

    def instead(reason: str) -> Outcome | None:
        direct = plan.direct() if "direct" in plan.attempts else None
        if direct is None or not (direct.fits and direct.seconds <= _PATIENCE):
            return None
        return _factorised(direct, system, options, f"; multigrid had failed: {reason}")

    result = None
    try:
        if "pressures" in plan.attempts:
            result = _with_pressures(model, assembled, system, options)
        if result is None:
            result = _with_multigrid(plan, model, assembled, system, options)
    except NotConverged as error:
        other = instead(str(error))
        if other is None:
            raise
        return other
    if result.converged:
        return result
    return instead(result.message) or result


def _factorised(direct: Direct | None, system: System, options: Options, note: str) -> Outcome:
    assert direct is not None
    factor, clock = direct.build(), options.clock
    clock.mark("factorisation")
    outcome = refine(system, factor, tolerance=options.tolerance, progress=options.progress)
    clock.mark("iterations")
    message = f"{outcome.message} ({direct.description}{note})"
    return replace(outcome, message=message, method="direct")


def _with_multigrid(
    plan: SolvePlan, model: Model, assembled: Assembled, system: System, options: Options
) -> Outcome:
    clock = options.clock
    if not plan.on_device:
        multigrid, run = _multigrid(plan, model, assembled, system, options)
        clock.mark("preconditioner")

        def one(part: System, start: Float | None, progress: Progress | None) -> Outcome:
            loop = NumpyCG(multigrid.product, multigrid)
            return run(part, loop, start=start, progress=progress)

        outcome = each_case(one, system, options.start, options.progress)
        clock.mark("iterations")
        return outcome
    device = plan.adapter()
    elements = device_tets(device, assembled)
    # the operator and the vectors at least; what multigrid adds is known once it is set up
    least = assembled.rows.nbytes if elements is None else operator_bytes(assembled, elements)
    _ask(device, least + 5 * 8 * system.right.size, system)
    with ThreadPoolExecutor(1) as aside:
        compiled = aside.submit(compile_kernels, device, elements is not None)
        multigrid, run = _multigrid(plan, model, assembled, system, options)
    compiled.result()
    clock.mark("preconditioner")
    with Arena(device) as arena:
        cases = len(system.right)
        _ask(device, _memory(assembled, elements, cases, multigrid), system)
        operator = upload_operator(arena, assembled, elements, system.scale, cases)
        ready = multigrid.upload(arena, operator, cases)
        loop = DeviceCG(arena, operator, ready, cases)
        clock.mark("upload")
        outcome = run(system, loop, start=options.start, progress=options.progress)
        clock.mark("iterations")
        return replace(outcome, backend="gpu", real=arena.real)


def _with_pressures(
    model: Model, assembled: Assembled, system: System, options: Options
) -> Outcome | None:
    """None where the bodies aren't fit for it, or it has failed; on the host."""
    clock = options.clock

    def one(part: System, start: Float | None, progress: Progress | None) -> Outcome:
        assert mixed is not None
        return iterate(
            part, mixed.loop(1), mixed.norm, start,
            rounding=RoundingError(mixed, options.tolerance), tolerance=options.tolerance,
            most=options.most or _MOST_WITH_PRESSURES,
            progress=progress,
        )  # fmt: skip

    try:
        mixed = mixed_solver(model, options.formulation, assembled, system)
        clock.mark("preconditioner")
        if mixed is None:
            return None
        outcome = each_case(one, system, options.start, options.progress)
    except NotConverged:
        return None
    finally:
        clock.mark("iterations")
    if not outcome.converged and options.most is None:
        return None
    note = f"displacements and pressures: a nearly incompressible material; {mixed.probed} more"
    message = f"{outcome.message} ({note} iterations looked for soft modes)"
    return replace(outcome, message=message)


def _ask(device: Device, nbytes: int, system: System) -> None:
    """Refuse what the device can't hold, and say what it could."""
    try:
        device.require_memory(nbytes, "solve")
    except OutOfDeviceMemory as error:
        free_bytes = (device.memory_limit or 0) - device.allocated
        fitting = max(0, int(system.free.sum() * (free_bytes / nbytes)))
        raise OutOfDeviceMemory(
            f"{error}; expected at most about {fitting} unknowns of this kind (the model has "
            f"{int(system.free.sum())}), fewer load cases at once, or backend 'numpy'"
        ) from None


def _multigrid(
    plan: SolvePlan, model: Model, assembled: Assembled, system: System, options: Options
) -> tuple[Multigrid, Callable[..., Outcome]]:
    """The preconditioner, and ``iterate`` with what it needs to know of it."""
    hierarchy = build_hierarchy(
        assembled,
        system,
        model.mesh.points,
        stiff_in_bulk=plan.stiff_in_bulk,
        inverted=plan.on_device,
        uneven_stiffness=plan.uneven_stiffness,
    )
    multigrid, lowest = Multigrid(hierarchy), hierarchy.lowest
    if plan.uneven_stiffness:
        lowest = min(lowest, _softest(multigrid, system))
    run = partial(
        iterate,
        norm=Norm(lowest),
        rounding=RoundingError(multigrid, options.tolerance),
        tolerance=options.tolerance,
        most=options.most if options.most is not None else _MOST_ITERATIONS,
    )
    return multigrid, run


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
