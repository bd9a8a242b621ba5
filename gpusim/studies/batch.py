"""Samples made together: one graph of work, results by content in the study's store, and a row of
each sample as soon as all of its results are there."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

from gpusim.errors import DeviceLost, GpusimError, InputError, NoAdapter, NotConverged, SceneError
from gpusim.files.output_folder import inside
from gpusim.graph.folder import INNER
from gpusim.graph.graph import Graph, Task
from gpusim.graph.runner import Runner, StageFailed
from gpusim.graph.session import Session
from gpusim.graph.store import ResultChanged, Store
from gpusim.pipeline.measurements.results import Result
from gpusim.pipeline.runner.scene_report import failure_text, read_results
from gpusim.plan.decision import Decision
from gpusim.plan.scene_stages import SceneStages, scene_stages
from gpusim.plan.stages import RunOptions
from gpusim.scene import Scene
from gpusim.scene.shared_tables import SharedTables
from gpusim.studies.rows import RowLog
from gpusim.studies.samples import Sample
from gpusim.studies.study_tables import Study

_LOOK_S = 0.1
TRIES = 3
"""How often something is tried that may go wrong by chance."""
STOP = f"{INNER}/stop"
"""A file in a study's folder: where it lies, workers stop."""


class Stopped(Exception):
    """A worker was told to stop."""


def targets(study: Study, scene: Scene) -> set[str]:
    """The stages that a sample is made for; what pages and other programs show isn't among them."""
    names = {f"picture/{one.name}" for one in scene.cameras} | {"geometry"}
    names |= {*["truth", "labels"] * study.truth}
    return names | {f"measure/{one.name}" for one in scene.measures}


def bare(study: Study) -> Study:
    """The study of a scene without output that samples don't make: nobody looks at its stages."""
    output = study.scene.document["output"] if study.truth else {}
    kept = {key: output[key] for key in ("truth", "labels") if key in output}
    return replace(study, scene=study.scene.replace("output", {"fields": False, **kept}))


def result_keys(study: Study, sample: Sample) -> tuple[Scene, dict[str, list[str]]]:
    """The scene of a sample, and by stage the keys of its results in the study's store."""
    scene, graph = sample.scene(study), Graph()
    graph.add(scene_stages(scene, RunOptions(study.backend)).stages)
    return scene, graph.records[""]


class Worker:
    """What makes samples of the study in ``out`` in this process: its device, store and rows.

    Examples
    --------
    >>> from pathlib import Path
    >>> from gpusim.studies.batch import Worker
    >>> Worker(Path("out"), "numpy").session.options.backend
    'numpy'
    """

    def __init__(self, out: Path, backend: str) -> None:
        self.out = out
        self.store = Store(inside(out, INNER))
        self.session = Session(RunOptions(backend), results={})
        self.log = RowLog(out)
        self.stop = out / STOP

    def work_off(self, study: Study, samples: Sequence[Sample]) -> dict[int, str]:
        """Make some samples and add their rows; returns what became of them, by number.

        What goes wrong in a sample costs the samples that need it: at once where the scene is wrong
        or a solver finds no solution, else after `TRIES`. Raises what isn't theirs: a lost device,
        a disk that is full.
        """
        batch = _Batch(self, study, samples)
        batch.work_off()
        return batch.statuses

    def close(self) -> None:
        """Put the store in order, and flush the rows."""
        self.log.close()
        self.store.close()


@cache
def shared_worker(out: Path, backend: str) -> Worker:
    """This process's worker in a folder."""
    _workers.append(Worker(out, backend))
    return _workers[-1]


_workers: list[Worker] = []


def close_workers() -> None:
    """Put in order what the workers of this process have written."""
    while _workers:
        _workers.pop().close()
    shared_worker.cache_clear()


