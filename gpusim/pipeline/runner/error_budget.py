"""The error budget: one scene imaged and measured with and without each effect."""

from __future__ import annotations

from collections.abc import Sequence
from os import PathLike

from gpusim.pipeline.runner.effect_states import EffectStates, check_comparable, documents_of_states
from gpusim.pipeline.runner.stage_log import Progress
from gpusim.report import Budget, BudgetRow, Measurement, Report
from gpusim.scene import Scene
from gpusim.scene.effects import active_effects, lenses_of_files
from gpusim.validation import require

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
        The scene measures nothing, has variants, settings that each state would choose anew, or no
        such effect.
    GpusimError
        As `gpusim.pipeline.run`, for any of the states.
    """
    where, document = f"budget: scene {scene.name!r}", scene.document
    check_comparable(scene, where, scene.measures)
    effects = active_effects(document)
    expected = "light, noise, a lens, a shutter or fewer than 16 bits"
    require(len(effects) > 0, where, "none of the effects that a budget is made of", expected)
    states = EffectStates(FOLDER, effects, documents_of_states(document, effects))
    execution = states.run(scene, out, backend, progress)
    quantities = _counted(scene, execution.reports[""].measurements)
    rows = [BudgetRow("all", "", tuple(abs(item.error) for item in quantities))]
    for state, name in states.documents:
        report = execution.reports[states.place(state, name)]
        found = {item.name: abs(item.error) for item in report.measurements}
        errors = tuple(found.get(item.name, float("nan")) for item in quantities)
        rows.append(BudgetRow(state, name, errors))
    remarks = tuple(
        f"Distortion of camera {camera!r} stays in every state: measure {measure!r} undoes it by "
        "what its calibration file says of the lens."
        for camera, measure in lenses_of_files(document).items()
    )
    budget = Budget(tuple((item.name, item.unit) for item in quantities), tuple(rows), remarks)
    return states.told(execution, budget=budget)


def _counted(scene: Scene, items: Sequence[Measurement]) -> list[Measurement]:
    """What stands in the budget: the first number of each measure, and its RMS error."""
    result = []
    for spec in scene.measures:
        own = [item for item in items if item.name.startswith(f"{spec.name}: ")]
        result += own[:1] + [item for item in own[1:] if "RMS error" in item.name]
    return result
