"""A decided graph, worked off.

What needs the device is made here, one record after the other; what doesn't is made beside it by a
thread; files are written by two more. Values in memory are made when the first record needs them,
and let go with the last one.
"""

from __future__ import annotations

import shutil
import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import CancelledError, Executor, ThreadPoolExecutor
from functools import cached_property
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Any, BinaryIO

from gpusim.errors import require
from gpusim.files.input_file import InputFile
from gpusim.files.output_folder import inside
from gpusim.graph.folder import Folder
from gpusim.graph.graph import Graph, Task
from gpusim.graph.schedule import Schedule
from gpusim.graph.session import Session
from gpusim.graph.stage import StageResult
from gpusim.graph.store import Record, Store

AHEAD = 2
"""Records whose files are still being written while the next one is made."""
Observer = Callable[[Task, float, str], None]
"""Hears how far a task is, from 0 to 1, in words."""


class StageFailed(Exception):
    """A task came to nothing; the cause is its ``__cause__``."""

    def __init__(self, task: Task) -> None:
        super().__init__(task.stage.name)
        self.task = task


class Inputs:
    """What one record of a stage needs, and nothing else.

    ``inputs["mesh/bar"]`` is a value in memory, `read` and `open` give files by their names in the
    output folder, `notes` what was said of results. ``row``: the record's own data.
    """

    def __init__(self, task: Task, runner: Runner) -> None:
        self.key, self.record, self.row = task.key, task.record, task.stage.rows[task.record]
        self._task, self._runner = task, runner
        self._store = runner.store
        self._scratch: Path | None = None
        self._values: dict[str, list[Any]] = {}
        self._records: dict[str, list[Record]] = {}
        for name, keys in task.needs.items():
            if keys and not runner.graph.tasks[keys[0]].stage.keeps:
                self._values[name] = [runner.value(key) for key in keys]
            else:
                self._records[name] = [runner.record(key) for key in keys]

    def progress(self, done: float, words: str) -> None:
        """Say how far the stage is, from 0 to 1; ends it if the run is to end."""
        self._runner.go_on()
        self._runner.observe(self._task, min(done, 0.99), words)

    def __getitem__(self, name: str) -> Any:
        """The one value in memory of a stage. Raises KeyError for one that wasn't named."""
        (value,) = self._values[name]
        return value

    def get(self, name: str) -> Any:
        """The same; None where this record needs none of that stage."""
        return self[name] if name in self._values else None

    def has(self, name: str) -> bool:
        """Whether there are results of a stage."""
        return bool(self._records.get(name))

    def read(self, stage: str, name: str) -> InputFile:
        """A file of a result, as it was when it was made. Raises InputError; KeyError for a stage
        that wasn't named."""
        self._runner.go_on()
        return self._store.read(self._record(stage, name), name)

    def open(self, stage: str, name: str) -> BinaryIO:
        """The same of a file that may be large."""
        return self._store.open(self._record(stage, name), name)

    def path(self, stage: str, name: str) -> Path:
        """Where its content lies."""
        return self._store.blob(self._record(stage, name).files[name].sha256)

    def notes(self, stage: str) -> Sequence[Mapping[str, Any]]:
        """What was said of the results of a stage."""
        return [record.notes for record in self._records[stage]]

    def new_file(self, name: str) -> Path:
        """Where a file may be written that is to be kept under a name."""
        if self._scratch is None:
            self._scratch = self._store.scratch()
        path = inside(self._scratch, name)
        path.parent.mkdir(parents=True, exist_ok=True)
        return path

    def new_files(self) -> dict[str, Path]:
        """What was written, by name."""
        if self._scratch is None:
            return {}
        found = sorted(path for path in self._scratch.rglob("*") if path.is_file())
        return {path.relative_to(self._scratch).as_posix(): path for path in found}

    def forget(self) -> None:
        """Delete what was written and isn't kept."""
        if self._scratch is not None:
            shutil.rmtree(self._scratch, ignore_errors=True)

    def _record(self, stage: str, name: str) -> Record:
        held = (stage, name) in self._holding or stage not in self._records
        expected = f"{name}; its log may have been changed: delete {self._store.root}"
        require(held, f"store: files of {stage}", "others", expected)
        return self._holding[stage, name]

    @cached_property
    def _holding(self) -> dict[tuple[str, str], Record]:
        return {
            (stage, name): record
            for stage, records in self._records.items()
            for record in records
            for name in record.files
        }


