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
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from gpusim.errors import GpusimError
from gpusim.export.files import atomic_stream, clean_leftovers, write_text
from gpusim.export.images import read_image
from gpusim.gpu import Device, default_device
from gpusim.gpu.beforehand import meanwhile, not_needed
from gpusim.pipeline import images, measurements, outputs
from gpusim.pipeline.album import Album
from gpusim.pipeline.beforehand import (
    build_things,
    geometry_warnings,
    linear_theory,
    with_doubts,
)
from gpusim.pipeline.build import build_body, build_lights
from gpusim.pipeline.corners import read_corners, write_corners
from gpusim.pipeline.files import check_field, check_views
from gpusim.pipeline.kept import KeptMarkers
from gpusim.pipeline.learning import learn, spent_since
from gpusim.pipeline.mechanics import make_mechanics
from gpusim.pipeline.memory import check_memory
from gpusim.pipeline.meshing import mesh_summary
from gpusim.pipeline.props import build_prop
from gpusim.pipeline.solved import Solved
from gpusim.pipeline.stereo import follow_cameras
from gpusim.pipeline.things import Things
from gpusim.plan import Plan, PlannedStage, make_plan
from gpusim.report import (
    MeshSummary,
    Report,
    SolutionSummary,
    Stage,
    prepare_figures,
    write_report,
)
from gpusim.scene import Scene
from gpusim.scene import model as m
from gpusim.scene.amplitudes import LoadHistory
from gpusim.speed import Speed
from gpusim.state import StateFile

if TYPE_CHECKING:
    from gpusim.fem import Model
    from gpusim.pipeline.stresses import Stresses

__all__ = ["Progress", "Work"]

Progress = Callable[[str, float, str], None]


