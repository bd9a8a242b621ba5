"""What a run says of a scene: its report, from the results that are kept.

Whether a stage was run now or before makes no difference: all that is said lies with its results.
"""

from __future__ import annotations

import platform
from collections.abc import Mapping, Sequence
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import numpy as np

from gpusim._version import __version__
from gpusim.errors import GpusimError
from gpusim.files.input_file import InputFile
from gpusim.files.output_folder import inside
from gpusim.gpu import Device
from gpusim.graph.graph import Task
from gpusim.graph.session import Session
from gpusim.graph.store import Record
from gpusim.pipeline.measurements.kinds import kind_of
from gpusim.pipeline.measurements.results import Reported, Result
from gpusim.pipeline.notes import Notes
from gpusim.pipeline.pictures.file_names import film_names, image_path
from gpusim.pipeline.runner.result_tables import lowest_modes, mode_table, newton_table
from gpusim.plan.decision import Decision
from gpusim.plan.machine_speed import Speed
from gpusim.plan.plan import Plan
from gpusim.report import (
    BodyForce,
    Chart,
    Drawing,
    FieldPicture,
    Film,
    FramePair,
    Link,
    LoadPath,
    LoadStepRow,
    Measurement,
    Mechanics,
    Published,
    Report,
    SolutionSummary,
    Stage,
    StressPeak,
    draw_chart,
)
from gpusim.report.text import number
from gpusim.scene import Scene
from gpusim.scene.cost import effects
from gpusim.scene.description.video import filming
from gpusim.visualization.color_scale import format_value

_FIRST = ("solve", "equilibria", "geometry", "linear theory")
"""Stages whose notes a report has before the others'."""


