"""A part of a scene's run, into a folder of its own: what a preview, or an object, needs."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

from gpusim.errors import InputError
from gpusim.graph.graph import Task
from gpusim.graph.runner import Observer, Runner, StageFailed
from gpusim.graph.session import Session
from gpusim.plan.decision import decide
from gpusim.plan.scene_stages import scene_stages
from gpusim.plan.stages import RunOptions
from gpusim.scene import Scene


@contextmanager
def part_runner(
    scene: Scene, out: Path, options: RunOptions, targets: Collection[str], observe: Observer
) -> Iterator[Runner]:
    """What makes the ``targets``, names of stages, and what they need, into ``out``; it is told to.

    Raises what a stage raises.
    """
    decision = decide({"": scene}, out, options, targets=targets)
    assert decision.store is not None
    session = Session(options)
    try:
        yield Runner(decision.graph, decision.store, decision.folders, session, observe)
    except StageFailed as failed:
        raise failed.__cause__ or failed from None
    finally:
        decision.folders[""].close()
        decision.store.close()


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

    def observe(task: Task, done: float, words: str) -> None:
        if task.stage.name in shares:
            low, high = shares[task.stage.name]
            progress(low + done * (high - low), words or task.stage.name)

    options = RunOptions("gpu")
    with part_runner(scene, out, options, shares, observe) as runner:
        if not any(stage in runner.graph.records[""] for stage in shares):
            reasons = scene_stages(scene, options).skipped
            why = next((reasons[stage] for stage in shares if stage in reasons), "nothing to do")
            raise InputError(f"{', '.join(shares)}: {why}; expected something to be made")
        runner.work(lambda place: None)