class Work:
    """One scene's stages, from nothing or from what an earlier run left in ``out``."""

    def __init__(
        self, scene: Scene, out: Path, backend: str, fresh: bool, skip: bool, progress: Progress
    ) -> None:
        # absolute: the state file takes relative names as names inside the folder
        self.scene, self.out, self.progress = scene, out.resolve(), progress
        self.backend, self.skip, self.reuse = backend, skip, skip and not fresh
        self.history = LoadHistory(scene, scaled=skip)
        self.speed = Speed.read(backend)
        self.plan: Plan = make_plan(scene, self.out, backend, fresh, skip, self.speed)
        self.stages: list[Stage] = []
        self.warnings: list[str] = []
        self.doubts: list[str] = []
        self.note = ""
        self.things = Things(scene, self.history)
        self.shown: Things | None = None
        """What is shown, unloaded, even where nothing needs to be built."""
        self.meshes: list[MeshSummary] = []
        self.models: list[Model] = []
        self.stresses: Stresses | None = None
        self.results: list[measurements.Result] = []
        self.markers = KeptMarkers(self.out / "measure", self.reuse)
        self.photographer: images.Photographer | None = None
        self.device: Device | None = None
        self.device_before: dict[str, float] = {}
        self.device_seconds: dict[str, float] = {}

    def begin(self) -> Callable[[], Report]:
        """Every stage up to the pictures and their truth; what is returned does the others, which
        need no device, and makes the report. The caller writes that, but for errors."""
        check_memory(self.plan)
        self.device = self._device()
        self.state = StateFile(self.out)
        if self.device is None:
            not_needed()
            return self._begun()
        self.device_before = self.device.timer.seconds()
        prepare_figures()
        with meanwhile(self.device, self.state.programs):
            return self._begun()

    def _begun(self) -> Callable[[], Report]:
        self._in_memory()
        self.warnings += self.state.retire(stage.name for stage in self.plan.stages)
        with self._failures():
            clean_leftovers(self.out)
            if any(stage.runs for stage in self.plan.stages if stage.name != "report"):
                # an earlier report must not speak for what a killed run leaves behind
                for name in ("report.html", "report.json"):
                    (self.out / name).unlink(missing_ok=True)
            write_text(
                self.out / "scene.toml", outputs.scene_text(self.scene, self._adapter_text())
            )
            self._stage(self.plan["solve"], self._solve, self._reload)
            if self.device is not None:  # what shows a solution is needed more often than it
                self.device.programs.asked.clear()
            self._pictures()
            self._stage(self.plan["truth"], self._truth)
        if self.photographer is not None:
            self.photographer.forget()  # the next one may need its memory
        if self.device is not None:
            self.state.note_programs(self.device.programs.asked)
            self.device_seconds = spent_since(self.device_before, self.device.timer.seconds())
        return self._end

    def _end(self) -> Report:
        with self._failures():
            self._stage(self.plan["measure"], self._measure, self._remeasure)
            self._stage(self.plan["stress"], self._stress, self._restress)
            self._stage(self.plan["export"], self._export)
        adapter = "" if self.device is None else self.device.name
        learn(self.speed, self.plan, self.stages, adapter)
        return self._report()

    @contextmanager
    def _failures(self) -> Iterator[None]:
        """Write the report of a run that an error ends."""
        try:
            yield
        except Exception as error:
            told = with_doubts(error, self.doubts)
            write_report(self._report(failure=outputs.said(told)), self.out)
            if told is not error:
                raise told from error
            raise

    # -- the frame around each stage -------------------------------------------------------

    def _device(self) -> Device | None:
        """Open the device before anything else, if a stage that runs needs it."""
        if self.backend == "numpy":
            return None
        needs = ("solve", "render", "truth")
        if any(s.runs and s.name.split("/")[0] in needs for s in self.plan.stages):
            return default_device()
        return None

    def _in_memory(self) -> None:
        """Mesh, model and surfaces; faults in them show before the output folder is touched."""
        scene = self.scene
        check_views(scene)

        def meshes() -> str:
            self.things.bodies = [build_body(body) for body in scene.bodies]
            for parts in self.things.bodies:
                if parts.field is not None:
                    check_field(parts.field, self.history.factors)
                summary, warnings = mesh_summary(parts.body.name, parts.mesh)
                self.meshes.append(summary)
                self.warnings += warnings
            return f"{sum(b.mesh.cell_count for b in self.things.bodies)} elements"

        def models() -> str:
            from gpusim.pipeline.modelling import build_model

            self.models = [
                build_model(parts, groups)
                for parts, groups in zip(self.things.bodies, self.history.groups, strict=True)
            ]
            return f"{len(self.models)} bodies"

        def surfaces() -> str:
            self.things.props = [build_prop(prop) for prop in scene.props]
            surfaces = self.things.surfaces(None)
            return f"{sum(len(surface.faces) for surface in surfaces)} faces"

        for name, work in (("mesh", meshes), ("model", models), ("surface", surfaces)):
            self._timed(self.plan[name], work if self.plan[name].runs else None)
        # warnings stay where the results are reused: they are of the scene, not of the work
        self.shown = self.things if self.plan["surface"].runs else build_things(scene, self.history)
        if self.shown is not None:
            self.doubts = geometry_warnings(self.shown)
            self.warnings += self.doubts

    def _stage(
        self,
        planned: PlannedStage,
        work: Callable[[], list[Path]],
        reload: Callable[[], None] | None = None,
    ) -> None:
        """Run a stage and record its files, or load what an earlier run left."""

        def recorded() -> str:
            self.note = ""
            files = work()
            self.state.record(planned.name, planned.key, files)
            return self.note or ", ".join(file.name for file in files[:3])

        if planned.runs:
            self._timed(planned, recorded)
            return
        if planned.state == "reused" and reload is not None:
            reload()
        self._timed(planned, None)

    def _timed(self, planned: PlannedStage, work: Callable[[], str] | None) -> None:
        started = time.perf_counter()
        text = planned.reason
        if work is not None:
            self.progress(planned.name, 0.0, planned.detail)
            try:
                text = work()
            except Exception as error:
                seconds = time.perf_counter() - started
                self.stages.append(Stage(planned.name, "failed", outputs.said(error), seconds))
                raise
        seconds = time.perf_counter() - started
        self.stages.append(Stage(planned.name, planned.state, planned.reason, seconds))
        done = text if work is not None else f"{planned.state}: {text}"
        self.progress(planned.name, 1.0, done)

    # -- stages ----------------------------------------------------------------------------

    def _solve(self) -> list[Path]:
        # what solves is imported where something is solved: most runs of a scene only look again
        from gpusim.pipeline.modelling import held_by
        from gpusim.pipeline.solving import solve_bodies

        note = partial(self.progress, "solve")
        solutions = solve_bodies(
            self.scene.solver, self.things.bodies, self.models, self.backend, note
        )
        held = [held_by(parts) for parts in self.things.bodies]
        solved = self.things.solved = Solved.of(solutions, self.models, held)
        self.note = f"{solved.iterations} iterations, estimated error {solved.error_estimate:.1e}"
        path = self.out / "solution" / "displacement.npz"
        with atomic_stream(path) as stream:
            np.savez(stream, allow_pickle=False, **self.things.solved.arrays())
        return [path]

    def _reload(self) -> None:
        (path,) = self.state.files(self.plan["solve"].key)
        with np.load(path) as stored:
            self.things.solved = Solved.from_arrays(dict(stored))

    def _pictures(self) -> None:
        scene = self.scene
        common = (scene, self.out, self.device, self.backend, build_lights(scene))
        self.photographer = images.Photographer(*common, self.things.surfaces, "", self.skip)
        targets = images.Photographer(*common, self.things.target, "calib-", self.skip)
        if not scene.cameras:
            self._timed(self.plan["render"], None)
        if self.plan["measure"].runs:  # a quarter of a second, beside the device
            Thread(target=import_module, args=("scipy.ndimage",), daemon=True).start()
        views = [stage for stage in self.plan.stages if stage.camera is not None]
        self._album([stage for stage in views if stage.pose is None], self.photographer)
        look = partial(write_corners, scene)
        with ThreadPoolExecutor(1, thread_name_prefix="gpusim.follow") as aside:
            aside.submit(self._follow)
            self._album([stage for stage in views if stage.pose is not None], targets, look)
        self.warnings += targets.warnings

    def _follow(self) -> None:
        """What can be measured while a calibration's pictures are taken; faults are met again."""
        specs = self.scene.measures if self.plan["measure"].runs else ()
        for spec in specs:
            if isinstance(spec, m.Stereo):
                with suppress(GpusimError):
                    follow_cameras(spec, self.scene, self.things, self._image, self.markers)

    def _album(
        self,
        stages: Sequence[PlannedStage],
        photographer: images.Photographer,
        look: Callable[[images.Shot], list[Path]] | None = None,
    ) -> None:
        by_name = {camera.name: camera for camera in self.scene.cameras}
        wanted = (
            (by_name[stage.camera or ""], stage.frame or stage.pose or 0)
            for stage in stages
            if stage.runs
        )
        with Album(photographer, wanted, look) as album:
            for planned in stages:
                self._stage(planned, album.take)

    def _truth(self) -> list[Path]:
        from gpusim.pipeline.truth import write_truth  # HDF5 only where it is written

        assert self.photographer is not None
        return [write_truth(self.scene, self.out, self.photographer, self.things.bodies,
                                    self.things.displacement)]  # fmt: skip

    def _measure(self) -> list[Path]:
        files: list[Path] = []
        sources = self._image, partial(read_corners, self.scene, self.out), self.markers
        for measure in self.scene.measures:
            result = measurements.measured(measure, self.scene, self.things, *sources)
            self.results.append(result)
            files += result.write(self.out / "measure")
            self.note = result.note
            self.warnings += result.warnings
        return files + self.markers.files

    def _remeasure(self) -> None:
        folder = self.out / "measure"
        self.results = [measurements.read(measure, folder) for measure in self.scene.measures]
        self.warnings += [w for result in self.results for w in result.warnings]

    def _image(self, camera: str, frame: int, kind: str = "") -> npt.NDArray[Any]:
        return read_image(images.image_path(self.scene, self.out, camera, frame, kind))

    def _stress(self) -> list[Path]:
        from gpusim.pipeline.stresses import write_stresses

        path = self.out / "solution" / "stress.npz"
        self.stresses = write_stresses(
            path, self.things.bodies, self.models, self.history, self.things.displacement,
            partial(self.progress, "stress"),
        )  # fmt: skip
        most = max((peak.von_mises for peak in self.stresses.peaks), default=0.0)
        self.note = f"greatest von Mises stress {most / 1e6:.4g} MPa"
        return [path]

    def _restress(self) -> None:
        from gpusim.pipeline.stresses import Stresses

        (path,) = self.state.files(self.plan["stress"].key)
        self.stresses = Stresses(path)

    def _export(self) -> list[Path]:
        from gpusim.pipeline.exporting import write_meshes  # as are these formats

        files = write_meshes(
            self.scene, self.out, self.things.bodies, self.things.displacement, self.stresses
        )
        self.note = f"{len(files)} files for other programs"
        return files

    # -- report ----------------------------------------------------------------------------

    def _adapter_text(self) -> str:
        if self.device is not None:
            return self.device.name
        return "none (numpy backend)" if self.backend == "numpy" else "not needed: all reused"

    def _report(self, failure: str = "") -> Report:
        summary = mechanics = None
        if self.things.solved is not None:
            s = self.things.solved
            summary = SolutionSummary(
                s.unknowns, s.iterations, s.converged, s.error_estimate, s.facts["method"]
            )
            peaks = () if self.stresses is None else self.stresses.peaks
            mechanics = make_mechanics(self.scene, s, self.history, peaks)
        linear = linear_theory(self.shown, self.things.solved)
        return outputs.make_report(
            self.scene,
            self.out,
            outputs.Findings(
                adapter=self._adapter_text(),
                stages=tuple(self.stages),
                summary=summary,
                solved=self.things.solved,
                mechanics=mechanics,
                meshes=tuple(self.meshes),
                results=() if failure else tuple(self.results),
                warnings=(
                    *(self.things.solved.warnings if self.things.solved else ()),
                    *(error.warning for error in linear if error.warning),
                    *self.warnings,
                    *(self.photographer.warnings if self.photographer else ()),
                ),
                failure=failure,
                files=frozenset(
                    file for stage in self.plan.stages for file in self.state.files(stage.key)
                ),
                device_seconds=self.device_seconds,
                linear={f"linear statics, {one.body}": one.fact for one in linear},
                images={} if self.photographer is None else self.photographer.facts,
            ),
        )
