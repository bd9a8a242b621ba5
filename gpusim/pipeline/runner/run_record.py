"""What a run knows of its stages, those whose results it reused too, and what it says of itself."""

from __future__ import annotations

import platform
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING
from zipfile import BadZipFile
from zlib import error as ZlibError

import numpy as np

from gpusim._version import __version__
from gpusim.errors import GpusimError
from gpusim.files.output_folder import inside
from gpusim.gpu import Device
from gpusim.pipeline.build.scene_objects import SceneObjects, SceneSolution, frame_word
from gpusim.pipeline.checks.warnings import SceneWarnings
from gpusim.pipeline.measurements.measurements import Result, reported, tracked
from gpusim.pipeline.measurements.sources import board_of, read_corners
from gpusim.pipeline.notes import Notes
from gpusim.pipeline.stages.images import image_path, read_exposure
from gpusim.plan.machine_speed import Speed
from gpusim.plan.plan import PlannedStage
from gpusim.plan.stages import Plan, RunOptions
from gpusim.plan.state import StateFile
from gpusim.report import (
    BodyForce,
    FramePair,
    Link,
    Measurement,
    Mechanics,
    Published,
    Report,
    Stage,
    write_report,
)
from gpusim.scene import Scene
from gpusim.scene.amplitudes import LoadHistory
from gpusim.scene.cost import effects
from gpusim.scene.description import model as m

if TYPE_CHECKING:
    from gpusim.fem import Model
    from gpusim.pipeline.stages.mechanics import Stresses

__all__ = [
    "DAMAGE",
    "ON_DEVICE",
    "RunRecord",
    "check_frame",
    "device_seconds",
    "failure_text",
    "learn",
    "write_page",
]

