"""The error budget: one scene imaged and measured with and without each effect."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
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
from gpusim.scene.effects import active_effects, with_only, without_effects
from gpusim.validation import require

State = Literal["all", "none", "only", "no"]
States = Mapping[tuple[State, str], dict[str, Any]]
"""Documents by what their pictures have of the effects: "no" or "only" the one of a name."""
FOLDER = "budget"


def run_budget(
    scene: Scene,
    out: str | PathLike[str],
    *,
    backend: str = "auto",
    progress: Progress | None = None,
) -> Report:
    """Run ``scene`` into ``out``, then its states in ``out/budget``; the report has the table.

    The states are: none of the effects of `gpusim.scene.effects`, each of them alone, and all but
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
    effects = active_effects(document)
    expected = "light, noise, a lens, a shutter or fewer than 16 bits"
    require(len(effects) > 0, where, "none of the effects that a budget is made of", expected)
    states = states_of_effects(document, effects)
    return _budget(scene, run_states(scene, out, FOLDER, states, backend, progress), states)


def states_of_effects(
    document: dict[str, Any], effects: Sequence[str], kept: Sequence[str] = ()
) -> States:
    """Documents without any of the ``effects``, with each of them alone, and with all but each;
    those that are ``kept`` are in all of them."""
    return {
        ("none", ""): with_only(document, kept),
        **{("only", name): with_only(document, [name, *kept]) for name in effects},
        **{("no", name): without_effects(document, [name]) for name in effects},
    }


def place_of(folder: str, state: State, name: str) -> str:
    """Where in the output folder a state is run."""
    return f"{folder}/{f'{state} {name}'.strip().replace(' ', '-')}"


def run_states(
    scene: Scene,
    out: str | PathLike[str],
    folder: str,
    states: States,
    backend: str,
    progress: Progress | None,
    draws: bool = True,
) -> Execution:
    """Run ``scene`` into ``out``, and its states into a ``folder`` there, with figures or not."""
    scenes = {"": scene}
    for (state, name), changed in states.items():
        place = place_of(folder, state, name)
        scenes[place] = Scene.from_document(
            _lean(changed), source=f"{scene.source}, {state} {name}".strip(), files=scene.files
        )
    options = RunOptions(chosen_backend("run", backend))
    with claim(out) as claimed:
        check_folders(scene, claimed)
        execution = Execution(scene, scenes, claimed, options, progress or silent,
                              draws=draws)  # fmt: skip
        work_off(execution)
    return execution


def _budget(scene: Scene, execution: Execution, states: States) -> Report:
    """The table of a work that is done, in the scene's report."""
    whole = execution.reports[""]
    quantities = _counted(scene, whole.measurements)
    rows = [BudgetRow("all", "", tuple(abs(item.error) for item in quantities))]
    for state, name in states:
        report = execution.reports[place_of(FOLDER, state, name)]
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
