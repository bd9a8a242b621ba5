"""What a run says of the speed of the machine and its device."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from gpusim.plan import Plan
from gpusim.report import Stage
from gpusim.speed import Speed

__all__ = ["learn", "spent_since"]


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


def spent_since(before: Mapping[str, float], now: Mapping[str, float]) -> dict[str, float]:
    """Seconds by stage that a device spent after ``before``; it may be older than the run."""
    spent = {name: seconds - before.get(name, 0.0) for name, seconds in now.items()}
    return {name: seconds for name, seconds in spent.items() if seconds > 0.0}