ON_DEVICE = ("solve", "render", "truth")
"""Kinds of stages that work on the device."""
DAMAGE = (
    OSError, EOFError, ValueError, KeyError, IndexError, TypeError, AttributeError, RecursionError,
    NotImplementedError, BadZipFile, ZlibError, MemoryError,
)  # fmt: skip
"""What reading a damaged file raises; `InputError` is a ValueError."""


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
        scene, solved = self.scene, self.objects.solved
        results = [] if failure else self.results
        told = [reported(result, scene, self.out) for result in results]
        measurements = [item for one in told for item in one.measurements]
        return Report(
            scene=scene.name,
            adapter=self._adapters(),
            status="failed" if failure else "done",
            stages=tuple(self.stages),
            solution=None if solved is None else solved.summary(),
            mechanics=None if solved is None else self._mechanics(solved),
            meshes=self.notes.get("mesh", Notes()).meshes,
            measurements=tuple(measurements),
            published=_published(scene, measurements),
            warnings=self._warnings(),
            description=scene.description,
            failure=failure,
            facts=self._facts(),
            scene_text=scene.to_toml(),
            frames=_pairs(scene, self.out, results),
            series=tuple(item for one in told for item in one.series),
            overlays=tuple(item for one in told for item in one.overlays),
            residuals=() if solved is None else solved.residuals,
            tolerance=scene.solver.tolerance,
            figures=tuple(item for one in told for item in one.figures),
            links=self._links(),
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

    def _mechanics(self, solved: SceneSolution) -> Mechanics:
        """Of the last frame in which something has moved; linear, so load groups add up."""
        moving = [frame for frame in range(self.history.frames) if not self.history.still(frame)]
        last = moving[-1] if moving else self.history.frames - 1
        reactions, loads = [], []
        rows = zip(
            self.scene.bodies,
            solved.reactions,
            solved.applied,
            self.history.weights(last),
            strict=True,
        )
        for body, held, applied, weights in rows:
            forces = np.tensordot(np.array(weights), held, axes=1)
            for support, (x, y, z) in zip(body.supports, forces.tolist(), strict=False):
                reactions.append(BodyForce(body.name, support.name, (x, y, z)))
            x, y, z = (np.array(weights) @ applied).tolist()
            loads.append(BodyForce(body.name, "loads", (x, y, z)))
        peaks = () if self.stresses is None else self.stresses.peaks
        return Mechanics(last, solved.energy_balance, tuple(reactions), tuple(loads), peaks)

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
        solved = self.objects.solved
        facts = {"Python": platform.python_version()} | (solved.facts if solved else {})
        facts |= {f"camera {one.name}": effects(self.scene, one) for one in self.scene.cameras}
        facts |= self.scene_warnings.notes(solved).facts
        for notes in self._noted():
            facts |= notes.facts
        return facts | self.seconds

    def _links(self) -> tuple[Link, ...]:
        """Links to this run's files; what an earlier scene left in the folder isn't among them."""
        files = {file for stage in self.plan.stages for file in self.state.files(stage.key)}
        links = [Link("Ground truth (HDF5)", file) for file in files if file.name == "truth.h5"]
        links.append(Link("Scene as it was run", inside(self.out, "scene.toml")))
        links.append(Link("Numbers of this report", inside(self.out, "report.json")))
        for label, suffix in (("Solution for ParaView", ".pvd"), ("Measured points", ".csv")):
            links += [Link(label, file) for file in sorted(files) if file.suffix == suffix]
        return tuple(links)

    def _noted(self) -> list[Notes]:
        """In the order of the stages, whether they ran or not."""
        return [self.notes[stage.name] for stage in self.plan.stages if stage.name in self.notes]


def check_frame(scene: Scene, stage: PlannedStage, state: StateFile) -> None:
    """Raises InputError if what lies beside a picture can't be used: its exposure, the corners
    found in it."""
    for file in state.files(stage.key):
        if file.suffix == ".json":
            read_exposure(state.read(file))
    if stage.pose is not None and scene.measures_space and board_of(scene) is not None:
        camera = stage.camera or ""
        read_corners(scene, state.folder, lambda path: state.read(Path(path)), camera, stage.pose)


def learn(speed: Speed, plan: Plan, stages: Sequence[Stage], adapter: str) -> None:
    """Keep how long the ``stages`` of a finished run took, for later plans."""
    seconds = {stage.name: stage.seconds for stage in stages}
    spent: dict[str, float] = {}
    for planned in plan.stages:
        if planned.runs and planned.name in seconds:
            spent[planned.kind] = spent.get(planned.kind, 0.0) + seconds[planned.name]
    done = {work: spent[work.kind] for work in plan.works if work.kind in spent}
    if done:
        speed.learn(done, adapter)
        speed.save()


def device_seconds(device: Device, before: dict[str, float]) -> dict[str, str]:
    """What a run took on the device, by stage; the device may be older than the run."""
    spent = {
        name: seconds - before.get(name, 0.0)
        for name, seconds in sorted(device.timer.seconds().items())
    }
    return {f"device: {name}": f"{value:.2f} s" for name, value in spent.items() if value > 0.0}


def write_page(report: Report, out: Path, progress: Callable[[str, float, str], None]) -> None:
    """Write a run's report into its folder."""
    progress("report", 0.0, "figures and page")
    write_report(report, out)
    progress("report", 1.0, "report.html, report.json")


def failure_text(error: Exception) -> str:
    """The message, with the error's type where it isn't one of gpusim's own."""
    return str(error) if isinstance(error, GpusimError) else f"{type(error).__name__}: {error}"


def _published(scene: Scene, measurements: Sequence[Measurement]) -> tuple[Published, ...]:
    """The main number of each measure beside what somebody else reached."""
    rows = []
    for spec in scene.measures:
        own = [item for item in measurements if item.name.startswith(f"{spec.name}: ")]
        other = None if isinstance(spec, m.Damage) else spec.published
        if other is not None and own:
            rows.append(Published(own[0].name, own[0].error_relative, other.error, other.source))
    return tuple(rows)


def _pairs(scene: Scene, out: Path, results: Sequence[Result]) -> tuple[FramePair, ...]:
    factors = scene.analysis.load_factors
    last = len(factors) - 1
    objects = [thing for body in scene.bodies for thing in (*body.loads, *body.supports)]
    own = any(thing.amplitude != factors for thing in objects)  # the factors don't tell all then
    word = frame_word(scene).replace("_", " ")
    when = f"frames 0 and {last}" if own else f"{word} {factors[0]:g} and {factors[last]:g}"
    pairs = []
    for camera in scene.cameras:
        paths = [image_path(scene, out, camera.name, k) for k in (0, last)]
        if last == 0 or not all(path.is_file() for path in paths):
            continue
        crops = [crop for result in results for crop in _crops(result, camera.name)]
        columns, rows = camera.resolution
        caption = f"Camera {camera.name}, {columns} x {rows} px; {when}."
        sensor = scene.sensor_of(camera.name)
        bits = 16 if sensor.shift else sensor.bits
        pairs.append(FramePair(camera.name, paths[0], paths[1], caption, tuple(crops[:4]), bits))
    return tuple(pairs)


def _crops(result: Result, camera: str) -> list[tuple[str, float, float, float, float]]:
    """The first, the middle and the last marker that were followed in a camera."""
    found = [(points, moved) for name, points, moved in tracked(result) if name == camera]
    for points, moved in found:
        ok = np.flatnonzero(np.isfinite(points + moved).all(axis=1))
        if len(ok):
            shown = ok[np.unique(np.linspace(0, len(ok) - 1, 3).astype(int))]
            ends = (points + moved).tolist()
            return [(result.marker[i], *points[i].tolist(), *ends[i]) for i in shown]
    return []
