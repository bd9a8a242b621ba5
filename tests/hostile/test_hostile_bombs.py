"""Archives and bombs: an error that names the file, or a result without what stands elsewhere."""

from __future__ import annotations

import resource
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import gpusim as gs
from gpusim.errors import GpusimError
from gpusim.files.picture_file import pages_of, read_grey
from gpusim.scene import load_scene
from tests.hostile.bombs import BOMB, BOMBS, SECRET, Make
from tests.hostile.tiny_runs import LIMIT, files

pytestmark = pytest.mark.hostile

MOST = 2.5 * BOMB  # bytes: what it unpacks to, twice


def _field(path: Path) -> list[Any]:
    field = gs.read_field(path)
    return [field.mesh.points, *(field.step(number) for number in range(len(field.times)))]


READ: dict[str, Callable[[Path], list[Any]]] = {
    "field": _field,
    "picture": lambda path: [read_grey(page) for page in pages_of(path)],
    "calibration": lambda path: [one.K for one in gs.read_calibration(path)],
    "scene": lambda path: [load_scene(path).name],
}
CASES = [(name, how, make) for name, (how, makes) in BOMBS.items() for make in makes]


@pytest.mark.parametrize(
    ("name", "how", "make"), CASES, ids=[f"{name}-{make.__name__}" for name, _, make in CASES]
)
def test_bombs(name: str, how: str, make: Make, tmp_path: Path) -> None:
    path = tmp_path / name
    make(path)
    before = files(tmp_path)
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    began = time.monotonic()
    try:
        with np.errstate(all="ignore"):
            found = READ[how](path)
    except GpusimError as error:
        text = str(error)
        assert name in text and len(text) < 3000, text[:3000]
    else:
        assert not any(np.any(np.asarray(one) == SECRET) for one in found)
    assert time.monotonic() - began < LIMIT
    grown = 1024 * (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - memory)
    assert grown < MOST, f"{grown / 1e6:.0f} MB"
    assert files(tmp_path) == before
