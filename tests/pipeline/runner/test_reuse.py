"""A camera that sees nothing changed keeps its frame; cameras that are gone leave nothing."""

from __future__ import annotations

import weakref
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import gpusim as gs
from gpusim.export.images import read_image
from gpusim.optics.change_detection import same_surfaces
from gpusim.pipeline.stages import images
from gpusim.plan.plan import make_plan
from gpusim.scene import Scene

WALL = {"name": "wall", "center_mm": [0.0, 300.0, 0.0], "normal": [0.0, -1.0, 0.0],
        "size_mm": [900.0, 500.0],
        "paint": [{"name": "dots", "type": "dots", "albedo": 0.8, "diameter_mm": 9.0,
                   "pitch_mm": 25.0, "columns": 30, "rows": 17,
                   "origin_mm": [-362.0, 300.0, -200.0]}]}  # fmt: skip


def camera(name: str, x: float) -> dict[str, Any]:
    return {"name": name, "sensor_mm": [6.0, 4.0], "resolution_px": [72, 48], "focal_mm": 12.0,
            "position_mm": [x, -500.0, 10.0], "target_mm": [x, 0.0, 0.0]}  # fmt: skip


def scene(**more: Any) -> Scene:
    """A block on the left moves after the second frame; the camera on the right doesn't see it."""
    places = [-250.0, -250.0, -230.0, -210.0]
    block = {"name": "block", "type": "box", "center_mm": [-250.0, 0.0, 0.0],
             "size_mm": [60.0, 40.0, 50.0],
             "poses": [{"position_mm": [x, 0.0, 0.0]} for x in places],
             "paint": [{"name": "grey", "type": "plain", "albedo": 0.3}]}  # fmt: skip
    return Scene.from_document(
        {"schema": 1, "name": "reuse", "prop": [WALL, block],
         "camera": [camera("left", -240.0), camera("right", 160.0)],
         "analysis": {"load_factors": [0.0, 0.0, 0.0, 0.0]}, **more}
    )  # fmt: skip


@pytest.fixture
def rendered(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Names of the cameras, one for each frame that is rendered."""
    names: list[str] = []
    original = images.photograph

    def photograph(surfaces: Any, viewer: gs.Camera, *rest: Any, **options: Any) -> gs.Frame:
        names.append(viewer.name)
        return original(surfaces, viewer, *rest, **options)

    monkeypatch.setattr(images, "photograph", photograph)
    return names


def pictures(folder: Path) -> dict[str, np.ndarray]:
    return {
        str(p.relative_to(folder)): read_image(p) for p in sorted(folder.rglob("images/*/*.png"))
    }


@pytest.mark.parametrize("lit", [False, True])
def test_frames_that_show_the_same_are_rendered_once(
    lit: bool, rendered: list[str], tmp_path: Path
) -> None:
    lamp = {"name": "bulb", "type": "point", "position_mm": [0.0, -900.0, 500.0], "power_W": 9.0}
    given = scene(light=[lamp] if lit else [], sensor={"full_well_e": 9000.0} if lit else {})
    gs.run(given, tmp_path / "skip", backend="numpy")
    # what moves outside of the image counts: it may throw a shadow into it
    assert rendered == ["left"] * 3 + ["right"] * 3
    rendered.clear()
    gs.run(given, tmp_path / "all", backend="numpy", skip=False)
    assert rendered == ["left"] * 4 + ["right"] * 4
    quick, whole = pictures(tmp_path / "skip"), pictures(tmp_path / "all")
    assert len(quick) == 8 and quick.keys() == whole.keys()
    for name, image in quick.items():
        np.testing.assert_array_equal(image, whole[name])
    if lit:  # exposed again: noise of its own
        pair = [quick[f"images/left/{k:04d}.png"] for k in (0, 1)]
        assert (pair[0] != pair[1]).mean() > 0.1


def test_frames_that_come_again_arent_all_held(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A block that goes there and back: pictures of one radiance are taken one after the other."""
    places = [-250.0, -230.0, -210.0, -190.0, -170.0, -190.0, -210.0, -230.0, -250.0]
    document = scene(camera=[camera("left", -240.0)]).document
    document["analysis"] = {"load_factors": [0.0] * len(places)}
    document["prop"][1]["poses"] = [{"position_mm": [x, 0.0, 0.0]} for x in places]
    alive, most = weakref.WeakSet[Any](), []
    original = images.Radiance

    def radiance(*arguments: Any) -> Any:
        made = original(*arguments)
        alive.add(made)
        most.append(len(alive))
        return made

    monkeypatch.setattr(images, "Radiance", radiance)
    gs.run(Scene.from_document(document), tmp_path, backend="numpy")
    assert len(most) == 5 and max(most) <= 3
    assert len(pictures(tmp_path)) == len(places)


def test_a_camera_that_is_gone_leaves_no_images(tmp_path: Path) -> None:
    out = tmp_path / "out"
    both = scene()
    gs.run(both, out, backend="numpy")
    mine = out / "images" / "right" / "notes.txt"
    mine.write_text("kept")
    (out / "images" / "right" / "0002.png").write_bytes(b"touched up")
    one = scene(camera=[camera("left", -240.0)])
    states = {s.name: s.state for s in make_plan(one, out, "numpy").stages}
    assert states["render/left/0003"] == "reused"
    report = gs.run(one, out, backend="numpy")
    assert sorted(p.name for p in (out / "images" / "right").iterdir()) == ["0002.png", "notes.txt"]
    assert [text for text in report.warnings if "right" in text] == [
        "images/right/0002.png is of an earlier scene and was changed since"
    ]
    assert len(list((out / "images" / "left").glob("*.png"))) == 4
    gs.run(both, out, backend="numpy")
    assert len(pictures(out)) == 8


def test_surfaces_of_which_nothing_has_moved() -> None:
    points = np.array([[-0.1, 0, -0.1], [0.1, 0, -0.1], [0.1, 0, 0.1], [-0.1, 0, 0.1]])
    surface = gs.Surface(points, np.array([[0, 1, 2, 3]]))
    moved = surface.moved(points + np.array([[0.0, 0, 0], [0, 0, 0], [0, 0, 0], [0.1, 0, 0]]))
    assert same_surfaces([surface], [surface.moved(points.copy())])
    assert not same_surfaces([surface], [moved])
    assert not same_surfaces([surface], [surface, surface])
    assert not same_surfaces([surface], [replace(surface, paint=gs.paint.Plain(0.9))])
