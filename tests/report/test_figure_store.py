"""Figures of a rerun: drawn where what they show has changed, and nowhere else."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np
import pytest

from gpusim.report.figure_store import KEYS, FigureStore
from gpusim.report.model import Drawing, Figure

drawn: list[str] = []


def draw(values: np.ndarray, source: Path, path: Path) -> Figure:
    drawn.append(path.name)
    path.write_bytes(values.tobytes() + source.read_bytes())
    return Figure(path, "Title", "Caption", photo=True, frame="load 1")


@pytest.fixture
def source(tmp_path: Path) -> Path:
    drawn.clear()
    (tmp_path / "figures").mkdir()
    (tmp_path / "0000.png").write_bytes(b"picture")
    return tmp_path / "0000.png"


def shown(source: Path, one: float = 1.0, other: float = 2.0) -> list[Figure]:
    folder = source.parent / "figures"
    drawings: list[Drawing] = [
        partial(draw, np.array([one, other]), source, folder / "a.png"),
        partial(draw, np.array([2.0]), source, folder / "b.png"),
    ]
    figures = FigureStore(folder)
    found = [figures.figure(drawing) for drawing in drawings]
    figures.keep()
    return found


def test_what_is_there_is_not_drawn_again(source: Path) -> None:
    first = shown(source)
    assert drawn == ["a.png", "b.png"]
    assert shown(source) == first and drawn == ["a.png", "b.png"]


def test_what_has_changed_is_drawn(source: Path) -> None:
    shown(source)
    shown(source, other=2.0 + 1e-15)
    assert drawn[2:] == ["a.png"]
    shown(source)
    assert drawn[3:] == ["a.png"], "what was drawn in between was taken for it"
    source.write_bytes(b"another")
    shown(source)
    assert drawn[4:] == ["a.png", "b.png"]


@pytest.mark.parametrize("text", [None, "{", "[1]", '{"a": 1}', "\x00"])
def test_files_that_somebody_has_changed(source: Path, text: str | None) -> None:
    shown(source)
    folder = source.parent / "figures"
    if text is None:
        (folder / "b.png").write_bytes(b"scribbled")
    else:
        (folder / KEYS).write_text(text)
    shown(source)
    assert drawn[2:] == (["b.png"] if text is None else ["a.png", "b.png"])
    assert (folder / "b.png").read_bytes().endswith(b"picture")


def test_an_entry_of_another_shape(source: Path) -> None:
    shown(source)
    keys = source.parent / "figures" / KEYS
    keys.write_text(keys.read_text().replace('"title"', '"titel"'))
    shown(source)
    assert drawn[2:] == ["a.png", "b.png"]
