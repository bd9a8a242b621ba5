"""Conjugate gradients preconditioned by multigrid, on a device."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

from gpusim.errors import OutOfDeviceMemory
from gpusim.fem.assembly.assembly import Assembled
from gpusim.fem.assembly.system import System
from gpusim.fem.device.node_texels import Arena
from gpusim.fem.device.tet_elements import TetElements
from gpusim.fem.device.tet_forces import device_tets, operator_bytes, upload_operator
from gpusim.fem.device.v_cycle import compile_kernels
from gpusim.fem.krylov.cg import DeviceCG
from gpusim.fem.krylov.multigrid_preconditioner import Multigrid
from gpusim.fem.krylov.outer_iteration import Outcome
from gpusim.fem.linear.multigrid_solver import MultigridSolver
from gpusim.fem.linear.solve_plan import Options, SolvePlan
from gpusim.fem.model.model import Model
from gpusim.gpu import Device


def solve_on_device(
    plan: SolvePlan, model: Model, assembled: Assembled, system: System, options: Options
) -> Outcome:
    """Displacements under the loads of the system; the device holds nothing afterwards.

    Raises OutOfDeviceMemory before anything is allocated.
    """
    clock = options.clock
    device = plan.adapter()
    elements = device_tets(device, assembled)
    # the operator and the vectors at least; what multigrid adds is known once it is set up
    least = assembled.rows.nbytes if elements is None else operator_bytes(assembled, elements)
    _ask(device, least + 5 * 8 * system.right.size, system)
    with ThreadPoolExecutor(1) as aside:
        compiled = aside.submit(compile_kernels, device, elements is not None)
        solver = MultigridSolver.prepare(plan, assembled, system, model.mesh.points)
        lowest = solver.lowest_eigenvalue()
    compiled.result()
    clock.mark("preconditioner")
    with Arena(device) as arena:
        cases = len(system.right)
        _ask(device, device_bytes(assembled, elements, cases, solver.multigrid), system)
        operator = upload_operator(arena, assembled, elements, system.scale, cases)
        ready = solver.multigrid.upload(arena, operator, cases)
        loop = DeviceCG(arena, operator, ready, cases)
        clock.mark("upload")
        outcome = solver.iterated(system, loop, lowest, options)
        clock.mark("iterations")
        return replace(outcome, backend="gpu", real=arena.real)


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


def device_bytes(
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