class SceneReport:
    """Of the scene at a ``place`` of a ``decision``. ``changed``: files of an earlier scene that
    somebody has changed; ``before``: what the device had spent when the run began."""

    def __init__(
        self,
        decision: Decision,
        place: str,
        plan: Plan,
        session: Session,
        changed: Sequence[str],
        before: Mapping[str, float],
    ) -> None:
        self.decision, self.place, self.plan, self.session = decision, place, plan, session
        self.scene = decision.scenes[place]
        self.frames = decision.stages[place].frames
        self.out = decision.folders[place].path
        self.changed, self.before = changed, before

    def report(self, stages: tuple[Stage, ...], failure: str = "") -> Report:
        """The report of a run that has come to its end, or to a ``failure``."""
        scene = self.scene
        results = [] if failure else read_results(self.decision, self.place)
        told = [result.report(scene, self.out) for result in results]
        measurements = [item for one in told for item in one.measurements]
        solution = self._said("solve").get("solution")
        fields, path = self._fields()
        lowest = {} if scene.analysis.type == "transient" else lowest_modes(self._modes)
        return Report(
            scene=scene.name,
            adapter=self._adapters(),
            status="failed" if failure else "done",
            stages=stages,
            solution=None if solution is None else SolutionSummary(**solution["summary"]),
            mechanics=None if solution is None else self._mechanics(solution),
            meshes=Notes.of(self._said("meshes")).meshes,
            measurements=tuple(measurements),
            published=_published(scene, measurements),
            warnings=self._warnings(results),
            fields=fields,
            load_path=path,
            description=scene.description,
            failure=failure,
            highlights=lowest or _highlights(fields),
            facts=self._facts(),
            scene_text=scene.to_toml(),
            frames=_pairs(scene, self.out, told, self._frame_shown(fields)),
            films=self._films(),
            series=tuple(item for one in told for item in one.series),
            overlays=tuple(item for one in told for item in one.overlays),
            residuals=() if solution is None else tuple(solution["residuals"]),
            tolerance=scene.solver.tolerance,
            figures=(*self._charts(), *(item for one in told for item in one.figures)),
            modes=self._modes,
            first_tables=(*mode_table(self._modes), *(item for one in told for item in one.tables)),
            tables=newton_table(self._load_steps),
            links=self._links(),
        )

    def scene_text(self) -> str:
        """The resolved scene, and what it is run with."""
        head = f"# resolved by gpusim {__version__}; adapter: {self._adapters()}\n"
        return head + self.scene.to_toml()

    @cached_property
    def _tasks(self) -> list[Task]:
        """Of results that are kept, in the order of the stages."""
        graph = self.decision.graph
        return [graph.tasks[key] for key in graph.kept(self.place)]

    def _record_notes(self, task: Task) -> Mapping[str, Any]:
        assert self.decision.store is not None
        record = self.decision.store.find(task.key)
        return {} if record is None else record.notes

    def _said(self, stage: str) -> Mapping[str, Any]:
        """The notes of a stage with one record; nothing if there is none."""
        task = next((task for task in self._tasks if task.stage.name == stage), None)
        return {} if task is None else self._record_notes(task)

    def _adapters(self) -> str:
        """What the results were made on, by this run or before it."""
        made = [
            self.session.adapter if task.runs else Notes.of(self._record_notes(task)).adapter
            for task in self._tasks if task.stage.on_device
        ]  # fmt: skip
        return "; ".join(dict.fromkeys(filter(None, made))) or "not needed"

    def _mechanics(self, solution: Mapping[str, Any]) -> Mechanics:
        """Of the last frame in which something has moved; load groups of linear bodies add up."""
        last, displaced = self.frames.last_moved, self._said("equilibria").get("forces", {})
        reactions, loads = [], []
        reacting, loading = solution["reactions"], solution["applied"]
        states = self.frames[last].shown.states
        rows = zip(self.scene.bodies, reacting, loading, states, strict=True)
        for body, held, applied, state in rows:
            weights = np.zeros(len(held)) if state is None else np.array(state[: len(held)])
            forces = np.tensordot(weights, np.array(held), axes=1).tolist()
            sums = (weights @ np.array(applied)).tolist()
            if body.name in displaced and state is not None:
                forces, sums = (displaced[body.name][key] for key in ("reactions", "applied"))
            for support, (x, y, z) in zip(body.supports, forces, strict=False):
                reactions.append(BodyForce(body.name, support.name, (x, y, z)))
            x, y, z = sums
            loads.append(BodyForce(body.name, "loads", (x, y, z)))
        peaks = tuple(
            StressPeak(**{**row, "position": tuple(row["position"])})
            for row in self._said("stress").get("peaks", ())
        )
        balance = solution["energy_balance"]
        return Mechanics(last, balance, tuple(reactions), tuple(loads), peaks, self._load_steps)

    @cached_property
    def _load_steps(self) -> tuple[LoadStepRow, ...]:
        """Of the bodies at large displacements."""
        return tuple(LoadStepRow(**row) for row in self._said("equilibria").get("steps", ()))

    @cached_property
    def _modes(self) -> tuple[Mapping[str, Any], ...]:
        """Of bodies whose modes were asked for."""
        return tuple(self._said("solve").get("modes", ()))

    def _charts(self) -> list[Drawing]:
        """Curves of motions in time, and of responses over frequencies."""
        charts = [Chart(**row) for row in self._said("solve").get("charts", ())]
        folder = inside(self.out, "figures")
        return [
            partial(draw_chart, chart, inside(folder, f"chart-{number}.png"))
            for number, chart in enumerate(charts, 1)
        ]

    def _fields(self) -> tuple[tuple[FieldPicture, ...], LoadPath | None]:
        """Pictures of the bodies, and how they go with the load."""
        said = self._said("fields")
        pictures = tuple(FieldPicture(**_tuples(row)) for row in said.get("pictures", ()))
        return pictures, LoadPath(**_tuples(said["path"])) if said.get("path") else None

    def _frame_shown(self, fields: Sequence[FieldPicture]) -> int:
        """The frame that is set beside the reference: the last one, of vibrations the one that
        shows most, as far as pictures of ``fields`` tell."""
        moved = {one.frame: one.largest for one in fields if one.field == "displacement"}
        if self.scene.analysis.scales_loads or not moved:
            return len(self.frames) - 1
        return max(moved, key=lambda frame: moved[frame])

    def _noted(self, first: bool) -> list[Notes]:
        """In the order of the stages; the ``first`` ones, or the others."""
        return [
            Notes.of(self._record_notes(task)) for task in self._tasks
            if (task.stage.name in _FIRST) == first
        ]  # fmt: skip

    def _warnings(self, results: Sequence[Result]) -> tuple[str, ...]:
        once: set[str] = set()
        rest: list[str] = []
        for notes in self._noted(first=False):
            rest += notes.warnings
            for about, text in notes.first_warnings.items():
                if about not in once:
                    once.add(about)
                    rest.append(text)
        return (
            *self.plan.warnings,
            *(text for notes in self._noted(first=True) for text in notes.warnings),
            *(f"{name} is of an earlier scene and was changed since" for name in self.changed),
            *(text for result in results for text in result.warnings),
            *rest,
        )

    def _facts(self) -> dict[str, str]:
        facts = {"Python": platform.python_version()} | dict(Notes.of(self._said("solve")).facts)
        facts |= {f"camera {one.name}": effects(self.scene, one) for one in self.scene.cameras}
        for notes in (*self._noted(first=True), *self._noted(first=False)):
            facts |= notes.facts
        device = vars(self.session).get("device")  # if it was opened
        spent = {} if device is None else _device_seconds(device, self.before)
        (key,) = self.decision.graph.records[self.place].get("solve", ("",))
        solver: dict[str, str] = self.session.kept.get(f"seconds of {key}", {})
        return facts | solver | spent

    def _films(self) -> tuple[Film, ...]:
        """That are there."""
        found = []
        for camera in filming(self.scene.video, self.scene.cameras):
            file, shown = (inside(self.out, name) for name in film_names(self.scene, camera))
            if shown.is_file():
                rate = self.scene.analysis.frame_rate
                filmed = f", filmed at {rate:g} a second" if rate else ""
                found.append(Film(camera, file, shown, f"{len(self.frames)} frames{filmed}."))
        return tuple(found)

    def _links(self) -> tuple[Link, ...]:
        """Links to this run's files; what an earlier scene left in the folder isn't among them."""
        assert self.decision.store is not None
        current = self.decision.graph.current(self.place, self.decision.store)
        files = {inside(self.out, name) for name in current if not name.startswith(".")}
        links = [Link("Ground truth (HDF5)", file) for file in files if file.name == "truth.h5"]
        links.append(Link("Scene as it was run", inside(self.out, "scene.toml")))
        links.append(Link("Numbers of this report", inside(self.out, "report.json")))
        for label, suffix in (("Solution for ParaView", ".pvd"), ("Measured: {}", ".csv")):
            links += [
                Link(label.format(file.stem), file)
                for file in sorted(files) if file.suffix == suffix
            ]  # fmt: skip
        if any(file.parent.name == "calibration" for file in files):
            links.append(Link("Calibration for other programs", inside(self.out, "calibration")))
        return tuple(links)


