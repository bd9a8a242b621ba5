"""Two processes and one store; and processes that are killed."""

from __future__ import annotations

import multiprocessing
import os
import random
import signal
import subprocess
import sys
import time
from collections import Counter
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest

from gpusim.files.atomic_files import clean_leftovers
from gpusim.graph.log import read_log
from gpusim.graph.stage import digest
from gpusim.graph.store import Store
from tests.graph.toy_stages import FRAMES, ToyRun, framed, run_frames

_context = multiprocessing.get_context("forkserver")
_context.set_forkserver_preload(["tests.graph.toy_stages"])
KEY, OTHER, THIRD = (digest(number) for number in range(3))


def begun(seed: int, out: Path, store: Path) -> Any:
    process = _context.Process(target=run_frames, args=(seed, out, store))
    process.start()
    return process


def makers(store: Path) -> Counter[str]:
    """How often each stage's results were recorded by those who made them, before and after logs
    were put together."""
    own = Counter[str]()
    for path in (store / "log").glob("[1-9]*.log"):
        own.update(line["stage"] for line in read_log(path)[0] if "key" in line)
    return own


def test_two_at_once_make_each_result_once(tmp_path: Path) -> None:
    store = tmp_path / "store"
    keeper = Store(store)  # its log is of a living process: nothing of others is lost in it
    pair = [begun(seed, tmp_path / str(seed), store) for seed in (1, 2)]
    for process in pair:
        process.join(60)
        assert process.exitcode == 0
    keeper.refresh()
    records = list(keeper._records.values())
    made = Counter(record.stage for record in records)
    assert made == {"solve": 1, "radiance": FRAMES, "truth": 5, "picture": 2 * FRAMES}
    who = Counter(record.notes["maker"] for record in records if record.stage == "radiance")
    assert set(who) <= {process.pid for process in pair}
    blobs = [path for path in (store / "blobs").rglob("*") if path.is_file()]
    assert len(blobs) == 1 + FRAMES + 5 + 2 * FRAMES
    for seed in (1, 2):
        alone = ToyRun(framed(seed, 0.01), tmp_path / f"alone{seed}")
        alone.work()
        shown = ToyRun(framed(seed, 0.01), tmp_path / str(seed), store)
        assert shown.graph.order() == [] and shown.files == alone.files


def test_a_result_of_two_processes_is_begun_once(tmp_path: Path) -> None:
    """Who comes later waits for what is being made, and does all else meanwhile."""
    store, chance = tmp_path / "store", random.Random(5)
    for number in range(3):
        out = tmp_path / str(number)
        pair = [begun(number * 10 + seed, out / str(seed), store) for seed in (1, 2)]
        time.sleep(chance.uniform(0.0, 0.2))
        for process in pair:
            process.join(60)
            assert process.exitcode == 0
        assert all((out / str(seed) / "picture/0029.txt").is_file() for seed in (1, 2))
    found = Store(store)
    assert Counter(record.stage for record in found._records.values())["radiance"] == FRAMES


@pytest.mark.parametrize("number", range(4))
def test_one_of_two_is_killed(tmp_path: Path, number: int) -> None:
    chance, store = random.Random(number), tmp_path / "store"
    pair = [begun(seed, tmp_path / str(seed), store) for seed in (1, 2)]
    while not list(store.glob("log/*")) and pair[0].is_alive():
        time.sleep(0.005)
    time.sleep(chance.uniform(0.0, 0.25))
    pair[0].kill()
    pair[1].join(60)
    assert pair[1].exitcode == 0
    again = ToyRun(framed(1), tmp_path / "1", store)
    known = {task.key for task in again.graph.tasks.values() if task.state == "reused"}
    again.store.clean()
    again.work()
    assert "solve" not in again.counted and "radiance" not in again.counted  # the other's
    assert all(task.key not in known for task in again.graph.order())
    for seed in (1, 2):
        alone = ToyRun(framed(seed), tmp_path / f"alone{seed}").work()
        shown = ToyRun(framed(seed), tmp_path / str(seed), store)
        assert shown.graph.order() == [] and shown.files == alone.files


def test_killed_at_any_moment_and_continued(tmp_path: Path) -> None:
    """Ten times: the same files, and nothing is made twice that was recorded."""
    chance = random.Random(34)
    whole = ToyRun(framed(1), tmp_path / "whole").work()
    killed = 0
    for number in range(30):
        if killed >= 10:
            break
        out, store = tmp_path / f"out{number}", tmp_path / f"store{number}"
        recorded: set[str] = set()
        for _ in range(chance.choice((1, 2, 4))):
            before = {*store.glob("log/*")}
            process = begun(1, out, store)
            while before == {*store.glob("log/*")} and process.is_alive():
                time.sleep(0.002)
            time.sleep(chance.uniform(0.0, 0.5))
            with suppress(ProcessLookupError):  # it was quicker
                os.kill(process.pid, signal.SIGKILL)
            process.join()
            killed += process.exitcode == -signal.SIGKILL
            found = Store(store)
            assert recorded <= {key for key in found._records}
            recorded = set(found._records)
        last = ToyRun(framed(1), out, store)
        assert {task.key for task in last.graph.order()}.isdisjoint(recorded)
        last.store.clean()
        clean_leftovers(out)  # as runs do
        last.work()
        assert last.files == whole.files, number
        assert len(last.made) == len(last.graph.tasks) - len(recorded), number
        names = {path.name for path in store.rglob("*") if path.is_file()}
        assert not [name for name in names if name.startswith(".")], number
        assert len(list(store.glob("log/*"))) == 1
    assert killed >= 10


CLAIM = """
import sys
from pathlib import Path
from gpusim.graph.store import Store
store = Store(Path(sys.argv[1]))
for line in sys.stdin:
    what, key = line.split()
    print(getattr(store, what)(key), flush=True)
"""


def test_a_claim_is_one_process_s_until_it_ends(tmp_path: Path) -> None:
    store = Store(tmp_path)
    other = subprocess.Popen([sys.executable, "-c", CLAIM, str(tmp_path)], text=True,
                             stdin=subprocess.PIPE, stdout=subprocess.PIPE)  # fmt: skip

    def says(what: str, key: str) -> str:
        assert other.stdin is not None and other.stdout is not None
        print(what, key, file=other.stdin, flush=True)
        return other.stdout.readline().strip()

    with other:
        assert says("claim", KEY) == "True" and not store.claim(KEY)
        assert store.claim(OTHER) and says("claim", OTHER) == "False"
        says("release", KEY)
        assert store.claim(KEY) and says("claim", KEY) == "False"
        assert says("claim", THIRD) == "True"
        other.kill()
        other.wait()
    assert store.claim(THIRD)
    store.close()
