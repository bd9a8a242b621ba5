"""Whether the memory of this machine is enough for a plan: asked before anything is allocated."""

from __future__ import annotations

from gpusim.errors import InputError
from gpusim.gpu.host import host_memory
from gpusim.plan import Plan

__all__ = ["check_memory"]

_DOUBT = 2.0  # the plan's estimates may be this far off


def check_memory(plan: Plan) -> None:
    """Raises InputError naming the first stage that can't fit the free memory."""
    free = host_memory()
    for stage in plan.stages:
        if not stage.memory_bytes <= _DOUBT * free:
            raise InputError(
                f"{stage.name}: needs about {stage.memory_bytes / 1e9:.3g} GB of memory "
                f"({stage.detail}); got {free / 1e9:.3g} GB free; expected a smaller scene"
            )
