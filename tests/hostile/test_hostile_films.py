"""Runs that film, killed at any moment and while the film is written: the same film in the end."""

from __future__ import annotations

import random
import time
from pathlib import Path

import pytest

from tests.hostile.amount import SEED, share
from tests.hostile.tiny_runs import LIMIT, Begun, results, stored, write_scene, wrong

pytestmark = pytest.mark.hostile


def film_begun(out: Path, process: Begun) -> bool:
    """Waits until there is a beginning of a film; False if the run ends before."""
    until = time.monotonic() + LIMIT
    while process.process.is_alive() and time.monotonic() < until:
        if any(".mkv" in path.name or ".mraw" in path.name for path in out.rglob("*")):
            return True
        time.sleep(0.001)
    return False


@pytest.mark.parametrize("format_", ["ffv1", "mraw"])
def test_killed_films_are_taken_up(format_: str, tmp_path: Path) -> None:
    scene = write_scene(tmp_path, film=format_)
    began = time.monotonic()
    first = Begun(tmp_path / "log", "run", scene, "-o", tmp_path / "first", "--backend", "numpy")
    assert first.end() == 0, first.said
    whole = time.monotonic() - began
    expected = results(tmp_path / "first")
    assert any(name.startswith("video/") for name in expected)
    chance = random.Random(f"{SEED} films {format_}")
    cut = 0
    for number in range(share(40)):
        told = f"SEED={SEED}, kill {number} of {format_}"
        out = tmp_path / str(number)
        for writing in (False, True):
            begun = Begun(tmp_path / "log", "run", scene, "-o", out, "--backend", "numpy")
            if writing:
                film_begun(out, begun)
                begun.process.join(chance.uniform(0.0, 0.1))
            else:
                begun.process.join(chance.uniform(0.0, whole))
            begun.process.kill()
            cut += begun.end() < 0
        last = Begun(tmp_path / "log", "run", scene, "-o", out, "--backend", "numpy")
        assert wrong(last.end(), last.said, (0,)) == "", told
        assert results(out) == expected, told
        assert stored(out) == stored(tmp_path / "first"), told
    assert cut > 0
