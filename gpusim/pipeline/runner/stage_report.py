"""What a run says of itself: of stages that it ran, and of those whose results it reused."""

from __future__ import annotations

from typing import TYPE_CHECKING

from gpusim._version import __version__
from gpusim.gpu import Device
from gpusim.pipeline.notes import Notes
from gpusim.pipeline.runner.mechanics_report import make_mechanics
from gpusim.pipeline.runner.run_report import Findings, make_report
from gpusim.report import Mechanics, Report, SolutionSummary

if TYPE_CHECKING:
    from gpusim.pipeline.runner.stage_runner import Work

__all__ = ["ON_DEVICE", "device_seconds", "scene_text", "work_report"]

ON_DEVICE = ("solve", "render", "truth")
"""Kinds of stages that work on the device."""


def work_report(work: Work, failure: str = "") -> Report:
    """The report of a run that has come to its end, or to a ``failure``."""
    solved, summary = work.things.solved, None
    if solved is not None:
        summary = SolutionSummary(
            solved.unknowns, solved.iterations, solved.converged, solved.error_estimate,
            solved.facts["method"],
        )  # fmt: skip
    return make_report(
        work.scene,
        work.out,
        Findings(
            adapter=_adapters(work),
            stages=tuple(work.stages),
            summary=summary,
            solved=solved,
            mechanics=_mechanics(work),
            meshes=work.notes.get("mesh", Notes()).meshes,
            results=() if failure else tuple(work.results),
            warnings=_warnings(work),
            failure=failure,
            files=frozenset(
                file for stage in work.plan.stages for file in work.state.files(stage.key)
            ),
            facts=_facts(work),
        ),
    )


def scene_text(work: Work) -> str:
    """The resolved scene, and what it was run with."""
    head = f"# resolved by gpusim {__version__}; adapter: {_adapters(work)}\n"
    return head + work.scene.to_toml()


def device_seconds(device: Device, before: dict[str, float]) -> dict[str, str]:
    """What a run took on the device, by stage; the device may be older than the run."""
    spent = {
        name: seconds - before.get(name, 0.0)
        for name, seconds in sorted(device.timer.seconds().items())
    }
    return {f"device: {name}": f"{value:.2f} s" for name, value in spent.items() if value > 0.0}


def _adapters(work: Work) -> str:
    """What the results were made on, by this run or before it."""
    made = [
        work.own_adapter if stage.runs else work.notes.get(stage.name, Notes()).adapter
        for stage in work.plan.stages
        if stage.state != "skipped" and stage.name.split("/")[0] in ON_DEVICE
    ]
    return "; ".join(dict.fromkeys(filter(None, made))) or "not needed"


def _mechanics(work: Work) -> Mechanics | None:
    if work.things.solved is None:
        return None
    peaks = () if work.stresses is None else work.stresses.peaks
    return make_mechanics(work.scene, work.things.solved, work.history, peaks)


def _warnings(work: Work) -> tuple[str, ...]:
    solved = work.things.solved
    return (
        *work.plan.warnings,
        *(solved.warnings if solved else ()),
        *work.doubts.notes(solved).warnings,
        *work.warnings,
        *(text for result in work.results for text in result.warnings),
        *(text for notes in _noted(work) for text in notes.warnings),
    )


def _facts(work: Work) -> dict[str, str]:
    facts = dict(work.doubts.notes(work.things.solved).facts)
    for notes in _noted(work):
        facts |= notes.facts
    return facts | work.seconds


def _noted(work: Work) -> list[Notes]:
    """In the order of the stages, whether they ran or not."""
    return [work.notes[stage.name] for stage in work.plan.stages if stage.name in work.notes]