def read_results(decision: Decision, place: str, only: str | None = None) -> list[Result]:
    """What was measured in the scene at a place; ``only`` by the measure of that name."""
    store, graph = decision.store, decision.graph
    assert store is not None
    results = []
    for spec in decision.scenes[place].measures:
        if only is not None and spec.name != only:
            continue
        (key,) = graph.records[place][f"measure/{spec.name}"]
        record = store.find(key)
        assert record is not None, spec.name

        def read(path: str, record: Record = record) -> InputFile:
            return store.read(record, f"measure/{Path(path).name}")

        results.append(kind_of(spec).result.read(store.root, spec.name, read))
    return results


def learn(speed: Speed, plan: Plan, stages: Sequence[Stage], session: Session) -> None:
    """Keep how long the ``stages`` of a finished run took, for later plans."""
    seconds = {stage.name: stage.seconds for stage in stages}
    spent: dict[str, float] = {}
    for planned in plan.stages:
        if planned.runs and planned.name in seconds:
            spent[planned.kind] = spent.get(planned.kind, 0.0) + seconds[planned.name]
    done = {work: spent[work.kind] for work in plan.works if work.kind in spent}
    if done:
        device = vars(session).get("device")
        speed.learn(done, "" if device is None else device.name)
        speed.save()


def _device_seconds(device: Device, before: Mapping[str, float]) -> dict[str, str]:
    """What a run took on the device, by stage; the device may be older than the run."""
    spent = {
        name: seconds - before.get(name, 0.0)
        for name, seconds in sorted(device.timer.seconds().items())
    }
    return {f"device: {name}": f"{value:.2f} s" for name, value in spent.items() if value > 0.0}


