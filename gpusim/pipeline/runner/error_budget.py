"""The error budget: one scene imaged and measured with and without each effect."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from os import PathLike
from pathlib import Path
from typing import Any, Literal

from gpusim.errors import InputError
from gpusim.files.output_folder import claim, inside
from gpusim.pipeline.runner.run import run, run_claimed
from gpusim.plan.stages import RunOptions
from gpusim.report import Budget, BudgetRow, Measurement, Report, write_report
from gpusim.scene import Scene
from gpusim.scene.sources import active_sources, with_only, without_sources

__all__ = ["run_budget"]

Progress = Callable[[str, float, str], None]
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
    if scene.variants or not scene.measures:
        got = f"{len(scene.variants)} variants, {len(scene.measures)} measures"
        raise InputError(f"budget: scene {scene.name!r}; got {got}; expected [[measure]], no "
                         "[[variant]]")  # fmt: skip
    document = scene.document
    effects = active_sources(document)
    if not effects:
        raise InputError(
            f"budget: scene {scene.name!r}; got none of the effects that a budget is made of; "
            "expected light, noise, a lens, a shutter or fewer than 16 bits"
        )
    states: list[tuple[State, str, dict[str, Any]]] = [("none", "", with_only(document, []))]
    states += [("only", name, with_only(document, [name])) for name in effects]
    states += [("no", name, without_sources(document, [name])) for name in effects]
    with claim(out) as folder:
        return _budget(scene, folder, states, backend, progress)


def _budget(
    scene: Scene,
    out: Path,
    states: Sequence[tuple[State, str, dict[str, Any]]],
    backend: str,
    progress: Progress | None,
) -> Report:
    """As `run_budget`, into a folder that the caller has claimed."""
    tell = progress or (lambda stage, done, text: None)
    whole = run_claimed(scene, out, RunOptions(backend), tell)
    quantities = _counted(scene, whole.measurements)
    rows = [BudgetRow("all", "", tuple(abs(item.error) for item in quantities))]
    folder = inside(out, FOLDER)
    for number, (state, name, changed) in enumerate(states):
        words = f"{state} {name}".strip()
        if progress is not None:
            progress("budget", number / len(states), words)
        own = Scene.from_document(
            _lean(changed), source=f"{scene.source}, {words}", files=scene.files
        )
        measured = run(own, folder, backend=backend).measurements
        found = {item.name: abs(item.error) for item in measured}
        errors = tuple(found.get(item.name, float("nan")) for item in quantities)
        rows.append(BudgetRow(state, name, errors))
    budget = Budget(tuple((item.name, item.unit) for item in quantities), tuple(rows))
    report = replace(whole, budget=budget)
    write_report(report, out)
    if progress is not None:
        progress("budget", 1.0, f"{len(states) + 1} states of {(len(states) - 1) // 2} effects")
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
    output |= {"truth": [], "vtu": False, "stl": False, "stress": False}
    return document
