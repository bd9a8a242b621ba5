"""The work of a run: scenes made into their folders, each reported as soon as it is whole."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager, nullcontext
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from threading import current_thread, main_thread

from gpusim.files.atomic_files import clean_leftovers
from gpusim.files.output_folder import delete, inside
from gpusim.gpu import Device
from gpusim.gpu.warmup import compile_during
from gpusim.graph.folder import Folder
from gpusim.graph.graph import Task
from gpusim.graph.runner import Runner, StageFailed
from gpusim.graph.session import Session
from gpusim.graph.store import Store
from gpusim.interrupts import DelayedSignals
from gpusim.pipeline.checks.resources import check_memory, check_views
from gpusim.pipeline.measurements.kinds import kind_of
from gpusim.pipeline.runner.scene_file import write_scene
from gpusim.pipeline.runner.scene_report import SceneReport
from gpusim.pipeline.runner.stage_log import Progress, StageLog, public_name
from gpusim.pipeline.scene_objects.surfaces import MeshedBody, counts_of
from gpusim.plan.decision import decide
from gpusim.plan.machine_speed import Speed
from gpusim.plan.plan import plan_of
from gpusim.plan.programs import earlier_programs, keep_programs
from gpusim.plan.stages import RunOptions
from gpusim.report import Report, write_report
from gpusim.report.figure_store import KEYS
from gpusim.scene import Scene


class RunFailed(Exception):
    """The scene at a ``place`` came to nothing, through a ``task`` or its report; the cause is its
    ``__cause__``."""

    def __init__(self, place: str, task: Task | None = None) -> None:
        super().__init__(place)
        self.place, self.task = place, task


class Execution:
    """Scenes run into places of one folder, ``out``.

    ``scene``: what they are states of. ``reports``: by place, of those that are done. ``draws``:
    whether reports of states have figures.
    """

    def __init__(
        self,
        scene: Scene,
        states: Mapping[str, Scene],
        out: Path,
        options: RunOptions,
        progress: Progress,
        store: Path | None = None,
        verify: bool = False,
        draws: bool = True,
    ) -> None:
        self.scene, self.out, self._shared, self._draws = scene, out, store is not None, draws
        self.speed = Speed.read(options.backend)
        self.decision = decide(states, out, options, store, verify)
        self.plan = plan_of(scene, self.decision, self.speed)
        self.log = StageLog(self.decision, self.plan, progress)
        self.session = Session(options)
        self.reports: dict[str, Report] = {}
        self._device_before: dict[str, float] = {}

    @property
    def store(self) -> Store:
        """Where results are kept."""
        assert self.decision.store is not None
        return self.decision.store

    def run(self) -> None:
        """Make everything and write the reports of the scenes.

        Raises
        ------
        GpusimError, ...
            What is wrong before anything is written.
        RunFailed
            Of what is wrong later; what was finished by then is kept.
        """
        check_memory(self.plan)
        self._import_stages()
        for scene in self.decision.scenes.values():
            check_views(scene)
        with self._device() as device:
            runner = Runner(
                self.decision.graph, self.store, self.decision.folders, self.session,
                self.log.observe,
            )  # fmt: skip
            try:
                runner.make_early()
            except StageFailed as failed:
                raise failed.__cause__ or failed from None
            self._count_meshes()
            try:
                self._begin()
                self._make(runner)
                if device is not None:
                    keep_programs(self.out, device.programs.asked)
            finally:
                self._close()

    def _count_meshes(self) -> None:
        """Plan again with the meshes that were made: only now is it known how large they are.
        Raises InputError where the memory doesn't hold what they need."""
        values = self.session.values.values()  # painted bodies are those of another stage
        if made := counts_of(one for one in values if type(one) is MeshedBody):
            self.plan = plan_of(self.scene, self.decision, self.speed, made)
            self.log.describe(self.plan)
            check_memory(self.plan)

    def _import_stages(self) -> None:
        """Import what will be run, before threads do it side by side; an interrupt is put off: in
        the middle of an import it comes out as any error, or ends the process by the signal."""
        running = (task for task in self.decision.graph.tasks.values() if task.runs)
        modules = sorted({task.stage.work.split(":")[0] for task in running})
        is_main = current_thread() is main_thread()
        with DelayedSignals() if is_main else nullcontext():
            for module in modules:
                import_module(module)
            for spec in self.scene.measures:
                kind_of(spec)

    @contextmanager
    def _device(self) -> Iterator[Device | None]:
        """Open the device before anything else, if a stage that runs needs it."""
        needed = any(task.stage.on_device for task in self.decision.graph.order())
        device = self.session.device if needed else None
        if device is None:
            yield None
            return
        self._device_before = device.timer.seconds()
        device.programs.asked.clear()
        with compile_during(device, earlier_programs(self.out)):
            yield device

    def _begin(self) -> None:
        """The first that is written: what an earlier run left is put in order."""
        clean_leftovers(self.out)
        self.store.clean()
        runs = bool(self.decision.graph.order())
        for path in {self.out, *(one.path for one in self.decision.folders.values())}:
            # an earlier report must not speak for what a killed run leaves behind
            for name in ("report.html", "report.json") if runs else ():
                delete(path, name)
        delete(self.out, "state.json")  # of a gpusim that had no store
        for path in (self.out, *sorted(inside(self.out, "variants").glob("*"))):
            if path not in {folder.path for folder in self.decision.folders.values()}:
                Folder(path).retire(())  # of a scene that had other variants, or none
        if "" not in self.decision.folders:
            write_scene(self.out, self.scene.to_toml())
        for place, folder in self.decision.folders.items():
            write_scene(folder.path, self._scene_report(place).scene_text())
            if self.decision.options.fresh:
                delete(folder.path, f"figures/{KEYS}")
            for key in self.decision.graph.kept(place):
                record = self.store.find(key)
                if record is not None and not self.decision.graph.tasks[key].runs:
                    folder.show(record, self.store)
            self.log.begin(place)

    def _make(self, runner: Runner) -> None:
        """Execution off the graph; pages are made by a thread of their own."""
        with ThreadPoolExecutor(1, "gpusim.report") as pages:
            written: dict[str, Future[None]] = {}

            def write(place: str) -> None:
                written[place] = pages.submit(self._report, place)

            try:
                runner.work(write)
            except StageFailed as failed:
                raise RunFailed(failed.task.places[0][0], failed.task) from failed.__cause__
            for place, page in written.items():
                try:
                    page.result()
                except Exception as error:
                    raise RunFailed(place) from error

    def _report(self, place: str) -> None:
        """Write the report of a scene whose results are all there."""
        folder, graph = self.decision.folders[place], self.decision.graph
        changed = folder.retire(graph.current(place, self.store))
        folder.depends(graph.parts[place])
        name = public_name(place, "report")
        self.log.tell(name, 0.0, "figures and page")
        report = self._scene_report(place, changed).report(self.log.stages(place))
        drawn = self._draws or not place
        write_report(report if drawn else replace(report, figures=()), folder.path)
        self.reports[place] = report
        self.log.tell(name, 1.0, "report.html, report.json")

    def _scene_report(self, place: str, changed: list[str] | None = None) -> SceneReport:
        return SceneReport(self.decision, place, self.plan, self.session, changed or [],
                           self._device_before)  # fmt: skip

    def failed_report(self, failed: RunFailed, why: str) -> Report:
        """Of a scene that ``failed``."""
        stages = self.log.stages(failed.place, failed.task, why)
        return self._scene_report(failed.place).report(stages, failure=why)

    def _close(self) -> None:
        """What nobody needs any more goes; logs are put in order."""
        self.session.values.clear()
        self.session.kept.clear()
        for folder in self.decision.folders.values():
            folder.close()
        if not self._shared:
            places = self.decision.scenes
            self.store.collect(key for one in places for key in self.decision.graph.kept(one))
        self.store.close()
