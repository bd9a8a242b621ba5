"""Mutated decks and meshes: a result or one error that names the file, within a minute each."""

from __future__ import annotations

import random
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from gpusim.deck import load_deck
from gpusim.errors import InputError
from gpusim.mesh import read_mesh
from tests.hostile.amount import SEED, share
from tests.hostile.deck_mutations import SEEDS, mutated

pytestmark = pytest.mark.hostile

COUNT = share(400)


def _load(path: Path) -> np.ndarray:
    found = load_deck(path)
    assert all(np.isfinite(one.forces).all() for one in found.steps)
    return found.mesh.points


READERS: dict[str, Callable[[Path], np.ndarray]] = {
    "mesh": lambda path: read_mesh(path).points,
    "deck": _load,
}
PAIRS = [(name, how) for name in SEEDS for how in READERS if name.endswith(".inp") or how == "mesh"]


@pytest.mark.parametrize(("name", "how"), PAIRS)
def test_the_files_behind_the_mutations_are_read(name: str, how: str, tmp_path: Path) -> None:
    path = tmp_path / name
    path.write_text(SEEDS[name])
    assert np.isfinite(READERS[how](path)).all()


@pytest.mark.parametrize(("name", "how"), PAIRS)
def test_mutations(name: str, how: str, tmp_path: Path) -> None:
    chance = random.Random(f"{SEED} {name} {how}")
    path = tmp_path / name
    read = 0
    for number in range(COUNT):
        path.write_bytes(mutated(SEEDS[name], chance, name))
        start = time.monotonic()
        told = f"SEED={SEED}, mutation {number} of {name} by {how}"
        try:
            points = READERS[how](path)
        except InputError as error:
            text = str(error)
            assert str(path) in text, f"{told}: no file in {text[:300]!r}"
            assert len(text) < 20_000, f"{told}: a message of {len(text)} letters"
        except Exception as error:
            pytest.fail(f"{told}: {type(error).__name__}: {error}")
        else:
            read += 1
            assert np.isfinite(points).all(), told
        assert time.monotonic() - start < 60.0, told
    assert COUNT < 50 or 0 < read < COUNT