class _Batch:
    """Some ``samples`` on their way. ``left``: those without a row, by their place in the graph."""

    def __init__(self, worker: Worker, study: Study, samples: Sequence[Sample]) -> None:
        self.worker, self.study = worker, study
        self.left: dict[str, tuple[Sample, Scene, SceneStages]] = {}
        self.seconds: dict[str, float] = {}
        self.made: dict[str, str] = {}
        self.tries: Counter[str] = Counter()
        self.begun: set[str] = set()
        self.looks = 0.0  # when it is time to look whether to stop
        self.statuses: dict[int, str] = {}
        known = SharedTables()
        for sample in samples:
            try:
                scene = sample.scene(study, known)
            except GpusimError as error:
                self._add(sample, "refused", str(error))
                continue
            stages = scene_stages(scene, worker.session.options, known)
            self.left[str(sample.number)] = sample, scene, stages

    def work_off(self) -> None:
        """Until there is a row of each."""
        try:
            while self.left:
                try:
                    self._make()
                except StageFailed as failed:
                    self._fail(failed.task, failed.__cause__ or failed)
        finally:
            session = self.worker.session
            for kept in (session.values, session.kept, session.results or {}):
                kept.clear()

    def _make(self) -> None:
        """Make the results of those that are left. Raises StageFailed."""
        session, store, graph = self.worker.session, self.worker.store, Graph()
        wanted, scenes, stages = set[str](), dict[str, Scene](), dict[str, SceneStages]()
        for place, (_, scene, own) in self.left.items():
            graph.add(own.stages, place)
            wanted |= targets(self.study, scene)
            scenes[place], stages[place] = scene, own
        graph.decide(store, {}, targets=wanted)
        decision = Decision(scenes, stages, graph, {}, store, session.options)
        runner = Runner(graph, store, {}, session, self._observe)
        runner.work(lambda place: self._end(decision, place))

    def _observe(self, task: Task, done: float, words: str) -> None:
        """Hear of a task; any thread."""
        del words
        if (now := time.monotonic()) > self.looks:
            self.looks = now + _LOOK_S
            if self.worker.stop.exists():
                raise Stopped
        for place in {place for place, _ in task.places} - self.begun:
            self.begun.add(place)
            if place in self.left:
                self.worker.log.begin(self.left[place][0])
        if done >= 1.0 and task.seconds:
            self.seconds[task.key] = task.seconds
            if task.stage.keeps:
                self.made[task.key] = task.stage.name.split("/")[0]

    def _end(self, decision: Decision, place: str) -> None:
        """Add the row of a sample whose results are there; what it shares with others counts for
        the first."""
        sample, scene, _ = self.left[place]
        results = [self._result(decision, place, one.name) for one in scene.measures]
        measurements = [
            [item.name, item.unit, item.measured, item.truth, item.error]
            for result in results for item in result.measurements(scene)
        ]  # fmt: skip
        keys = {key for own in decision.graph.records[place].values() for key in own}
        made = Counter(self.made.pop(key) for key in keys & self.made.keys())
        seconds = sum(self.seconds.pop(key) for key in keys & self.seconds.keys())
        self._add(sample, "done", "", round(seconds, 4), measurements, made)
        del self.left[place]

    def _result(self, decision: Decision, place: str, measure: str) -> Result:
        """What was measured, now or before."""
        (key,) = decision.graph.records[place][f"measure/{measure}"]
        made = (self.worker.session.results or {}).get(key)
        return read_results(decision, place, measure)[0] if made is None else made

    def _fail(self, task: Task, cause: BaseException) -> None:
        """Add rows for the samples that need what came to nothing, unless it is tried again."""
        if isinstance(cause, DeviceLost | NoAdapter | Stopped):
            raise cause
        self.tries[task.key] += 1
        refused = isinstance(cause, InputError | SceneError)
        refused = refused and not isinstance(cause, ResultChanged)
        if not refused and not isinstance(cause, NotConverged) and self.tries[task.key] < TRIES:
            return
        for place in {place for place, _ in task.places} & self.left.keys():
            sample, *_ = self.left.pop(place)
            self._add(sample, "refused" if refused else "failed", failure_text(cause))

    def _add(self, sample: Sample, status: str, *what: Any) -> None:
        self.worker.log.add(sample, status, *what)
        self.statuses[sample.number] = status
