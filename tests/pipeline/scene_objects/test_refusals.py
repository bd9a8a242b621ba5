"""What a scene's model can't be built from: one error that says where, nothing written."""

from __future__ import annotations

from pathlib import Path

import pytest

import gpusim as gs
from tests.pipeline.stages.test_mechanics import CLAMP, DOWN, scene
from tests.support.scene_models import scene_model


def test_errors_say_which_entry_they_are_about() -> None:
    nowhere = {"x_min_mm": 999.0}
    bad = {
        "load 'down'": {"load": [{**DOWN, "where": nowhere}]},
        "support 'clamp'": {"support": [{**CLAMP, "where": nowhere}]},
        "part 0 of 'steel'": {"part": [{"material": "steel", "where": {"set": "x_min"}}]},
        "supports": {"support": [{**CLAMP, "fix": ["x", "y"]}]},
    }
    for name, changes in bad.items():
        with pytest.raises(gs.InputError, match=f"^body 'bar'(, |: ){name}: "):
            scene_model(scene(**changes))


def test_a_scene_beyond_the_memory_is_refused_before_work(tmp_path: Path) -> None:
    mesh = {"builder": "box", "size_mm": [240.0, 20.0, 10.0], "divisions": [10_000, 10_000, 9_000]}
    with pytest.raises(gs.InputError, match=r"mesh: needs about .* GB of memory .*elements"):
        gs.run(scene(mesh=mesh), tmp_path / "out", backend="numpy")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("name", ["measure", "images", "solution"])
def test_a_file_where_a_folder_belongs_is_told_before_work(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_text("mine")
    with pytest.raises(gs.InputError, match=rf"{name} is no folder; expected a folder, or nothing"):
        gs.run(scene(), tmp_path, backend="numpy")
    assert [path.name for path in tmp_path.iterdir()] == [name]
    assert (tmp_path / name).read_text() == "mine"
