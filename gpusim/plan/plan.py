"""A decision in words, seconds and bytes: what ``gpusim plan`` prints, and a run goes by."""

from __future__ import annotations

from dataclasses import replace
from os import PathLike
from pathlib import Path

from gpusim.graph.stage import digest
from gpusim.plan.decision import Decision, PublicStage, decide, states_of
from gpusim.plan.machine_speed import Speed, Workload
from gpusim.plan.scene_stages import TARGET
from gpusim.plan.stages import Plan, PlannedStage, RunOptions, timed, works_of
from gpusim.scene import Scene, plausibility
from gpusim.scene import cost as cost_of
from gpusim.scene.cost import Counts
from gpusim.scene.description.model import CameraTable
from gpusim.scene.frames import Shown

__all__ = ["Plan", "PlannedStage", "make_plan", "plan_of"]


def make_plan(
    scene: Scene,
    out: str | PathLike[str] | None = None,
    backend: str = "auto",
    *,
    fresh: bool = False,
    skip: bool = True,
    store: str | PathLike[str] | None = None,
    verify: bool = False,
    speed: Speed | None = None,
    made: Counts | None = None,
) -> Plan:
    """Decide every stage of a run of ``scene`` into ``out`` (None: nothing can be reused).

    ``fresh`` ignores the results in ``out``. ``skip=False`` switches every shortcut off as well:
    nothing is reused, and what the loads make trivial is computed all the same; outputs that the
    scene doesn't ask for are not made. ``store``, ``verify``: as `gpusim.run` has them. ``speed``:
    of the machine, for the seconds; None: those of the machine that the costs were measured on.
    ``made``: how large meshes are that were made; others are guessed.
    """
    from gpusim.gpu import chosen_backend

    options = RunOptions(chosen_backend("plan", backend), fresh, skip)
    folder = None if out is None else Path(out)
    shared = None if store is None else Path(store)
    decision = decide(states_of(scene), folder, options, shared, verify)
    return plan_of(scene, decision, speed, made)


def plan_of(
    scene: Scene, decision: Decision, speed: Speed | None = None, made: Counts | None = None
) -> Plan:
    """A decision in words and figures; with variants stages are named ``<variant>/<stage>``, and
    their comparison comes last. ``made``: as `make_plan` has it."""
    stages: list[PlannedStage] = []
    works: list[Workload] = []
    for place, state in decision.scenes.items():
        compiled = any(stage.compiling for stage in stages)  # by one process, once
        plan = _ScenePlan(state, place, decision, speed, compiled, made=made).plan()
        prefix = f"{place.removeprefix('variants/')}/" if place else ""
        stages += plan.stages if not prefix else [
            replace(stage, name=f"{prefix}{stage.name}") for stage in plan.stages
        ]  # fmt: skip
        works += plan.works
    if scene.variants:
        alone = {spec.name for state in decision.scenes.values() for spec in state.measures}
        stages += [
            PlannedStage(spec.name, "run", "compares the variants", 0, 0.1, spec.name)
            for spec in scene.measures if spec.name not in alone
        ]  # fmt: skip
        stages.append(PlannedStage("report", "run", "says what this run did", 0, 1.0, "report"))
        works = []
    warnings = tuple(plausibility.warnings(scene))
    return Plan(scene.name, decision.options.backend, tuple(stages), warnings, tuple(works))


