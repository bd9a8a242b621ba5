"""Running a plan: each stage in turn, timed, recorded as soon as its files are whole."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from functools import partial
from importlib import import_module
from pathlib import Path
from threading import Thread
from typing import Any

import numpy as np
import numpy.typing as npt

from gpusim.errors import GpusimError
from gpusim.export.images import read_image
from gpusim.files.atomic_files import atomic_stream, clean_leftovers, write_text
from gpusim.files.input_file import InputFile
from gpusim.files.output_folder import delete, inside
from gpusim.gpu import Device, default_device
from gpusim.gpu.warmup import compile_during
from gpusim.pipeline.build.lights import build_lights
from gpusim.pipeline.build.meshing import mesh_summary, size_warnings_of
from gpusim.pipeline.build.scene_objects import SceneObjects, SceneSolution, solver_seconds
from gpusim.pipeline.build.surfaces import build_body, build_prop
from gpusim.pipeline.checks.resources import check_field, check_memory, check_views
from gpusim.pipeline.checks.warnings import SceneWarnings, with_known_warnings
from gpusim.pipeline.measurements import measurements
from gpusim.pipeline.measurements.marker_tracking import MarkerCache
from gpusim.pipeline.measurements.sources import Sources, read_corners, write_corners
from gpusim.pipeline.measurements.stereo import track_in_cameras
from gpusim.pipeline.notes import Notes, StageResult
from gpusim.pipeline.runner.run_record import (
    DAMAGE,
    ON_DEVICE,
    RunRecord,
    check_frame,
    device_seconds,
    failure_text,
    learn,
)
from gpusim.pipeline.stages import images
from gpusim.pipeline.stages.images import CaptureQueue
from gpusim.plan.machine_speed import Speed
from gpusim.plan.plan import Plan, PlannedStage, make_plan
from gpusim.plan.stages import RunOptions
from gpusim.report import Report, Stage, prepare_figures, write_report
from gpusim.scene import Scene
from gpusim.scene.description import model as m

__all__ = ["Progress", "StageRunner"]

Progress = Callable[[str, float, str], None]


class StageRunner(RunRecord):
    """One scene's stages, from nothing or from what an earlier run left in ``out``."""

    def __init__(self, scene: Scene, out: Path, options: RunOptions, progress: Progress) -> None:
        super().__init__(scene, out, options)
        self.progress, self.note = progress, ""
        self.reuse = not options.no_reuse
        self.speed = Speed.read(options.backend)
        self.plan = self._planned()
        self.markers = MarkerCache(inside(self.out, "measure"), self.reuse, self._read)
        self.capture: images.FrameCapture | None = None
        self.device_before: dict[str, float] = {}

    def begin(self) -> Callable[[], Report]:
        """Every stage up to the pictures and their truth; what is returned does the others, which
        need no device, and makes the report. The caller writes that, but for errors."""
        while True:
            check_memory(self.plan)
            self.device = self._device()
            if self.device is None:
                done = self._work_up_to_truth()
            else:
                self.device_before = self.device.timer.seconds()
                prepare_figures()
                with compile_during(self.device, self.state.programs):
                    done = self._work_up_to_truth()
            if done is not None:
                return done
            # a result that was to be reused is damaged: its stage runs after all
            self.plan = self._planned()

    def _work_up_to_truth(self) -> Callable[[], Report] | None:
        """As `begin`; None if what is kept of an earlier run can't be used, and is forgotten."""
        self._in_memory()
        if not self._load_reused():
            return None
        self.warnings += self.state.retire(stage.name for stage in self.plan.stages)
        with self._failures():
            clean_leftovers(self.out)
            if any(stage.runs for stage in self.plan.stages if stage.name != "report"):
                # an earlier report must not speak for what a killed run leaves behind
                for name in ("report.html", "report.json"):
                    delete(self.out, name)
            write_text(inside(self.out, "scene.toml"), self.scene_text())
            if self.plan["mesh"].runs:
                self.state.record("mesh", self.plan["mesh"].key, [], self.notes["mesh"].content())
            self._stage(self.plan["solve"], self._solve)
            if self.device is not None:  # what shows a solution is needed more often than it
                self.device.programs.asked.clear()
            if not any(stage.camera and stage.state == "reused" for stage in self.plan.stages):
                self.state.programs = []
            self._pictures()
            self._stage(self.plan["truth"], self._truth)
        if self.capture is not None:
            self.capture.forget()  # the next one may need its memory
        if self.device is not None:
            self.seconds |= device_seconds(self.device, self.device_before)
        return self._end

    def _end(self) -> Report:
        with self._failures():
            self._stage(self.plan["measure"], self._measure)
            self._stage(self.plan["stress"], self._stress)
            self._stage(self.plan["export"], self._export)
            known = self.scene_warnings.notes(self.objects.solved)
            self.state.record("report", self.plan["report"].key, [], known.content())
        learn(self.speed, self.plan, self.stages, "" if self.device is None else self.device.name)
        if self.stresses is not None:
            self.stresses.close()
        return self.report()

    @contextmanager
    def _failures(self) -> Iterator[None]:
        """Write the report of a run that an error ends."""
        try:
            yield
        except Exception as error:
            told = with_known_warnings(error, self.scene_warnings.geometry)
            write_report(self.report(failure=failure_text(told)), self.out)
            if told is not error:
                raise told from error
            raise

    # -- the frame around each stage -------------------------------------------------------

    def _planned(self) -> Plan:
        given = self.options
        return make_plan(
            self.scene, self.out, given.backend, fresh=given.fresh, skip=given.skip,
            state=self.state, speed=self.speed,
        )  # fmt: skip

    def _device(self) -> Device | None:
        """Open the device before anything else, if a stage that runs needs it."""
        if self.options.backend == "numpy":
            return None
        if any(s.runs and s.name.split("/")[0] in ON_DEVICE for s in self.plan.stages):
            return default_device()
        return None

    def _in_memory(self) -> None:
        """Mesh, model and surfaces; faults in them show before the output folder is touched."""
        scene = self.scene
        self.stages, self.objects = [], SceneObjects(scene, self.history)
        check_views(scene)

        def meshes() -> str:
            self.objects.bodies = [build_body(body, scene.input) for body in scene.bodies]
            found = []
            for parts in self.objects.bodies:
                if parts.field is not None:
                    check_field(parts.field, self.history.factors)
                found.append(mesh_summary(parts.body.name, parts.mesh))
                found[-1][1].extend(size_warnings_of(parts.body.name, parts.body.mesh, parts.mesh))
            self.notes["mesh"] = Notes(
                tuple(text for _, texts in found for text in texts),
                meshes=tuple(summary for summary, _ in found),
            )
            return f"{sum(b.mesh.cell_count for b in self.objects.bodies)} elements"

        def models() -> str:
            from gpusim.pipeline.build.modelling import build_model

            self.models = [
                build_model(parts, groups)
                for parts, groups in zip(self.objects.bodies, self.history.groups, strict=True)
            ]
            return f"{len(self.models)} bodies"

        def surfaces() -> str:
            self.objects.props = [build_prop(prop, scene.input) for prop in scene.props]
            surfaces = self.objects.surfaces(None)
            return f"{sum(len(surface.faces) for surface in surfaces)} faces"

        for name, work in (("mesh", meshes), ("model", models), ("surface", surfaces)):
            self._timed(self.plan[name], work if self.plan[name].runs else None)
        kept = self.state.notes(self.plan["report"].key) if self.reuse else None
        built = self.objects if self.plan["surface"].runs else None
        self.scene_warnings = SceneWarnings.of(scene, self.history, built, kept)

    def _stage(self, planned: PlannedStage, work: Callable[[], StageResult]) -> None:
        """Run a stage, if it is to run, and record its files."""

        def recorded() -> str:
            self.note = ""
            made = work()
            self.notes[planned.name] = made.notes
            if self.device is not None and planned.name != "solve":
                self.state.add_programs(self.device.programs.asked)
            self.state.record(planned.name, planned.key, made.files, made.notes.content())
            return self.note or ", ".join(file.name for file in made.files[:3])

        self._timed(planned, recorded if planned.runs else None)

    def _timed(self, planned: PlannedStage, work: Callable[[], str] | None) -> None:
        started = time.perf_counter()
        text = planned.reason
        if work is not None:
            self.progress(planned.name, 0.0, planned.detail)
            try:
                text = work()
            except Exception as error:
                seconds = time.perf_counter() - started
                self.stages.append(Stage(planned.name, "failed", failure_text(error), seconds))
                raise
        seconds = time.perf_counter() - started
        self.stages.append(Stage(planned.name, planned.state, planned.reason, seconds))
        done = text if work is not None else f"{planned.state}: {text}"
        self.progress(planned.name, 1.0, done)

    # -- stages ----------------------------------------------------------------------------

    def _solve(self) -> StageResult:
        # what solves is imported where something is solved: most runs of a scene only look again
        from gpusim.pipeline.build.modelling import support_of_freedom
        from gpusim.pipeline.stages.mechanics import solve_bodies

        note = partial(self.progress, "solve")
        solutions = solve_bodies(
            self.scene.solver, self.objects.bodies, self.models, self.options, note
        )
        held = [support_of_freedom(parts) for parts in self.objects.bodies]
        solved = self.objects.solved = SceneSolution.of(solutions, self.models, held)
        self.seconds |= solver_seconds(solutions)
        self.note = f"{solved.iterations} iterations, estimated error {solved.error_estimate:.1e}"
        path = inside(self.out, "solution", "displacement.npz")
        with atomic_stream(path) as stream:
            np.savez(stream, allow_pickle=False, **self.objects.solved.arrays())
        return StageResult([path], Notes(adapter=self.own_adapter))

    def _load_reused(self) -> bool:
        """Load what an earlier run left for the stages that are reused. What is damaged is
        forgotten, with the reason; False then."""
        reload = {
            "solve": self._load_solution,
            "measure": self._load_measurements,
            "stress": self._load_stresses,
        }
        for stage in self.plan.stages:
            kept = self.state.notes(stage.key)
            if stage.state != "reused" and (stage.name != "mesh" or stage.runs or kept is None):
                continue
            try:
                self.notes[stage.name] = Notes.of(kept or {})
                if stage.name in reload:
                    reload[stage.name]()
                elif stage.camera is not None:
                    check_frame(self.scene, stage, self.state)
            except DAMAGE as error:
                self.state.drop(stage.key, f"what is kept of it is damaged: {error}")
                return False
        return True

    def _read(self, path: str) -> InputFile:
        """A file that a stage of this run or of an earlier one has recorded."""
        return self.state.read(Path(path))

    def _load_solution(self) -> None:
        (path,) = self.state.files(self.plan["solve"].key)
        with np.load(self.state.read(path).stream(), allow_pickle=False) as stored:
            solved = SceneSolution.from_arrays(stored)
        nodes = [parts.mesh.node_count for parts in self.objects.bodies]
        solved.check([len(groups) for groups in self.history.groups], nodes or None)
        self.objects.solved = solved

    def _pictures(self) -> None:
        scene = self.scene
        setup = images.CaptureSetup(
            scene, self.out, self.device, build_lights(scene), self.options, self._read
        )
        self.capture = images.FrameCapture(setup, self.objects.surfaces)
        targets = images.FrameCapture(setup, self.objects.target, "calib-")
        if not scene.cameras:
            self._timed(self.plan["render"], None)
        if self.plan["measure"].runs:  # a quarter of a second, beside the device
            Thread(target=import_module, args=("scipy.ndimage",), daemon=True).start()
        views = [stage for stage in self.plan.stages if stage.camera is not None]
        self._capture([stage for stage in views if stage.pose is None], self.capture)
        look = partial(write_corners, scene)
        with ThreadPoolExecutor(1, thread_name_prefix="gpusim.tracking") as aside:
            aside.submit(self._track_ahead)
            self._capture([stage for stage in views if stage.pose is not None], targets, look)

    def _track_ahead(self) -> None:
        """What can be measured while a calibration's pictures are taken; faults are met again."""
        specs = self.scene.measures if self.plan["measure"].runs else ()
        for spec in specs:
            if isinstance(spec, m.Stereo):
                with suppress(GpusimError):
                    track_in_cameras(spec, self.scene, self.objects, self._image, self.markers)

    def _capture(
        self,
        stages: Sequence[PlannedStage],
        capture: images.FrameCapture,
        look: Callable[[images.CapturedImage], list[Path]] | None = None,
    ) -> None:
        by_name = {camera.name: camera for camera in self.scene.cameras}
        wanted = (
            (by_name[stage.camera or ""], stage.frame or stage.pose or 0)
            for stage in stages
            if stage.runs
        )
        with CaptureQueue(capture, wanted, look) as queue:
            for planned in stages:
                self._stage(planned, queue.take)

    def _truth(self) -> StageResult:
        from gpusim.pipeline.stages.exports import write_truth  # HDF5 only where it is written

        assert self.capture is not None
        file = write_truth(
            self.scene, self.out, self.capture, self.objects.bodies, self.objects.displacement
        )
        return StageResult([file], Notes(adapter=self.own_adapter))

    def _measure(self) -> StageResult:
        files: list[Path] = []
        corners = partial(read_corners, self.scene, self.out, self._read)
        sources = Sources(self._image, corners, self.markers)
        for measure in self.scene.measures:
            result = measurements.run_measure(measure, self.scene, self.objects, sources)
            self.results.append(result)
            files += result.write(inside(self.out, "measure"))
            self.note = result.note
        return StageResult(files + self.markers.files)

    def _load_measurements(self) -> None:
        folder = inside(self.out, "measure")
        self.results = [
            measurements.read_result(measure, folder, self._read) for measure in self.scene.measures
        ]

    def _image(self, camera: str, frame: int, kind: str = "") -> npt.NDArray[Any]:
        path = images.image_path(self.scene, self.out, camera, frame, kind)
        image, shift = read_image(self.state.read(path)), self.scene.sensor_of(camera).shift
        return image >> shift if shift else image

    def _stress(self) -> StageResult:
        from gpusim.pipeline.stages.mechanics import write_stresses

        path = inside(self.out, "solution", "stress.npz")
        self.stresses = write_stresses(
            path, self.objects.bodies, self.models, self.history, self.objects.displacement,
            progress=partial(self.progress, "stress"),
        )  # fmt: skip
        most = max((peak.von_mises for peak in self.stresses.peaks), default=0.0)
        self.note = f"greatest von Mises stress {most / 1e6:.4g} MPa"
        return StageResult([path])

    def _load_stresses(self) -> None:
        from gpusim.pipeline.stages.mechanics import Stresses

        (path,) = self.state.files(self.plan["stress"].key)
        self.stresses = Stresses(self.state.open(path))

    def _export(self) -> StageResult:
        from gpusim.pipeline.stages.exports import write_meshes  # as are these formats

        files, warnings = write_meshes(
            self.scene, self.out, self.objects.bodies, self.objects.displacement, self.stresses
        )
        self.note = f"{len(files)} files for other programs"
        return StageResult(files, Notes(tuple(warnings)))
