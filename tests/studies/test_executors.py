"""Workers that die, workers that can't begin, and two processes beside this one."""

from __future__ import annotations

import os
import signal
import time
from collections import Counter
from collections.abc import Callable
from concurrent.futures import BrokenExecutor, Future
from pathlib import Path
from typing import Any

import pytest

import gpusim as gs
from gpusim.errors import GpusimError
from gpusim.files.output_folder import inside
from gpusim.studies import load_study, samples_of
from gpusim.studies.executors import Client, LocalPool, _batches
from gpusim.studies.rows import RowLog, read_rows
from gpusim.studies.samples import Sample
from tests.studies.small_studies import STUDY, write_study


class DyingPool:
    """Workers that say they make samples, and die of those with ``fatal`` numbers."""

    size = 2

    def __init__(self, out: Path, fatal: set[int], begins: bool = True) -> None:
        self.out, self.fatal, self.begins = out, fatal, begins
        self.made: Counter[int] = Counter()
        self.renewed, self.closed = 0, ""

    def submit(self, function: Callable[..., Any], *args: Any) -> Future[Any]:
        _, samples, _ = args
        future: Future[Any] = Future()
        log = RowLog(self.out)
        found: dict[int, str] = {}
        for sample in samples:
            if self.begins:
                log.begin(sample)
                self.made[sample.number] += 1
            if not self.begins or sample.number in self.fatal:
                future.set_exception(BrokenExecutor("killed"))
                return future
            log.add(sample, "done")
            found[sample.number] = "done"
        future.set_result(found)
        return future

    def renew(self, future: Future[Any]) -> None:
        self.renewed += 1

    def close(self, kill: bool) -> None:
        self.closed = "killed" if kill else "ended"


def client(folder: Path, pool: DyingPool) -> tuple[Client, list[Sample]]:
    study = load_study(write_study(folder, STUDY.replace("repeats = 2", "repeats = 10")))
    samples = list(samples_of(study))
    inside(pool.out, ".gpusim").mkdir(parents=True)
    return Client(study, samples, [0] * len(samples), pool.out, pool, lambda _: None), samples


def test_a_death_costs_the_sample_that_workers_die_of(tmp_path: Path) -> None:
    pool = DyingPool(tmp_path / "out", {5, 20})
    whole, samples = client(tmp_path, pool)
    whole.work_off()
    rows = read_rows(pool.out, samples)
    assert {n for n, row in rows.items() if row["status"] == "killed"} == {5, 20}
    assert Counter(row["status"] for row in rows.values()) == {"done": 38, "killed": 2}
    assert pool.made == Counter(dict.fromkeys(range(40), 1)) | Counter({5: 3, 20: 3})
    assert pool.renewed == 6
    assert pool.closed == "ended"


def test_workers_that_cannot_begin_end_the_study(tmp_path: Path) -> None:
    pool = DyingPool(tmp_path / "out", set(), begins=False)
    whole, _ = client(tmp_path, pool)
    with pytest.raises(GpusimError, match="die before anything is made; got killed"):
        whole.work_off()
    assert pool.renewed < 60


def test_an_interrupt_ends_workers(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pool = DyingPool(tmp_path / "out", set())
    whole, _ = client(tmp_path, pool)

    def interrupted() -> None:
        assert pool.closed == ""
        raise KeyboardInterrupt

    monkeypatch.setattr(whole, "look", interrupted)
    with pytest.raises(KeyboardInterrupt):
        whole.work_off()
    assert pool.closed == "ended"
    assert not (pool.out / ".gpusim/stop").exists()


def test_neighbours_of_one_structure_are_made_together(tmp_path: Path) -> None:
    study = load_study(write_study(tmp_path, STUDY.replace("repeats = 2", "repeats = 10")))
    samples = samples_of(study)
    structures = [sample.number % 4 for sample in samples]
    found = list(_batches(samples, structures, 16))
    assert [[one.number % 4 for one in batch] for batch in found] == [[k] * 10 for k in range(4)]
    assert [len(batch) for batch in _batches(samples, structures, 25)] == [20, 20]
    assert [len(batch) for batch in _batches(samples, [0] * 40, 16)] == [16, 16, 8]


def test_a_process_that_was_killed_is_started_anew() -> None:
    pool = LocalPool(1)
    try:
        first = pool.submit(os.getpid).result()
        dying = pool.submit(time.sleep, 60)
        waiting = pool.submit(os.getpid)
        os.kill(first, signal.SIGKILL)
        for future in (dying, waiting):
            assert isinstance(future.exception(60), BrokenExecutor)
            pool.renew(future)
        second = pool.submit(os.getpid).result()
        os.kill(second, signal.SIGKILL)  # of nothing that it was at
        end = time.monotonic() + 60.0
        while pool._executors[0]._flags.broken is None and time.monotonic() < end:
            time.sleep(0.01)
        assert len({first, second, pool.submit(os.getpid).result()}) == 3
    finally:
        pool.close(kill=False)


def test_two_processes_make_the_same(tmp_path: Path) -> None:
    path = write_study(tmp_path)
    table = gs.study(path, tmp_path / "two", workers=2)
    alone = gs.study(path, tmp_path / "one")
    assert table["status"].tolist() == ["done"] * 8
    for quantity in alone.quantities:
        assert table.of(quantity, "measured").tolist() == alone.of(quantity, "measured").tolist()
    samples = samples_of(load_study(path))
    made: Counter[str] = Counter()
    for row in read_rows(tmp_path / "two", samples).values():
        made.update(row["made"])
    assert made["solve"] == 2
    assert made["picture"] == 12
