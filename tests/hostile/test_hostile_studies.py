"""Studies whose workers, scheduler and client are killed at any moment, and which are called again:
nothing lost, nothing made twice, the same bytes as in an undisturbed one."""

from __future__ import annotations

import csv
import random
import time
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

import gpusim as gs
import gpusim.studies.study
from gpusim.graph.folder import INNER
from gpusim.graph.log import read_log
from gpusim.studies import load_study, samples_of
from gpusim.studies.rows import read_rows
from tests.hostile.amount import SEED, share
from tests.hostile.killed_studies import Cluster, Local, Makers, Recorded
from tests.hostile.tiny_runs import LIMIT, Begun, files, wrong
from tests.studies.small_studies import FOCAL, YOUNG, write_study

pytestmark = pytest.mark.hostile

TOGETHER = 10
"""Kills in one study."""
LIMIT_S = 5.0 * LIMIT
"""After which nothing comes any more: a worker's death costs a start, on a machine that is busy."""
STUDY = f"""scene = "bar.toml"
backend = "numpy"
repeats = {max(2, share(5))}
[[parameter]]
key = "{YOUNG}"
list = [60.0, 65.0, 70.0, 75.0]
name = "E"
[[parameter]]
key = "{FOCAL}"
list = [29.0, 30.0]
name = "f"
"""


@dataclass(frozen=True)
class Study:
    """A study's file, its folder, and how many results are recorded in an undisturbed one."""

    path: Path
    out: Path
    results: int = 0


def without_page(patch: pytest.MonkeyPatch | None = None) -> None:
    """Figures and page take as long as the samples: from now on they aren't made."""
    set_it = setattr if patch is None else patch.setattr
    set_it(gpusim.studies.study, "write_study_report", lambda *_: None)


def made_here(study: Study) -> None:
    """Call it in this process, without a page."""
    with pytest.MonkeyPatch.context() as patch:
        without_page(patch)
        gs.study(study.path, study.out)


def rows(study: Study) -> dict[int, dict[str, Any]]:
    """What became of its samples, but for who made what, and how long that took."""
    found = read_rows(study.out, samples_of(load_study(study.path)))
    timed = "seconds", "made"
    return {n: {k: v for k, v in row.items() if k not in timed} for n, row in found.items()}


def table(study: Study) -> list[dict[str, str]]:
    """samples.csv, but for seconds."""
    with (study.out / "samples.csv").open(encoding="utf-8", newline="") as stream:
        return [{k: v for k, v in row.items() if k != "seconds"} for row in csv.DictReader(stream)]


def kept(study: Study) -> dict[str, str]:
    """The files of its store, but for logs; blobs by their content."""
    found = files(study.out / INNER)
    return {
        name: what for name, what in found.items() if name.split("/")[0] not in ("log", "samples")
    }


def recorded(lines: list[dict[str, Any]]) -> dict[str, Any]:
    """By key what was recorded, but for when its files were written."""
    return {
        line["key"]: [
            line["stage"], line["notes"],
            {name: [sha256, size] for name, (sha256, size, _) in line["files"].items()},
        ]
        for line in lines
    }  # fmt: skip


def logged(study: Study) -> list[dict[str, Any]]:
    """The lines of its store's logs."""
    logs = sorted((study.out / INNER / "log").glob("*.log"))
    return [line for path in logs for line in read_log(path)[0] if "key" in line]


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Study:
    """An undisturbed one."""
    folder = tmp_path_factory.mktemp("whole")
    study = Study(write_study(folder, STUDY), folder / "out")
    made_here(study)
    return Study(study.path, study.out, len(logged(study)))


class Disturbed:
    """A study whose processes are killed; its client is called again until it is done."""

    def __init__(self, study: Study, makers: Makers) -> None:
        self.study, self.makers = study, makers
        self.seen = Recorded(study.out, study.out.parent / "links")
        self.kills: Counter[str] = Counter()
        self.done = False
        self.client = self._begin()

    def _begin(self) -> Begun:
        words = "study", self.study.path, "-o", self.study.out, *self.makers.options
        return Begun(self.study.out.parent / "log", *words, before=without_page)

    def reach(self, results: float) -> None:
        """Go on until so many results are recorded, or the client is through."""
        end = time.monotonic() + LIMIT_S
        before = 0
        while not self.done and (now := self.seen.look()) < results:
            if now > before:
                end, before = time.monotonic() + LIMIT_S, now
            assert time.monotonic() < end, f"hangs at {now} results: {self.client.said}"
            if not self.client.process.is_alive():
                code = self.client.end()
                assert code < 0 or wrong(code, self.client.said) == ""
                self.done = code == 0
                if not self.done:
                    self.client = self._begin()
            time.sleep(0.02)

    def kill(self, chance: random.Random) -> None:
        """Kill one of its processes."""
        kind = chance.choice(self.makers.kinds)
        if self.makers.kill(kind, self.client, chance):
            self.kills[kind] += 1

    def close(self) -> None:
        """Leave no process behind."""
        self.client.process.kill()
        self.client.process.join()
        self.makers.close()


def disturb(disturbed: Disturbed, kills: int, results: int, chance: random.Random) -> None:
    """Kill at random moments, from the first result to a while after the last; then leave it alone
    until it is done. A sample that workers have died of three times is left to another call."""
    try:
        for moment in sorted(chance.uniform(0.0, 1.1 * results) for _ in range(kills)):
            disturbed.reach(min(moment, results))
            time.sleep(chance.uniform(0.0, 0.3))
            disturbed.kill(chance)
        for _ in range(3):
            disturbed.reach(float("inf"))
            if {row["status"] for row in rows(disturbed.study).values()} == {"done"}:
                break
            disturbed.done, disturbed.client = False, disturbed._begin()
    finally:
        disturbed.close()


@pytest.mark.parametrize(("kind", "count"), [("loky", 10), ("dask", 10)])
def test_killed_studies_are_taken_up(kind: str, count: int, whole: Study, tmp_path: Path) -> None:
    chance = random.Random(f"{SEED} studies {kind}")
    left, expected = share(count), recorded(logged(whole))
    while left > 0:
        place = tmp_path / str(left)
        place.mkdir()
        makers: Makers = Local() if kind == "loky" else Cluster(place / "cluster")
        disturbed = Disturbed(Study(whole.path, place / "out"), makers)
        disturb(disturbed, min(left, TOGETHER), whole.results, chance)
        told = f"SEED={SEED}, {kind}, {left} kills left, killed {dict(disturbed.kills)}"
        left -= TOGETHER
        study, seen = disturbed.study, disturbed.seen
        assert disturbed.kills.total() > 0, told
        number = seen.look()
        assert {
            k: n for k, n in Counter(one["key"] for one in seen.lines).items() if n > 1
        } == {}, told
        assert recorded(seen.lines) == expected, told
        made_here(study)
        assert seen.look() == number, told
        assert rows(study) == rows(whole), told
        assert table(study) == table(whole), told
        assert kept(study) == kept(whole), told
