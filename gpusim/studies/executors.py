"""Where samples are made: in this process, in others of this machine, or on a cluster.

One loop hands out batches and reads what workers have appended to the study's folder. Nothing is
known but what lies there, so that whatever dies costs what it was making.
"""

from __future__ import annotations

import os
import warnings
from collections import Counter, deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, CancelledError, Future, wait
from contextlib import suppress
from pathlib import Path
from typing import Any, Protocol
from weakref import WeakKeyDictionary

from gpusim.errors import DeviceLost, GpusimError
from gpusim.files.atomic_files import write_text
from gpusim.files.output_folder import delete, inside
from gpusim.gpu.adapter import software_adapter
from gpusim.parallel.machine import all_processors, host_memory
from gpusim.parallel.processes import start_pool
from gpusim.studies.batch import STOP, TRIES, Worker, close_workers, shared_worker
from gpusim.studies.passing import Passing
from gpusim.studies.plan import StudyPlan
from gpusim.studies.rows import RowLog, RowReader
from gpusim.studies.samples import Sample, samples_of
from gpusim.studies.study_tables import Study

MOST_TOGETHER = 32
"""Samples in one graph of work."""
_AHEAD = 2  # batches handed out for each worker
_LOOK_S = 0.3
_WORKER_BYTES = 400_000_000  # of a process that has imported everything
Told = Callable[[Counter[str]], None]
"""Hears how many samples have come to which status."""


class Pool(Protocol):
    """Who makes batches: ``size`` workers."""

    size: int

    def submit(self, function: Callable[..., Any], *args: Any) -> Future[Any]:
        """Call a function somewhere."""

    def renew(self, future: Future[Any]) -> None:
        """Make anew what a call has died in."""

    def close(self, kill: bool) -> None:
        """End the workers, ``kill``: at once."""


class Here:
    """This process. ``submit`` returns when the call is done."""

    size = 1

    def __init__(self, worker: Worker) -> None:
        self.worker = worker

    def submit(self, function: Callable[..., Any], *args: Any) -> Future[Any]:
        """Make a batch now; errors are raised here."""
        del function
        study, samples, _ = args
        future: Future[Any] = Future()
        future.set_result(self.worker.work_off(study, samples))
        return future

    def renew(self, future: Future[Any]) -> None:
        """Nothing dies here alone."""
        raise future.exception() or CancelledError

    def close(self, kill: bool) -> None:
        """Put the store in order."""
        del kill
        self.worker.close()


