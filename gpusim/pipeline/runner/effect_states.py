"""A scene with and without each of its effects: the states that error budgets and explanations of
fields run and compare.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from os import PathLike
from typing import Any, Literal

from gpusim.files.output_folder import claim
from gpusim.gpu import chosen_backend
from gpusim.pipeline.checks.resources import check_folders
from gpusim.pipeline.runner.execution import Execution
from gpusim.pipeline.runner.stage_log import Progress, silent
from gpusim.pipeline.runner.variants import work_off
from gpusim.plan.stages import RunOptions
from gpusim.report import Report, write_report
from gpusim.scene import Scene
from gpusim.scene.description.measure_table import MeasureTable
from gpusim.scene.effects import with_only, without_effects
from gpusim.validation import require

LEAN = {"truth": [], "vtu": False, "stl": False, "stress": False, "calibration": [],
        "fields": False}  # fmt: skip
"""Of [output], in states: files that nobody needs of them, as their films."""
State = Literal["none", "only", "no"]
Documents = Mapping[tuple[State, str], dict[str, Any]]
"""Of scenes, by what their pictures have of the effects: "no" or "only" the one of a name."""


def check_comparable(
    scene: Scene, where: str, measures: Sequence[MeasureTable], kind: str = "", instead: str = ""
) -> None:
    """Raise InputError unless states of the ``scene`` can be compared by ``measures``, all that it
    has of a ``kind``; ``instead``: what there is for others, in words."""
    got = f"{len(scene.variants)} variants, {len(measures)} measures{kind}"
    fits = bool(measures) and not scene.variants
    require(fits, where, got, f"[[measure]]{kind}, no [[variant]]{instead}")
    # each state's pictures would choose others
    fixed = all(getattr(spec, "settings", None) is None for spec in measures)
    require(fixed, where, 'settings = "best"', "the subset and the others that its report names")


def documents_of_states(
    document: dict[str, Any], effects: Sequence[str], kept: Sequence[str] = ()
) -> Documents:
    """Without any of the ``effects``, with each of them alone, and with all but each; those that
    are ``kept`` are in all of them."""
    return {
        ("none", ""): with_only(document, kept),
        **{("only", name): with_only(document, [name, *kept]) for name in effects},
        **{("no", name): without_effects(document, [name]) for name in effects},
    }


@dataclass(frozen=True)
class EffectStates:
    """States of a scene that differ in its ``effects``, run in a ``folder`` of its output."""

    folder: str
    effects: Sequence[str]
    documents: Documents

    def place(self, state: State, name: str) -> str:
        """Where in the output folder a state is run."""
        return f"{self.folder}/{f'{state} {name}'.strip().replace(' ', '-')}"

    def run(
        self, scene: Scene, out: str | PathLike[str], backend: str, progress: Progress | None,
        draws: bool = True,
    ) -> Execution:  # fmt: skip
        """Run ``scene`` into ``out``, and its states, whose reports have figures or not."""
        options = RunOptions(chosen_backend("run", backend))
        with claim(out) as claimed:
            check_folders(scene, claimed)
            execution = Execution(scene, self.scenes(scene), claimed, options, progress or silent,
                                  draws=draws)  # fmt: skip
            work_off(execution)
        return execution

    def scenes(self, scene: Scene) -> dict[str, Scene]:
        """``scene``, and its states by where they are run."""
        scenes = {"": scene}
        for (state, name), document in self.documents.items():
            lean = {**document, "output": document.get("output", {}) | LEAN}
            if "video" in document:  # which says how pictures are taken
                lean["video"] = document["video"] | {"cameras": []}
            source = f"{scene.source}, {state} {name}".strip()
            scenes[self.place(state, name)] = Scene.from_document(
                lean, source=source, files=scene.files
            )
        return scenes

    def told(self, execution: Execution, **sections: Any) -> Report:
        """The scene's report with more ``sections``, written."""
        report = replace(execution.reports[""], **sections)
        write_report(report, execution.out)
        states = len(self.documents) + 1
        execution.log.tell(self.folder, 1.0, f"{states} states of {len(self.effects)} effects")
        return report
