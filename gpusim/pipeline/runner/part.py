"""A part of a scene's run, into a folder of its own: what a preview needs."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

from gpusim.errors import InputError
from gpusim.graph.graph import Task
from gpusim.graph.runner import Runner, StageFailed
from gpusim.graph.session import Session
from gpusim.plan.decision import decide
from gpusim.plan.stages import RunOptions
from gpusim.scene import Scene


def make_part(
    scene: Scene,
    shares: Mapping[str, tuple[float, float]],
    out: Path,
    progress: Callable[[float, str], None],
) -> None:
    """Make the stages that ``shares`` names, and what they need, into ``out``.

    ``shares``: from where to where of the whole a stage is. ``progress`` is called with (0..1,
    text). Raises what a stage raises.
    """
    decision = decide({"": scene}, out, RunOptions("gpu"), targets=shares)
    assert decision.store is not None
    made = decision.graph.records[""]
    if not any(stage in made for stage in shares):
        reasons = decision.stages[""].skipped
        why = next((reasons[stage] for stage in shares if stage in reasons), "nothing to do")
        raise InputError(f"{', '.join(shares)}: {why}; expected something to be made")

    def observe(task: Task, done: float, words: str) -> None:
        if task.stage.name in shares:
            low, high = shares[task.stage.name]
            progress(low + done * (high - low), words or task.stage.name)

    runner = Runner(
        decision.graph, decision.store, decision.folders, Session(decision.options), observe
    )
    try:
        runner.work(lambda place: None)
    except StageFailed as failed:
        raise failed.__cause__ or failed from None
    finally:
        decision.folders[""].close()
        decision.store.close()
