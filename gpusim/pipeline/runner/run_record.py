"""What a run knows of its stages, those whose results it reused too, and what it says of itself."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from gpusim._version import __version__
from gpusim.gpu import Device
from gpusim.pipeline.build.scene_objects import SceneObjects
from gpusim.pipeline.checks.warnings import SceneWarnings
from gpusim.pipeline.measurements.measurements import Result
from gpusim.pipeline.notes import Notes
from gpusim.pipeline.runner.mechanics_report import make_mechanics
from gpusim.pipeline.runner.run_report import Findings, make_report
from gpusim.plan.stages import Plan, RunOptions
from gpusim.plan.state import StateFile
from gpusim.report import Mechanics, Report, SolutionSummary, Stage
from gpusim.scene import Scene
from gpusim.scene.amplitudes import LoadHistory

if TYPE_CHECKING:
    from gpusim.fem import Model
    from gpusim.pipeline.stages.stresses import Stresses

__all__ = ["ON_DEVICE", "RunRecord", "device_seconds"]

ON_DEVICE = ("solve", "render", "truth")
"""Kinds of stages that work on the device."""


class RunRecord:
    """A scene's run so far: its plan, what was built and found, and what is to be said of it."""

    plan: Plan

    def __init__(self, scene: Scene, out: Path, options: RunOptions) -> None:
        # absolute: the state file takes relative names as names inside the folder
        self.scene, self.out, self.options = scene, out.resolve(), options
        self.history = LoadHistory(scene, scaled=options.skip)
        self.state = StateFile(self.out)
        self.stages: list[Stage] = []
        self.warnings: list[str] = []
        self.scene_warnings = SceneWarnings()
        self.notes: dict[str, Notes] = {}
        self.objects = SceneObjects(scene, self.history)
        self.models: list[Model] = []
        self.stresses: Stresses | None = None
        self.results: list[Result] = []
        self.device: Device | None = None
        self.seconds: dict[str, str] = {}

    @property
    def own_adapter(self) -> str:
        """What this run makes results on."""
        return "none (numpy backend)" if self.device is None else self.device.name

    def report(self, failure: str = "") -> Report:
        """The report of a run that has come to its end, or to a ``failure``."""
        solved, summary = self.objects.solved, None
        if solved is not None:
            summary = SolutionSummary(
                solved.unknowns, solved.iterations, solved.converged, solved.error_estimate,
                solved.facts["method"],
            )  # fmt: skip
        return make_report(
            self.scene,
            self.out,
            Findings(
                adapter=self._adapters(),
                stages=tuple(self.stages),
                summary=summary,
                solved=solved,
                mechanics=self._mechanics(),
                meshes=self.notes.get("mesh", Notes()).meshes,
                results=() if failure else tuple(self.results),
                warnings=self._warnings(),
                failure=failure,
                files=frozenset(
                    file for stage in self.plan.stages for file in self.state.files(stage.key)
                ),
                facts=self._facts(),
            ),
        )

    def scene_text(self) -> str:
        """The resolved scene, and what it was run with."""
        head = f"# resolved by gpusim {__version__}; adapter: {self._adapters()}\n"
        return head + self.scene.to_toml()

    def _adapters(self) -> str:
        """What the results were made on, by this run or before it."""
        made = [
            self.own_adapter if stage.runs else self.notes.get(stage.name, Notes()).adapter
            for stage in self.plan.stages
            if stage.state != "skipped" and stage.name.split("/")[0] in ON_DEVICE
        ]
        return "; ".join(dict.fromkeys(filter(None, made))) or "not needed"

    def _mechanics(self) -> Mechanics | None:
        if self.objects.solved is None:
            return None
        peaks = () if self.stresses is None else self.stresses.peaks
        return make_mechanics(self.scene, self.objects.solved, self.history, peaks)

    def _warnings(self) -> tuple[str, ...]:
        solved = self.objects.solved
        return (
            *self.plan.warnings,
            *(solved.warnings if solved else ()),
            *self.scene_warnings.notes(solved).warnings,
            *self.warnings,
            *(text for result in self.results for text in result.warnings),
            *(text for notes in self._noted() for text in notes.warnings),
        )

    def _facts(self) -> dict[str, str]:
        facts = dict(self.scene_warnings.notes(self.objects.solved).facts)
        for notes in self._noted():
            facts |= notes.facts
        return facts | self.seconds

    def _noted(self) -> list[Notes]:
        """In the order of the stages, whether they ran or not."""
        return [self.notes[stage.name] for stage in self.plan.stages if stage.name in self.notes]


def device_seconds(device: Device, before: dict[str, float]) -> dict[str, str]:
    """What a run took on the device, by stage; the device may be older than the run."""
    spent = {
        name: seconds - before.get(name, 0.0)
        for name, seconds in sorted(device.timer.seconds().items())
    }
    return {f"device: {name}": f"{value:.2f} s" for name, value in spent.items() if value > 0.0}
