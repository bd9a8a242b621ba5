"""``scene.toml`` of an output folder is what was run, and what was there isn't lost."""

from __future__ import annotations

import warnings
from pathlib import Path

import pytest

import gpusim as gs
from tests.support.small_scene import small_scene


def test_a_scene_file_that_somebody_has_edited_is_kept(tmp_path: Path) -> None:
    path = tmp_path / "scene.toml"
    gs.run(small_scene(), tmp_path, backend="numpy")
    made = path.read_text(encoding="utf-8")
    edits = [f"# mine\n{made}", made.replace("= 1", "=  1", 1), f"{made}# mine\n", "no scene", ""]
    for number, text in enumerate(edits, 1):
        path.write_text(text, encoding="utf-8")
        with pytest.warns(UserWarning, match=f"scene.toml: .*, kept as scene-{number}.toml"):
            gs.run(small_scene(), tmp_path, backend="numpy")
        assert (tmp_path / f"scene-{number}.toml").read_text(encoding="utf-8") == text
        assert path.read_text(encoding="utf-8") == made
    gs.run(small_scene(name="other"), tmp_path, backend="numpy")  # what wasn't edited goes
    assert gs.load_scene(path).name == "other"
    assert len(list(tmp_path.glob("scene*.toml"))) == 1 + len(edits)


def test_a_scene_in_the_folder_that_it_is_run_into(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    own = "# mine\n" + small_scene().to_toml()
    (tmp_path / "scene.toml").write_text(own, encoding="utf-8")
    with pytest.warns(UserWarning, match="kept as scene-1.toml"):
        gs.run(gs.load_scene("scene.toml"), ".", backend="numpy")
    assert (tmp_path / "scene-1.toml").read_text(encoding="utf-8") == own
    assert gs.load_scene("scene.toml") == gs.load_scene("scene-1.toml")


def test_states_of_a_scene(tmp_path: Path) -> None:
    scene = small_scene(variant=[{"name": "a"}, {"name": "b"}])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for _ in range(2):
            gs.run(scene, tmp_path, backend="numpy")
    edited = tmp_path / "variants" / "b" / "scene.toml"
    edited.write_text("mine", encoding="utf-8")
    with pytest.warns(UserWarning, match="kept as scene-1.toml"):
        gs.run(scene, tmp_path, backend="numpy")
    assert edited.with_name("scene-1.toml").read_text(encoding="utf-8") == "mine"
