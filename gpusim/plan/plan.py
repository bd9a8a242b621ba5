"""The one decision, before any work: which stages are run, skipped or reused, why, at what cost.

A stage's key is a hash of the scene's content that it depends on, of the keys of the stages whose
results it uses, and of gpusim's version. A stage that writes files is reused if the output folder
holds the result of its key; the in-memory stages (mesh, model, surface) run only if a stage that
runs needs them. So a new camera renders again and doesn't solve again, and a new load leaves the
unloaded frame alone.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import replace
from os import PathLike
from pathlib import Path
from typing import Any

from gpusim._version import __version__
from gpusim.plan.machine_speed import Speed
from gpusim.plan.stages import Plan, PlannedStage, RunOptions, State, timed, works_of
from gpusim.plan.state import StateFile, variant_folder
from gpusim.scene import Scene, plausibility
from gpusim.scene import cost as cost_of
from gpusim.scene.amplitudes import LoadHistory
from gpusim.scene.description.model import Camera

__all__ = ["Plan", "PlannedStage", "make_plan"]

_GIVEN = "displacements are given"


def make_plan(
    scene: Scene,
    out: str | PathLike[str] | None = None,
    backend: str = "auto",
    *,
    fresh: bool = False,
    skip: bool = True,
    state: StateFile | None = None,
    speed: Speed | None = None,
) -> Plan:
    """Decide every stage of a run of ``scene`` into ``out`` (None: nothing can be reused).

    ``fresh`` ignores the results in ``out``. ``skip=False`` switches every shortcut off as well:
    nothing is reused, and what the loads make trivial is computed all the same; outputs that the
    scene doesn't ask for are not made. ``state``: what ``out`` holds, if somebody has looked.
    ``speed``: of the machine, for the seconds; None: those of the machine that the costs were
    measured on.
    """
    from gpusim.gpu import chosen_backend

    options = RunOptions(chosen_backend("plan", backend), fresh, skip)
    if scene.variants:
        plan = _plan_variants(scene, out, options, speed)
    else:
        plan = _Planner(scene, out, options, state, speed).plan()
    return replace(plan, warnings=tuple(plausibility.warnings(scene)))


def _plan_variants(
    scene: Scene,
    out: str | PathLike[str] | None,
    options: RunOptions,
    speed: Speed | None,
) -> Plan:
    """The stages of every variant, named ``<variant>/<stage>``, and their comparison."""
    stages, compiled = [], set[str]()
    for variant in scene.variants:
        folder = None if out is None else variant_folder(Path(out), variant.name)
        planner = _Planner(scene.variant(variant.name), folder, options, None, speed)
        planner.compiled = compiled  # by one process, once
        plan = planner.plan()
        stages += [replace(stage, name=f"{variant.name}/{stage.name}") for stage in plan.stages]
    for measure in scene.measures:
        if measure.name not in {m.name for m in scene.variant(scene.variants[0].name).measures}:
            stages.append(
                PlannedStage(measure.name, "run", "compares the variants", 0, 0.1, measure.name)
            )
    stages.append(PlannedStage("report", "run", "says what this run did", 0, 1.0, "report"))
    busy = 1.0 if speed is None else speed.busy
    return Plan(scene.name, options.backend, tuple(stages), busy=busy)


class _Planner:
    def __init__(
        self,
        scene: Scene,
        out: str | PathLike[str] | None,
        options: RunOptions,
        state: StateFile | None,
        speed: Speed | None,
    ) -> None:
        self.speed = speed
        self.scene, self.backend, self.skip = scene, options.backend, options.skip
        self.state = state or (StateFile(out) if out is not None else None)
        self.no_reuse = options.no_reuse or ("" if out is not None else "new run")
        self.cost = cost_of.estimate(scene)
        self.details = cost_of.describe(scene)
        self.history = LoadHistory(scene, scaled=options.skip)
        cases = max((len(groups) for groups in self.history.groups), default=1)
        if cases > 1:
            self.details["solve"] += f", {cases} load cases"
        self.stages: dict[str, PlannedStage] = {}
        self.compiled: set[str] = set()

    def key(self, stage: str, sections: tuple[str, ...], *upstream: str, extra: Any = None) -> str:
        """Hash of everything the stage's result depends on."""
        digest = self.scene.digest(*sections) if sections else ""
        parts = [__version__, stage, digest, upstream, extra]
        return hashlib.sha256(json.dumps(parts).encode()).hexdigest()

    def decide(self, name: str, key: str, skipped: str = "", **where: Any) -> None:
        """Enter a stage that writes files: skipped for a reason, reused if its result is there."""
        state: State = "run"
        reason = self.no_reuse
        if skipped:
            state, reason = "skipped", skipped
        elif not self.no_reuse and self.state is not None:
            fault = self.state.fault(key, name)
            reason = fault or "unchanged"
            state = "run" if fault else "reused"
        self.enter(name, state, reason, key, **where)

    def enter(self, name: str, state: State, reason: str, key: str, **where: Any) -> None:
        """Enter a stage; its cost counts only if it is run."""
        kind = name.split("/")[0]
        memory, seconds = self.cost[kind] if state == "run" else (0, 0.0)
        detail = self.details.get(kind, "") if state == "run" else ""
        self.stages[name] = PlannedStage(
            name, state, reason, memory, seconds, key, detail, cost=seconds, **where
        )

    def runs(self, *prefixes: str) -> list[str]:
        """Names of the stages of these kinds that are run."""
        return [n for n, s in self.stages.items() if s.runs and n.split("/")[0] in prefixes]

    def plan(self) -> Plan:
        scene, backend = self.scene, self.backend
        mesh = self.key("mesh", ("body.*.mesh", "body.*.field", "body.*.notch"))
        model = self.key(
            "model",
            ("material", "body.*.material", "body.*.part", "body.*.formulation"),
            mesh,
            extra=self.history.solved,
        )
        solve = self.key("solve", ("solver", "analysis.type"), model, extra=backend)
        surface = self.key("surface", ("body.*.name", "body.*.paint", "prop"), mesh)
        still, given = self._still(), self.history.given
        unsolved = _GIVEN if given else still if self.skip or not scene.bodies else ""
        self.decide("solve", solve, unsolved)
        frames = self._frames(surface, solve if not still and not given else "")
        targets = self._targets()
        self._results(surface, solve, [*frames, *targets])
        self._in_memory(mesh, model, surface)
        everything = [stage.key for stage in self.stages.values()]
        report = self.key("report", ("name", "description"), *everything)
        self.enter("report", "run", "says what this run did", report)
        order = ["mesh", "model", "solve", "surface", *frames, *targets]
        order += ["truth", "measure", "stress", "export", "report"]
        if not frames:
            self.enter("render", "skipped", "no [[camera]]", self.key("render", ()))
            order.insert(4, "render")
        stages = [self.stages[name] for name in order]
        works = works_of(stages, self._size(), self.compiled)
        if self.speed is not None:
            stages = timed(stages, works, self.speed)
        busy = 1.0 if self.speed is None else self.speed.busy
        return Plan(scene.name, backend, tuple(stages), works=tuple(works.values()), busy=busy)

    def _size(self) -> str:
        """What the time of any stage may depend on, in words."""
        scene = self.scene
        cameras = [
            f"{camera.resolution}, {cost_of.effects(scene, camera)}" for camera in scene.cameras
        ]
        measures = [type(measure).__name__ for measure in scene.measures]
        return "; ".join([*self.details.values(), *cameras, *measures, str(self.history.frames)])

    def _still(self) -> str:
        """Why nothing moves, or "" if something does."""
        bodies = self.scene.bodies
        if not bodies:
            return "no [[body]]"
        if self.history.given:
            return ""
        moved = any(any(s.displacement) for body in bodies for s in body.supports)
        if not moved and not any(body.loads for body in bodies):
            return "no load and no prescribed displacement"
        if all(self.history.still(frame) for frame in range(self.history.frames)):
            return "every load factor is 0"
        return ""

    def _frames(self, surface: str, solve: str) -> list[str]:
        """Enter the render stages; returns their names."""
        names = []
        scene = self.scene
        weights: list[Any]
        for camera in scene.cameras:
            sections = (f"camera.{camera.name}", "light", "render", "sensor")
            first = ""
            for frame in range(self.history.frames):
                name = f"render/{camera.name}/{frame:04d}"
                # the unloaded frame doesn't depend on the solution; an automatic exposure is that
                # of the camera's first frame
                near = self._near(camera, frame)
                unloaded = all(self.history.unloaded(one) for one in near)
                moved = "" if unloaded else solve
                weights = [] if unloaded else [self.history.weights(one) for one in near]
                if len(near) > 1:
                    weights.append(scene.analysis.frame_rate)
                key = self.key(name, sections, surface, moved, first, extra=[self.backend, weights])
                if frame == 0 and scene.sensor_of(camera.name).exposure is None:
                    first = key
                self.decide(name, key, camera=camera.name, frame=frame)
                if self.stages[name].runs:
                    factors = ", ".join(f"{w:g}" for w in self.history.shown(frame))
                    what = f"time {factors}" if self.history.given else f"load x {factors}"
                    seconds = self.stages[name].seconds
                    if frame and self._alike(near, self._near(camera, frame - 1)):
                        what += " as before: exposed again"
                        seconds = 0.05 + 5e-8 * camera.resolution[0] * camera.resolution[1]
                    effects = cost_of.effects(scene, camera)
                    self._describe_image(name, camera, seconds, f"{effects}, {what}")
                names.append(name)
        return names

    def _describe_image(self, name: str, camera: Camera, seconds: float, what: str) -> None:
        """Enter what a render stage takes, and what it is, compilation included."""
        stage, (columns, rows) = self.stages[name], camera.resolution
        compiling, words = self._compiling(camera)
        total = seconds + compiling
        self.stages[name] = replace(
            stage, detail=f"{columns}x{rows} px, {stage.detail}, {what}{words}", seconds=total,
            cost=total, compiling=compiling,
        )  # fmt: skip

    def _compiling(self, camera: Camera) -> tuple[float, str]:
        """Seconds and words for the shaders that no image before this one has needed."""
        if self.backend == "numpy":
            return 0.0, ""
        needed = cost_of.compiled_for(self.scene, camera)
        seconds = sum(value for name, value in needed.items() if name not in self.compiled)
        self.compiled.update(needed)
        if not seconds:
            return 0.0, ""
        kept = self.speed is not None and self.speed.has_compiled(needed)
        if kept or (self.state is not None and self.state.begun):
            return cost_of.KEPT * seconds, "; shaders are loaded"
        return seconds, "; shaders are compiled, unless the driver has kept them"

    def _alike(self, near: list[int], before: list[int]) -> bool:
        """Whether two frames show the same: equal loads, and no prop that moves."""
        weights = [[self.history.weights(one) for one in frames] for frames in (near, before)]
        return self.skip and not self.history.props_move and weights[0] == weights[1]

    def _near(self, camera: Camera, frame: int) -> list[int]:
        """The frames that an image depends on: with a shutter the neighbours too."""
        if camera.shutter is None:
            return [frame]
        return sorted({max(frame - 1, 0), frame, min(frame + 1, self.history.frames - 1)})

    def _targets(self) -> list[str]:
        """Enter the render stages of the calibration target, which no body has a part in."""
        calibration, names = self.scene.calibration, []
        for camera in calibration.cameras if calibration else ():
            sections = (f"camera.{camera}", "light", "render", "sensor", "prop", "calibration")
            key = self.key("calibration", sections, extra=[self.backend, self.scene.measures_space])
            (spec,) = [one for one in self.scene.cameras if one.name == camera]
            for pose in range(len(calibration.poses) if calibration else 0):
                name = f"render/{camera}/calib-{pose:04d}"
                self.decide(name, self.key(name, (), key), camera=camera, pose=pose)
                if self.stages[name].runs:
                    what = "target and its corners" if self.scene.measures_space else "target"
                    self._describe_image(name, spec, cost_of.target_seconds(spec), what)
                names.append(name)
        return names

    def _results(self, surface: str, solve: str, frames: list[str]) -> None:
        scene, backend = self.scene, self.backend
        images = [self.stages[name].key for name in frames]
        output, none = scene.output, "not asked for"
        loaded = [self.history.weights(frame) for frame in range(self.history.frames)]
        truth = self.key(
            "truth", ("camera", "analysis", "output.truth"), surface, solve, extra=[backend, loaded]
        )
        blind = none if not output.truth else "" if scene.cameras else "no [[camera]]"
        self.decide("truth", truth, f"{none}: [output] truth is empty" if blind == none else blind)
        measure = self.key(
            "measure", ("measure", "analysis"), surface, solve, *images, extra=[backend, loaded]
        )
        self.decide("measure", measure, "" if scene.measures else f"{none}: no [[measure]]")
        stress = self.key("stress", ("analysis",), solve, extra=loaded)
        needless = "" if output.stress else f"{none}: [output] stress is false"
        if not needless and "solve" in self.stages and self.stages["solve"].state == "skipped":
            needless = self.stages["solve"].reason
        self.decide("stress", stress, needless)
        files = ("output.vtu", "output.stl", "output.stress", "analysis")
        export = self.key("export", files, surface, solve, extra=loaded)
        wanted = output.vtu or output.stl
        self.decide("export", export, "" if wanted else f"{none}: neither vtu nor stl in [output]")

    @property
    def _reuses(self) -> bool:
        return any(stage.state == "reused" for stage in self.stages.values())

    def _in_memory(self, mesh: str, model: str, surface: str) -> None:
        """Mesh, model and surface: run for the stages that need them, else not at all."""
        solving = self.runs("solve", "stress")
        drawing = self.runs("render", "truth", "measure", "export")
        if self.history.given:
            self.enter("model", "skipped", _GIVEN, model)
        for name, key, users in (
            *(() if self.history.given else (("model", model, solving),)),
            ("surface", surface, drawing),
            ("mesh", mesh, [*solving, *drawing]),
        ):
            if not self.scene.bodies and name != "surface":
                self.enter(name, "skipped", "no [[body]]", key)
            elif users or not self.skip:
                kinds = list(dict.fromkeys(user.split("/")[0] for user in users))
                self.enter(
                    name, "run", "needed by " + ", ".join(kinds) if kinds else "--no-skip", key
                )
            elif name == "mesh" and self._reuses and self.state and self.state.notes(key) is None:
                self.enter(name, "run", "the report needs what it is like", key)
            else:
                self.enter(name, "skipped", "nothing that runs needs it", key)
