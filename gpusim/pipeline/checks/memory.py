"""Whether the memory of this machine is enough for a plan: asked before anything is allocated."""

from __future__ import annotations

from gpusim.errors import InputError
from gpusim.parallel.main_memory import host_memory
from gpusim.plan.plan import Plan
from gpusim.scene import Scene
from gpusim.scene.cost import element_counts

__all__ = ["check_memory", "memory_fault", "mesh_fault"]

_DOUBT = 2.0  # the plan's estimates may be this far off
_LEAST = 256_000_000  # bytes that libraries map besides; OpenBLAS can hang with less
_BUILT = 600  # bytes per node of a mesh, its faces and its surface while they are made


def check_memory(plan: Plan) -> None:
    """Raises InputError naming the first stage that can't fit the free memory."""
    if fault := memory_fault(plan):
        raise InputError(fault)


def memory_fault(plan: Plan) -> str:
    """The same as a sentence; "" for a plan that fits."""
    free = host_memory()
    if free < _LEAST:
        return (
            f"memory: got {free / 1e6:.0f} MB free (of the machine, the container or ulimit -v); "
            f"expected at least {_LEAST / 1e6:.0f} MB"
        )
    for stage in plan.stages:
        if not stage.memory_bytes <= _DOUBT * free:
            return (
                f"{stage.name}: needs about {stage.memory_bytes / 1e9:.3g} GB of memory "
                f"({stage.detail}); got {free / 1e9:.3g} GB free; expected a smaller scene"
            )
    return ""


def mesh_fault(scene: Scene) -> str:
    """Why the meshes and surfaces of ``scene`` can't be built to look at; "" if they fit."""
    free = host_memory()
    nodes = sum(element_counts(body.mesh)[0] for body in scene.bodies)
    if _BUILT * nodes <= free:
        return ""
    return (
        f"the scene's geometry was not looked at: meshes of {nodes:,} nodes need about "
        f"{_BUILT * nodes / 1e9:.3g} GB of memory, {free / 1e9:.3g} GB are free"
    )