def failure_text(error: BaseException) -> str:
    """The message, with the error's type where it isn't one of gpusim's own."""
    return str(error) if isinstance(error, GpusimError) else f"{type(error).__name__}: {error}"


def _tuples(row: Mapping[str, Any]) -> dict[str, Any]:
    """Plain data as dataclasses have it."""
    return {key: tuple(value) if isinstance(value, list) else value for key, value in row.items()}


def _highlights(fields: Sequence[FieldPicture]) -> dict[str, tuple[str, str]]:
    """The largest displacement and stress, of several frames that are shown."""
    cards = {}
    for name in ("displacement", "von_mises"):
        shown = [one for one in fields if one.field == name]
        if shown:
            one = max(shown, key=lambda picture: picture.largest)
            x, y, z = map(format_value, one.position_mm)
            place = f"frame {one.frame}, {one.body} at ({x}, {y}, {z}) mm"
            place += f": {one.shown}" if one.shown else ""
            cards[f"Largest {one.title}"] = f"{number(one.largest, 4)} {one.unit}", place
    return cards


def _published(scene: Scene, measurements: Sequence[Measurement]) -> tuple[Published, ...]:
    """The main number of each measure beside what somebody else reached."""
    rows = []
    for spec in scene.measures:
        own = [item for item in measurements if item.name.startswith(f"{spec.name}: ")]
        other = getattr(spec, "published", None)
        if other is not None and own:
            rows.append(Published(own[0].name, own[0].error_relative, other.error, other.source))
    return tuple(rows)


def _pairs(scene: Scene, out: Path, told: Sequence[Reported], shown: int) -> tuple[FramePair, ...]:
    """Each camera's pictures of frame 0 and the one that is ``shown`` beside it; of what was
    ``told`` crops are those of the last frame."""
    factors, last = scene.analysis.load_factors, len(scene.analysis.frame_values) - 1
    objects = [thing for body in scene.bodies for thing in (*body.loads, *body.supports)]
    own = any(thing.amplitude != factors for thing in objects)  # the factors don't tell all then
    word, told_of = scene.analysis.word.replace("_", " "), scene.analysis.frame_text
    first, then = told_of(0), told_of(shown)
    when = f"frames 0 and {shown}" if own else f"{first} and {then.removeprefix(f'{word} ')}"
    pairs = []
    for camera in scene.cameras:
        paths = [image_path(scene, out, camera.name, k) for k in (0, shown)]
        if last == 0 or not all(path.is_file() for path in paths):
            continue
        crops = [crop for one in told for crop in one.crops.get(camera.name, ()) if shown == last]
        columns, rows = camera.resolution
        caption = f"Camera {camera.name}, {columns} x {rows} px; {when}."
        sensor = scene.sensor_of(camera.name)
        bits = 16 if sensor.shift else sensor.bits
        images = [
            (f"frame {k}" if own else told_of(k), image_path(scene, out, camera.name, k))
            for k in range(last + 1)
        ]
        pairs.append(FramePair(camera.name, paths[0], paths[1], caption, tuple(crops[:4]), bits,
                               tuple(one for one in images if one[1].is_file()),
                               "loaded" if scene.analysis.scales_loads else then))  # fmt: skip
    return tuple(pairs)