class _ScenePlan:
    """The plan of one scene of a decision."""

    def __init__(
        self, scene: Scene, place: str, decision: Decision, speed: Speed | None, compiled: bool,
        *, made: Counts | None,
    ) -> None:  # fmt: skip
        self.scene, self.place, self.decision = scene, place, decision
        self.speed, self.compiled = speed, compiled
        self.frames = decision.stages[place].frames
        self.seen: set[str] = set()  # radiances of the pictures before
        self.cost = cost_of.estimate(scene, made)
        self.details = cost_of.describe(scene, made)
        states = [state for shown in (one.shown for one in self.frames) for state in shown.states]
        cases = max((len(state) for state in states if state is not None), default=1)
        if cases > 1 and scene.analysis.scales_loads:
            self.details["solve"] += f", {cases} load cases"

    def plan(self) -> Plan:
        stages = [self._stage(one) for one in self.decision.public(self.place)]
        everything = [stage.key for stage in stages]
        _, seconds = self.cost["report"]
        stages.append(
            PlannedStage("report", "run", "says what this run did", self.cost["report"][0], seconds,
                         digest(["report", self.scene.name, self.scene.description, everything]),
                         self.details.get("report", ""))
        )  # fmt: skip
        works = works_of(stages, self._size())
        if self.speed is not None:
            stages = timed(stages, works, self.speed)
        return Plan(self.scene.name, "", tuple(stages), works=tuple(works.values()))

    def _stage(self, public: PublicStage) -> PlannedStage:
        """With its cost, which counts only if it is run."""
        kind, *picture = public.name.split("/")
        kind = "truth file" if public.name == "truth" else kind
        memory, seconds = self.cost[kind] if public.runs else (0, 0.0)
        detail = self.details.get(kind, "") if public.runs else ""
        key = digest([public.name, [task.key for task in public.tasks]])
        stage = PlannedStage(public.name, public.state, public.reason, memory, seconds, key, detail)
        return self._picture(stage, *picture) if public.name.startswith("render/") else stage

    def _picture(self, stage: PlannedStage, name: str, number: str) -> PlannedStage:
        """Of a frame, or of a calibration target, by the camera of that ``name``."""
        camera = next(one for one in self.scene.cameras if one.name == name)
        if number.startswith(TARGET):
            stage = replace(stage, camera=name, pose=int(number.removeprefix(TARGET)))
            what = "target and its corners" if self.scene.measures_space else "target"
            seconds = cost_of.target_seconds(camera)
            return self._described(stage, camera, seconds, what) if stage.runs else stage
        frame = int(number)
        radiance = self.decision.graph.records[self.place][f"radiance/{name}"][frame]
        what, seconds = self._words(self.frames[frame].shown, frame), stage.seconds
        if radiance in self.seen and self.decision.options.skip:
            what += " as before: exposed again"
            seconds = cost_of.exposing_seconds(camera)
        self.seen.add(radiance)
        stage = replace(stage, camera=name, frame=frame)
        what = f"{cost_of.effects(self.scene, camera)}, {what}"
        return self._described(stage, camera, seconds, what) if stage.runs else stage

    def _words(self, shown: Shown, number: int) -> str:
        """The different weights of a frame, in the order in which bodies have them."""
        if not self.scene.analysis.scales_loads:
            return self.scene.analysis.frame_text(number)
        weights = [weight for state in shown.states for weight in state or (0.0,)]
        weights = list(dict.fromkeys(weights)) or [self.frames[number].factor]
        return f"load x {', '.join(f'{weight:g}' for weight in weights)}"

    def _described(
        self, stage: PlannedStage, camera: CameraTable, seconds: float, what: str
    ) -> PlannedStage:
        """What a picture takes, and what it is, compilation included."""
        columns, rows = camera.resolution
        compiling, words = self._compiling()
        detail = f"{columns}x{rows} px, {stage.detail}, {what}{words}"
        return replace(stage, detail=detail, seconds=seconds + compiling, compiling=compiling)

    def _compiling(self) -> tuple[float, str]:
        """Seconds and words for the shaders, of the first image that is drawn."""
        options, store = self.decision.options, self.decision.store
        if options.backend == "numpy" or self.compiled:
            return 0.0, ""
        self.compiled = True
        kept = bool(self.speed and self.speed.adapter) or (store is not None and store.begun)
        words = "loaded" if kept else "compiled, unless the driver has kept them"
        return cost_of.compiling_seconds(self.scene, kept), f"; shaders are {words}"

    def _size(self) -> str:
        """What the time of any stage may depend on, in words."""
        scene = self.scene
        cameras = [
            f"{camera.resolution}, {cost_of.effects(scene, camera)}" for camera in scene.cameras
        ]
        measures = [
            f"{type(measure).__name__}, {measure.seconds(1, 1, 2):.2e}"
            for measure in scene.measures
        ]
        return "; ".join([*self.details.values(), *cameras, *measures, str(len(self.frames))])
