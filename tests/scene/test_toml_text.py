"""A scene's text reads back to the same, whatever stands in it, and is quickly written."""

from __future__ import annotations

import time
import tomllib
from datetime import date
from pathlib import Path

import numpy as np
import pytest

from gpusim.scene import Scene, load_scene
from gpusim.scene.toml_text import toml_text
from tests.support.example_scenes import example_scenes


def test_every_example_reads_back(checkout: Path) -> None:
    for path in example_scenes(checkout):
        scene = load_scene(path)
        assert tomllib.loads(scene.to_toml()) == scene.document
        assert Scene.from_document(tomllib.loads(scene.to_toml())) == scene


def test_strange_documents_read_back() -> None:
    document = {
        "a b": 1, "c.d": -0.0, "e": 1e-7, "f": 1e300, "": "empty", "é": "ü", 'q"': "'\"\\",
        "text": "line\nnext\ttab\x1b\x7f\u202e\U000e0001 \U0001f600", "list": [[], [1, [2.5]], []],
        "mixed": [1, {"x": [{"y": None, "z": 2}]}], "day": date(2026, 1, 2), "big": 10**30,
        "table": {"deep": {"a.b": {"": 3}}, "none": None}, "empty table": {},
        "tables": [{"inner": [{"v": 1}, {}]}, {"w": [{"x": {"y": [1]}}]}],
    }  # fmt: skip
    text = toml_text(document)
    del document["table"]["none"], document["mixed"][1]["x"][0]["y"]  # type: ignore[index]
    assert tomllib.loads(text) == document
    assert text.isprintable() or not {"\x1b", "\u202e", "\x7f", "\U000e0001"} & set(text)
    assert np.signbit(tomllib.loads(text)["c.d"])
    with pytest.raises(TypeError, match="no word for complex"):
        toml_text({"a": 1j})


def test_long_lists_take_no_time() -> None:
    started = time.process_time()
    assert len(toml_text({"a": [[1.5, 2.5, 3.5]] * 50_000})) > 800_000
    assert time.process_time() - started < 2.0
