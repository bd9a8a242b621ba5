"""Runs that are killed at any moment, and taken up in the same folder: the same bytes in the end.

Most are divided from a process that has imported everything; every tenth is the user's command.
"""

from __future__ import annotations

import random
import time
from pathlib import Path

import pytest

from tests.hostile.amount import SEED, share
from tests.hostile.tiny_runs import (
    LIMIT,
    Begun,
    command,
    files,
    results,
    stored,
    write_scene,
    wrong,
)

pytestmark = pytest.mark.hostile


@pytest.mark.parametrize(("backend", "count"), [("numpy", 70), ("gpu", 30)])
def test_killed_runs_are_taken_up(backend: str, count: int, tmp_path: Path) -> None:
    scene = write_scene(tmp_path)
    first = Begun(tmp_path / "log", "run", scene, "-o", tmp_path / "first", "--backend", backend)
    assert first.end() == 0, first.said
    began = time.monotonic()
    again = Begun(tmp_path / "log", "run", scene, "-o", tmp_path / "again", "--backend", backend)
    assert again.end() == 0, again.said
    whole = time.monotonic() - began
    expected = results(tmp_path / "first")
    assert results(tmp_path / "again") == expected
    chance = random.Random(f"{SEED} kills {backend}")
    cut = 0
    for number in range(share(count)):
        told = f"SEED={SEED}, kill {number} on {backend}"
        place = tmp_path / str(number)
        place.mkdir()
        (place / "beside.txt").write_text("not of the run")
        words = ("run", scene, "-o", place / "out", "--backend", backend)
        for _ in range(chance.choice((1, 1, 1, 2, 3))):
            if number % 10 == 9:
                whole_command = command(*words)
                time.sleep(chance.uniform(0.0, 2.0 * whole))
                whole_command.kill()
                whole_command.communicate(timeout=LIMIT)
                cut += whole_command.returncode < 0
                continue
            begun = Begun(tmp_path / "log", *words)
            begun.process.join(chance.uniform(0.0, whole))
            begun.process.kill()
            cut += begun.end() < 0
        last = Begun(tmp_path / "log", *words)
        assert wrong(last.end(), last.said, (0,)) == "", told
        assert results(place / "out") == expected, told
        assert stored(place / "out") == stored(tmp_path / "first"), told
        assert set(files(place)) - {f"out/{name}" for name in files(place / "out")} == {
            "out", "beside.txt"
        }, told  # fmt: skip
    assert cut > 0
