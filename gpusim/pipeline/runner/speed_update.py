"""What a run says of the speed of the machine and its device."""

from __future__ import annotations

from collections.abc import Sequence

from gpusim.plan.machine_speed import Speed
from gpusim.plan.plan import Plan
from gpusim.report import Stage

__all__ = ["learn"]


def learn(speed: Speed, plan: Plan, stages: Sequence[Stage], adapter: str) -> None:
    """Keep how long the ``stages`` of a finished run took, for later plans."""
    seconds = {stage.name: stage.seconds for stage in stages}
    spent: dict[str, float] = {}
    for planned in plan.stages:
        if planned.runs and planned.name in seconds:
            spent[planned.kind] = spent.get(planned.kind, 0.0) + seconds[planned.name]
    done = {work: spent[work.kind] for work in plan.works if work.kind in spent}
    if done:
        speed.learn(done, adapter)
        speed.save()