class LocalPool:
    """``size`` processes of this machine, each with an executor of its own: if one dies, the others
    go on. Each has its share of the processors, and a device by its number."""

    def __init__(self, size: int) -> None:
        self.size = size
        self._executors: list[Any] = [self._start(number) for number in range(size)]
        self._homes: WeakKeyDictionary[Future[Any], Any] = WeakKeyDictionary()

    def _start(self, number: int) -> Any:
        threads = str(max(all_processors() // self.size, 1))
        names = "GPUSIM_PROCESSORS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "LP_NUM_THREADS"
        env = dict.fromkeys(names, threads)
        if "GPUSIM_ADAPTER" not in os.environ and not software_adapter():
            env["GPUSIM_ADAPTER"] = str(number)
        return start_pool(1, (), env)

    def submit(self, function: Callable[..., Any], *args: Any) -> Future[Any]:
        """Call it where there is least to do."""
        load = Counter(id(home) for future, home in self._homes.items() if not future.done())
        home = min(self._executors, key=lambda executor: load[id(executor)])
        try:
            future: Future[Any] = home.submit(function, *args)
        except BrokenExecutor:  # it has died of nothing
            home = self._replace(home)
            future = home.submit(function, *args)
        self._homes[future] = home
        return future

    def renew(self, future: Future[Any]) -> None:
        """Start the process anew that a call has died in, if nobody has yet."""
        if self._homes[future] in self._executors:
            self._replace(self._homes[future])

    def _replace(self, executor: Any) -> Any:
        executor.shutdown(wait=False, kill_workers=True)
        number = self._executors.index(executor)
        self._executors[number] = self._start(number)
        return self._executors[number]

    def close(self, kill: bool) -> None:
        """End the processes."""
        for executor in self._executors:
            with suppress(BrokenExecutor):
                if not kill:
                    executor.submit(close_workers)
            executor.shutdown(wait=not kill, kill_workers=kill)


def make_batch(study: Study, samples: Sequence[Sample], out: str) -> dict[int, str]:
    """Make some samples in this process, a worker of the study in ``out``; returns what became of
    them, by number."""
    return shared_worker(Path(out), study.backend).work_off(study, samples)


class Client:
    """Has ``samples`` of a study made by a ``pool``.

    ``structures``: a number for each sample; those of one number are made together. ``told`` hears
    of every change.
    """

    def __init__(
        self, study: Study, samples: Sequence[Sample], structures: Sequence[int], out: Path,
        pool: Pool, told: Told,
    ) -> None:  # fmt: skip
        self.study, self.out, self.pool, self.told = study, out, pool, told
        self.left = {sample.number: sample for sample in samples}
        self.counts: Counter[str] = Counter()
        size = min(max(-(-len(samples) // (3 * pool.size)), 1), MOST_TOGETHER)
        self._queue = deque(_batches(samples, structures, size))
        self._pending: dict[Future[Any], Sequence[Sample]] = {}
        self._tries: Counter[int] = Counter()
        self._begun: set[int] = set()
        self._deaths = 0  # since a sample was finished
        self._keys = {sample.number: sample.key for sample in samples}
        self._log, self._reader = RowLog(out), RowReader(out)
        keeps = study.tables.keep == "results"
        self._passing = None if keeps else Passing(study, samples_of(study), out)
        for _ in self._reader.new():  # of earlier calls
            pass

    def work_off(self) -> None:
        """Until there is a row of each sample.

        An interrupt ends it after what workers are at; another one at once. Raises what is wrong
        beside the samples: a full disk, a device that is lost, workers that can't begin.
        """
        delete(self.out, STOP)
        try:
            while self.left:
                ahead = self.pool.size * _AHEAD
                while self._queue and len(self._pending) < ahead:
                    batch = self._queue.popleft()
                    future = self.pool.submit(make_batch, self.study, batch, str(self.out))
                    self._pending[future] = batch
                done, _ = wait(self._pending, _LOOK_S, FIRST_COMPLETED)
                self.look()
                for future in done:
                    self._take(future, self._pending.pop(future))
        except BaseException:
            self._stop()
            raise
        finally:
            self._log.close()
        self.look()
        self.pool.close(kill=False)

    def look(self) -> None:
        """Read what workers have appended."""
        for line in self._reader.new():
            if "begun" in line:
                self._begun.add(line["begun"])
            elif "key" in line and line["key"] == self._keys.get(line["number"]):
                self._count(line["number"], line["status"])
        if self._passing is not None:
            self._passing.drop(self.left.keys())
        self.told(self.counts)

    def _count(self, number: int, status: str) -> None:
        if self.left.pop(number, None) is not None:
            self.counts[status] += 1
            self._deaths = 0

    def _take(self, future: Future[Any], batch: Sequence[Sample]) -> None:
        """Take in how a batch has ended."""
        error = future.exception() if not future.cancelled() else CancelledError()
        if error is None:
            for number, status in future.result().items():
                self._count(number, status)
            return
        died = isinstance(error, BrokenExecutor | CancelledError | DeviceLost)
        if not died and not type(error).__module__.startswith("distributed"):
            raise error
        self._deaths += 1
        if self._deaths > TRIES * (self.pool.size + len(batch)):
            raise GpusimError(f"study: workers die before anything is made; got {error}") from error
        self.pool.renew(future)
        rest = [sample for sample in batch if sample.number in self.left]
        others = [sample for sample in rest if sample.number not in self._begun]
        if others:
            self._queue.appendleft(others)
        for sample in rest:
            if sample.number not in self._begun:
                continue
            self._begun.remove(sample.number)  # alone from now on: what it dies of is its own
            self._tries[sample.number] += 1
            if self._tries[sample.number] < TRIES:
                self._queue.appendleft([sample])
            else:
                words = f"its worker has died {TRIES} times: out of memory, or ended from outside"
                self._log.add(sample, "killed", words)
                self._count(sample.number, "killed")

    def _stop(self) -> None:
        """End what workers are at, after the stages that they are in the middle of."""
        write_text(inside(self.out, STOP), "")
        kill = True
        try:
            for future in self._pending:
                future.cancel()
            wait(self._pending)
            kill = False
        finally:
            self.pool.close(kill)
            delete(self.out, STOP)


def local_workers(asked: int, plan: StudyPlan) -> int:
    """How many workers fit the free memory, at most those that were asked for."""
    fitting = max(int(host_memory() // (_WORKER_BYTES + plan.memory_bytes)), 1)
    if fitting < asked:
        warnings.warn(
            f"{fitting} workers in place of {asked}: each takes about "
            f"{(_WORKER_BYTES + plan.memory_bytes) / 1e9:.2g} GB of memory", stacklevel=2,
        )  # fmt: skip
    return min(asked, fitting)


def _batches(
    samples: Sequence[Sample], structures: Sequence[int], size: int
) -> Iterator[list[Sample]]:
    """Samples of one structure side by side, at most ``size`` together; those of several where all
    of each fit in."""
    groups: dict[int, list[Sample]] = {}
    for sample, structure in zip(samples, structures, strict=True):
        groups.setdefault(int(structure), []).append(sample)
    batch: list[Sample] = []
    for group in groups.values():
        if batch and len(batch) + len(group) > size:
            yield batch
            batch = []
        batch += group
        while len(batch) >= size:
            yield batch[:size]
            batch = batch[size:]
    if batch:
        yield batch
