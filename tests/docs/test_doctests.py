"""Examples in docstrings: every public class and function has one, and it runs."""

from __future__ import annotations

import doctest
import importlib
import importlib.util
import inspect
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import gpusim
from tests.support.example_files import write_example_files

PUBLIC = (
    "gpusim",
    "gpusim.applications",
    "gpusim.deck",
    "gpusim.errors",
    "gpusim.export",
    "gpusim.fem",
    "gpusim.field",
    "gpusim.measure",
    "gpusim.mesh",
    "gpusim.optics",
    "gpusim.optics.lens.psf",
    "gpusim.pipeline",
    "gpusim.scene",
    "gpusim.surface",
    "gpusim.surface.paint",
)
"""Modules whose ``__all__`` is for users."""
NEEDS = {"gpusim.mesh.formats.cad": "gmsh"}
"""Modules whose examples run only where an optional package is installed."""
MOST_CHARACTERS = 240
"""Of what an object shows at a prompt: no array is printed."""
FLAGS = doctest.NORMALIZE_WHITESPACE | doctest.ELLIPSIS


def public_callables() -> dict[str, Any]:
    """Every public class and function, by the name of its home."""
    found = {}
    for module in map(importlib.import_module, PUBLIC):
        for value in (getattr(module, name) for name in module.__all__):
            if inspect.isclass(value) or inspect.isfunction(value):
                found[f"{value.__module__}.{value.__qualname__}"] = value
    return found


def without_example(callables: dict[str, Any]) -> list[str]:
    own = {name: inspect.getdoc(value) or "" for name, value in callables.items()}
    return [name for name, text in own.items() if ">>> " not in text]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("examples")
    write_example_files(folder)
    return folder


def test_every_public_callable_has_an_example() -> None:
    callables = public_callables()
    assert len(callables) > 150
    assert without_example(callables) == []


def test_a_missing_example_is_seen() -> None:
    def solve() -> None:
        """Without an example."""

    assert without_example({"solve": solve}) == ["solve"]


@pytest.mark.parametrize("name", sorted(public_callables()))
def test_example_runs(name: str, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    value = public_callables()[name]
    needed = NEEDS.get(value.__module__)
    if needed and importlib.util.find_spec(needed) is None:
        pytest.skip(f"needs {needed}")
    monkeypatch.chdir(folder)
    text = inspect.getdoc(value) or ""
    examples = doctest.DocTestParser().get_doctest(
        text, {"np": np, "gs": gpusim}, name, inspect.getsourcefile(value), 0
    )
    said: list[str] = []
    runner = doctest.DocTestRunner(optionflags=FLAGS)
    result = runner.run(examples, out=said.append, clear_globs=False)
    assert result.failed == 0, "".join(said)
    made = [one for one in examples.globs.values() if type(one).__module__.startswith("gpusim.")]
    assert [repr(one) for one in made if len(repr(one)) > MOST_CHARACTERS] == []