class Runner:
    """Makes what is to run. ``folders``: by the names under which `Graph.add` knows them; scenes
    without one have their results in the store alone."""

    def __init__(
        self,
        graph: Graph,
        store: Store,
        folders: Mapping[str, Folder],
        session: Session,
        observe: Observer,
    ) -> None:
        self.graph, self.store, self.folders = graph, store, folders
        self.session, self.observe = session, observe
        self._schedule = Schedule(graph)
        self._finished: SimpleQueue[tuple[Task, BaseException | None, bool]] = SimpleQueue()
        self._ends = False
        self._writing = self._beside = 0
        self._early: dict[str, StageResult] = {}
        self._left = Counter(
            place for task in graph.order() for place in {place for place, _ in task.places}
        )
        self._users = Counter(
            key
            for task in graph.tasks.values() if task.runs
            for keys in task.needs.values() for key in keys
            if not graph.tasks[key].stage.keeps
        )  # fmt: skip

    def make_early(self) -> None:
        """Make what must show its faults before anything is written, of the first scene: stages
        that are early, which are kept when `work` comes to them, and values that need no results.
        Raises StageFailed."""
        for task in self.graph.order():
            if task.order[0] or self._schedule.made_of(task):
                continue
            if task.stage.early:
                self._early[task.key] = self._made(task, Inputs(task, self))
            else:
                self._make_first_values(task)

    def _make_first_values(self, task: Task) -> None:
        """Make what a task needs that is a value in memory, made of no results and no picture."""
        for key in (key for keys in task.needs.values() for key in keys):
            need = self.graph.tasks[key]
            if need.stage.keeps or self._schedule.made_of(need):
                continue
            if need.stage.on_device:
                self._make_first_values(need)
            else:
                self.value(key)

    def work(self, whole: Callable[[str], None]) -> None:
        """Make, keep and show everything. ``whole`` is called for each scene as soon as all of its
        results are there. Raises StageFailed; what is finished by then is kept."""
        schedule = self._schedule
        for place in self.graph.records:
            if not self._left[place]:
                whole(place)
        with (
            ThreadPoolExecutor(1, "gpusim.host") as host,
            ThreadPoolExecutor(AHEAD, "gpusim.write") as writers,
        ):
            try:
                while schedule.left:
                    task = None if self._beside else schedule.take(on_device=False)
                    if task is None and self._writing <= AHEAD:
                        task = schedule.take(on_device=True)
                    if task is not None:
                        self._begin(task, writers if task.stage.on_device else host)
                    self._collect(whole, wait=task is None)
            except BaseException:
                self._ends = True
                raise

    def go_on(self) -> None:
        """Raises CancelledError if the run is to end: a thread that works on is waited for."""
        if self._ends:
            raise CancelledError

    def value(self, key: str) -> Any:
        """A value in memory, made now if it isn't there."""
        values = self.session.values
        if key not in values:
            task = self.graph.tasks[key]
            values[key] = self._made(task, Inputs(task, self))
            self.observe(task, 1.0, "")
            self._let_go(task)
        return values[key]

    def record(self, key: str) -> Record:
        """A result that is there."""
        found = self.store.find(key)
        assert found is not None, self.graph.tasks[key].stage.name
        return found

    def _begin(self, task: Task, pool: Executor) -> None:
        """Make a task, or find it made; put it off if another process is making it."""
        if not self.store.claim(task.key):
            self._schedule.defer(task)
            return
        self.store.refresh()  # it may have been made while nobody looked
        if self.store.fault(task.key, task.stage.name) is None:
            self._keep(task)
            return
        inputs = None
        try:
            inputs = Inputs(task, self)
            known = self._early.pop(task.key, None)
            if known is None and task.stage.on_device:
                known = self._made(task, inputs)
        except BaseException:
            self.store.release(task.key)
            if inputs is not None:
                inputs.forget()
            raise
        if task.stage.on_device:
            self._writing += 1
        else:
            self._beside += 1
        if known is not None and all(isinstance(one, bytes) for one in known.files.values()):
            self._keep(task, lambda: known, inputs)  # small: who needs it can go on at once
        else:
            pool.submit(self._keep, task, lambda: known or self._made(task, inputs), inputs)

    def _made(self, task: Task, inputs: Inputs) -> Any:
        """Call a stage's function. Raises StageFailed."""
        self.observe(task, 0.0, "")
        start = time.perf_counter()
        try:
            return task.stage.function()(task.stage.argument, inputs, self.session)
        except Exception as error:
            raise StageFailed(task) from error
        finally:
            task.seconds += time.perf_counter() - start

    def _keep(
        self,
        task: Task,
        make: Callable[[], StageResult] | None = None,
        inputs: Inputs | None = None,
    ) -> None:
        """Keep a result (None: it is there), show it, and say so."""
        failure: BaseException | None = None
        words = "made by another run"
        try:
            if make is not None:
                made = make()
                start = time.perf_counter()
                record = self.store.put(task.key, task.stage.name, made.files, made.notes)
                for stage, name in made.holds.items():
                    for key in task.needs[stage]:
                        self.store.move(self.record(key), record.files[name])
                task.seconds += time.perf_counter() - start
                words = made.words
            self.show(task)
            self.observe(task, 1.0, words)
        except BaseException as error:
            failure = error
        finally:
            self.store.release(task.key)
            if inputs is not None:
                inputs.forget()
            self._finished.put((task, failure, inputs is not None))

    def show(self, task: Task) -> None:
        """Give a result its names in the folders that have it."""
        for place in dict.fromkeys(place for place, _ in task.places if place in self.folders):
            self.folders[place].show(self.record(task.key), self.store)

    def _collect(self, whole: Callable[[str], None], wait: bool) -> None:
        """Take in what threads have finished; ``wait`` for something to happen."""
        while wait or not self._finished.empty():
            try:
                task, failure, pooled = self._finished.get(timeout=self._schedule.patience_s)
            except Empty:  # another process is at what may be ready
                self._schedule.resume()
                return
            wait = False
            self._writing -= pooled and task.stage.on_device
            self._beside -= pooled and not task.stage.on_device
            if failure is not None and (
                isinstance(failure, StageFailed) or not isinstance(failure, Exception)
            ):
                raise failure
            if failure is not None:
                raise StageFailed(task) from failure
            self._schedule.finish(task)
            self._let_go(task)
            for place in {place for place, _ in task.places}:
                self._left[place] -= 1
                if not self._left[place]:
                    whole(place)

    def _let_go(self, task: Task) -> None:
        """Forget values that no task needs any more, those never made included."""
        for key in [key for keys in task.needs.values() for key in keys if key in self._users]:
            self._users[key] -= 1
            if not self._users[key]:
                del self._users[key]
                if key not in self.session.values:
                    self.observe(self.graph.tasks[key], 1.0, "")  # nobody will make it
                    self._let_go(self.graph.tasks[key])
                self.session.values.pop(key, None)
