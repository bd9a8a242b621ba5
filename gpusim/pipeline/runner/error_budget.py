"""The error budget: one scene imaged and measured with and without each effect."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from os import PathLike
from typing import Any, Literal

from gpusim.files.output_folder import claim
from gpusim.gpu import chosen_backend
from gpusim.pipeline.checks.resources import check_folders
from gpusim.pipeline.runner.execution import Execution
from gpusim.pipeline.runner.stage_log import Progress, silent
from gpusim.pipeline.runner.variants import work_off
from gpusim.plan.stages import RunOptions
from gpusim.report import Budget, BudgetRow, Measurement, Report, write_report
from gpusim.scene import Scene
from gpusim.scene.sources import active_sources, with_only, without_sources
from gpusim.validation import require

State = Literal["all", "none", "only", "no"]
FOLDER = "budget"


def run_budget(
    scene: Scene,
    out: str | PathLike[str],
    *,
    backend: str = "auto",
    progress: Progress | None = None,
) -> Report:
    """Run ``scene`` into ``out``, then its states in ``out/budget``; the report has the table.

    The states are: none of the effects of `gpusim.scene.sources`, each of them alone, and all but
    each. They share one solution. Of each measure its first number and its RMS errors count.

    Raises
    ------
    InputError
        The scene measures nothing, has variants, or has no such effect.
    GpusimError
        As `gpusim.pipeline.run`, for any of the states.
    """
    fits, where = bool(scene.measures) and not scene.variants, f"budget: scene {scene.name!r}"
    got = f"{len(scene.variants)} variants, {len(scene.measures)} measures"
    require(fits, where, got, "[[measure]], no [[variant]]")
    document = scene.document
    effects = active_sources(document)
    expected = "light, noise, a lens, a shutter or fewer than 16 bits"
    require(len(effects) > 0, where, "none of the effects that a budget is made of", expected)
    states: list[tuple[State, str, dict[str, Any]]] = [("none", "", with_only(document, []))]
    states += [("only", name, with_only(document, [name])) for name in effects]
    states += [("no", name, without_sources(document, [name])) for name in effects]
    scenes = {"": scene}
    for state, name, changed in states:
        words = f"{state} {name}".strip()
        scenes[f"{FOLDER}/{words.replace(' ', '-')}"] = Scene.from_document(
            _lean(changed), source=f"{scene.source}, {words}", files=scene.files
        )
    options = RunOptions(chosen_backend("run", backend))
    with claim(out) as folder:
        check_folders(scene, folder)
        execution = Execution(scene, scenes, folder, options, progress or silent)
        work_off(execution)
    return _budget(scene, execution, states)


def _budget(scene: Scene, execution: Execution, states: Sequence[tuple[State, str, Any]]) -> Report:
    """The table of a work that is done, in the scene's report."""
    whole = execution.reports[""]
    quantities = _counted(scene, whole.measurements)
    rows = [BudgetRow("all", "", tuple(abs(item.error) for item in quantities))]
    made = [execution.reports[place] for place in execution.decision.scenes if place]
    for (state, name, _), report in zip(states, made, strict=True):
        found = {item.name: abs(item.error) for item in report.measurements}
        errors = tuple(found.get(item.name, float("nan")) for item in quantities)
        rows.append(BudgetRow(state, name, errors))
    budget = Budget(tuple((item.name, item.unit) for item in quantities), tuple(rows))
    report = replace(whole, budget=budget)
    write_report(report, execution.out)
    effects = (len(states) - 1) // 2
    execution.log.tell("budget", 1.0, f"{len(states) + 1} states of {effects} effects")
    return report


def _counted(scene: Scene, items: Sequence[Measurement]) -> list[Measurement]:
    """What stands in the budget: the first number of each measure, and its RMS error."""
    result = []
    for spec in scene.measures:
        own = [item for item in items if item.name.startswith(f"{spec.name}: ")]
        result += own[:1] + [item for item in own[1:] if "RMS error" in item.name]
    return result


def _lean(document: dict[str, Any]) -> dict[str, Any]:
    """The document without files that a budget has no use for."""
    output = document.setdefault("output", {})
    output |= {"truth": [], "vtu": False, "stl": False, "stress": False, "calibration": [],
               "fields": False}  # fmt: skip
    return document
